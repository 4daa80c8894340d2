"""Linear least squares with standard errors, in plain Python."""
import math


def inverse(matrix):
    """Of a small square matrix, by Gauss and Jordan with the largest pivot. Errors: ZeroDivisionError where singular."""
    n = len(matrix)
    a = [row[:] + [float(i == j) for j in range(n)] for i, row in enumerate(matrix)]
    for c in range(n):
        pivot = max(range(c, n), key=lambda r: abs(a[r][c]))
        a[c], a[pivot] = a[pivot], a[c]
        a[c] = [v / a[c][c] for v in a[c]]
        for r in range(n):
            if r != c:
                a[r] = [v - a[r][c] * w for v, w in zip(a[r], a[c])]
    return [row[n:] for row in a]


def fit(rows, values, weights):
    """Coefficients and their standard errors of values = rows * coefficients, the squares of the errors weighed. The
    variance of a value of weight 1 is what is left over says."""
    n = len(rows[0])
    size = [math.sqrt(sum(w * r[i] ** 2 for r, w in zip(rows, weights))) or 1.0 for i in range(n)]
    scaled = [[v / s for v, s in zip(row, size)] for row in rows]
    normal = [[sum(w * r[i] * r[j] for r, w in zip(scaled, weights)) for j in range(n)] for i in range(n)]
    right = [sum(w * r[i] * v for r, v, w in zip(scaled, values, weights)) for i in range(n)]
    covariance = inverse(normal)
    found = [sum(c * r for c, r in zip(row, right)) for row in covariance]
    left = sum(w * (v - sum(f * x for f, x in zip(found, r))) ** 2 for r, v, w in zip(scaled, values, weights))
    variance = left / max(1, len(rows) - n)
    return [f / s for f, s in zip(found, size)], [math.sqrt(variance * covariance[i][i]) / size[i] for i in range(n)]


def fit_not_below_zero(rows, values, weights):
    """The same where a coefficient is a cost: one that comes out below zero, or below its standard error, is left out, the
    worst first; it is 0 and has an infinite standard error."""
    used = list(range(len(rows[0])))
    while True:
        found, errors = fit([[r[i] for i in used] for r in rows], values, weights)
        worst = min(range(len(used)), key=lambda k: found[k] / errors[k] if errors[k] else found[k])
        if found[worst] >= errors[worst] or len(used) == 1:
            break
        used.pop(worst)
    all_found, all_errors = [0.0] * len(rows[0]), [math.inf] * len(rows[0])
    for i, f, e in zip(used, found, errors):
        all_found[i], all_errors[i] = max(f, 0.0), e
    return all_found, all_errors
