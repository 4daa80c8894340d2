"""The lens that tracks have when the poses are the true ones: what a published calibration can be judged by.

Every track is triangulated from the true poses; focal length (as one factor), principal point and k1 are then the least
squares of all that is left. Poses of another sensor than the camera, such as a GPS, shift the principal point.
"""
import collections
import struct

try:
    import numpy as np
except ImportError:
    np = None

LEAST_SEEN = 4  # images of a track
MOST_RMS = 1.0  # pixels, of a track that is no outlier


def rotation(x, y, z, w):
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def true_poses(path):
    """(rotation from world to camera, centre) by line of a TUM file."""
    lines = [line.split() for line in path.read_text().splitlines() if line.strip() and line[0] != "#"]
    rows = [[float(word) for word in line] for line in lines]
    return [(rotation(*row[4:8]).T, np.array(row[1:4])) for row in rows]


def tracks_of(images, poses):
    """By point: (pose, pixel) of each image that sees it; the digits of an image's name are the line of its pose."""
    tracks = collections.defaultdict(list)
    data = images.read_bytes()
    count, at = struct.unpack_from("<Q", data)[0], 8
    for _ in range(count):
        at += 64  # number, quaternion, translation, camera
        end = data.index(b"\0", at)
        stem = data[at:end].decode().split("/")[-1].split(".")[0]
        frame = int("".join(c for c in stem if c.isdigit()))
        seen, at = struct.unpack_from("<Q", data, end + 1)[0], end + 9
        for x, y, point in np.frombuffer(data, dtype="<f8,<f8,<i8", count=seen, offset=at):
            if point >= 0 and frame < len(poses):
                tracks[point].append((poses[frame], x - 0.5, y - 0.5))
        at += 24 * seen
    return [track for track in tracks.values() if len(track) >= LEAST_SEEN]


def triangulated(track, lens):
    fx, fy, cx, cy, _ = lens
    rows = []
    for (turn, centre), x, y in track:
        projection = np.hstack([turn, (-turn @ centre)[:, None]])
        rows += [(x - cx) / fx * projection[2] - projection[0], (y - cy) / fy * projection[2] - projection[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return point[:3] / point[3]


def residuals(track, lens, point):
    """Residuals, and their derivatives by the point and by (log f, cx, cy, k1)."""
    fx, fy, cx, cy, k1 = lens
    r, by_point, by_lens = [], [], []
    for (turn, centre), x, y in track:
        q = turn @ (point - centre)
        a, b = q[0] / q[2], q[1] / q[2]
        square = a * a + b * b
        s = 1 + k1 * square
        r += [fx * a * s + cx - x, fy * b * s + cy - y]
        by_point += [fx * (turn[0] - a * turn[2]) / q[2], fy * (turn[1] - b * turn[2]) / q[2]]
        by_lens += [[fx * a, 1, 0, fx * a * square], [fy * b, 0, 1, fy * b * square]]
    return np.array(r), np.array(by_point), np.array(by_lens)


def fit(images, truth, given):
    """[(name, given, true, sigma)] for fx, cx, cy, k1, and the rms in pixels with the given lens and the true one. Errors of a
    track count as one."""
    tracks = tracks_of(images, true_poses(truth))
    lens = np.array([*given, 0.0])
    rms = []
    for _ in range(4):
        normal, gradient, scatter, squares, count = np.zeros((4, 4)), np.zeros(4), np.zeros((4, 4)), 0.0, 0
        for track in tracks:
            point = triangulated(track, lens)
            for _ in range(4):
                r, by_point, by_lens = residuals(track, lens, point)
                point = point - np.linalg.lstsq(by_point, r, rcond=None)[0]
            basis, _ = np.linalg.qr(by_point)
            r, by_lens = r - basis @ (basis.T @ r), by_lens - basis @ (basis.T @ by_lens)
            if np.sqrt(np.mean(r**2)) > MOST_RMS:
                continue
            part = by_lens.T @ r
            normal += by_lens.T @ by_lens
            gradient += part
            scatter += np.outer(part, part)
            squares, count = squares + np.sum(r**2), count + len(r)
        rms.append(np.sqrt(squares / count))
        step = -np.linalg.solve(normal, gradient)
        lens = lens * np.array([np.exp(step[0]), np.exp(step[0]), 1, 1, 1]) + np.array([0, 0, *step[1:]])
    inverse = np.linalg.inv(normal)
    sigma = np.sqrt(np.diag(inverse @ scatter @ inverse)) * np.array([lens[0], 1, 1, 1])
    names, places = ["fx", "cx", "cy", "k1"], [0, 2, 3, 4]
    return [(n, [*given, 0.0][p], lens[p], s) for n, p, s in zip(names, places, sigma)], rms[0], rms[-1]
