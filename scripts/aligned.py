"""Similarity between two lists of points by least squares (Horn 1987, quaternions), in plain Python."""
import math


def largest_eigenvector(matrix):
    """Of a symmetric matrix, by Jacobi's rotations."""
    size = len(matrix)
    a = [row[:] for row in matrix]
    v = [[float(i == j) for j in range(size)] for i in range(size)]
    for _ in range(60):
        rest = [(abs(a[i][j]), i, j) for i in range(size) for j in range(i + 1, size)]
        most, p, q = max(rest)
        if most < 1e-15 * sum(abs(a[i][i]) for i in range(size)):
            break
        angle = 0.5 * math.atan2(2 * a[p][q], a[q][q] - a[p][p])
        c, s = math.cos(angle), math.sin(angle)
        for m in (a, v):
            for row in m:
                row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
        a[p], a[q] = ([c * x - s * y for x, y in zip(a[p], a[q])], [s * x + c * y for x, y in zip(a[p], a[q])])
    best = max(range(size), key=lambda i: a[i][i])
    return [row[best] for row in v]


def mean(points):
    return [sum(p[i] for p in points) / len(points) for i in range(3)]


def rotation_of(w, x, y, z):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def similarity(points, targets):
    """A function that moves a point from the frame of `points` to that of `targets`: lists of one length."""
    a0, b0 = mean(points), mean(targets)
    a = [[p[i] - a0[i] for i in range(3)] for p in points]
    b = [[p[i] - b0[i] for i in range(3)] for p in targets]
    s = [[sum(p[i] * q[j] for p, q in zip(a, b)) for j in range(3)] for i in range(3)]
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = s
    r = rotation_of(*largest_eigenvector([[xx + yy + zz, yz - zy, zx - xz, xy - yx],
                                          [yz - zy, xx - yy - zz, xy + yx, zx + xz],
                                          [zx - xz, xy + yx, yy - xx - zz, yz + zy],
                                          [xy - yx, zx + xz, yz + zy, zz - xx - yy]]))
    turned = [[sum(r[i][j] * p[j] for j in range(3)) for i in range(3)] for p in a]
    size = sum(c * c for p in a for c in p)
    scale = sum(x * y for p, q in zip(turned, b) for x, y in zip(p, q)) / size

    def move(p):
        d = [p[i] - a0[i] for i in range(3)]
        return [scale * sum(r[i][j] * d[j] for j in range(3)) + b0[i] for i in range(3)]

    return move
