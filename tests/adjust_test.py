"""The subcommand `adjust`: adjust_test.py PROGRAM [unittest arguments]. Every expected number is computed here, from
the definitions of the formats, or by COLMAP."""
import bz2
import collections
import json
import math
import random
import re
import shutil
import signal
import struct
import subprocess
import unittest

import program
from program import ProgramTest, run

LENS = (500.0, 320.0, 240.0)  # SIMPLE_PINHOLE: f cx cy, pixels counted from the corner


def rotate(vector, x):
    """x turned by a rotation vector (Rodrigues)."""
    angle = math.sqrt(sum(v * v for v in vector))
    if angle < 1e-12:
        return [x[i] + vector[(i + 1) % 3] * x[(i + 2) % 3] - vector[(i + 2) % 3] * x[(i + 1) % 3] for i in range(3)]
    k = [v / angle for v in vector]
    c, s, d = math.cos(angle), math.sin(angle), sum(a * b for a, b in zip(k, x))
    return [x[i] * c + (k[(i + 1) % 3] * x[(i + 2) % 3] - k[(i + 2) % 3] * x[(i + 1) % 3]) * s + k[i] * d * (1 - c)
            for i in range(3)]


def turned(q, x):
    """x turned by a quaternion, w first."""
    length = math.sqrt(sum(v * v for v in q))
    w, u = q[0] / length, [v / length for v in q[1:]]
    a = [u[(i + 1) % 3] * x[(i + 2) % 3] - u[(i + 2) % 3] * x[(i + 1) % 3] + w * x[i] for i in range(3)]
    return [x[i] + 2 * (u[(i + 1) % 3] * a[(i + 2) % 3] - u[(i + 2) % 3] * a[(i + 1) % 3]) for i in range(3)]


def quaternion(vector):
    angle = math.sqrt(sum(v * v for v in vector))
    return [math.cos(angle / 2)] + [v * math.sin(angle / 2) / angle for v in vector]


def bal_pixel(camera, point):
    p = [a + b for a, b in zip(rotate(camera[:3], point), camera[3:6])]
    n = [-p[0] / p[2], -p[1] / p[2]]
    q = n[0] * n[0] + n[1] * n[1]
    return [camera[6] * (1 + camera[7] * q + camera[8] * q * q) * v for v in n]


def colmap_pixel(image, point):
    p = [a + b for a, b in zip(turned(image["q"], point), image["t"])]
    return [LENS[0] * p[0] / p[2] + LENS[1], LENS[0] * p[1] / p[2] + LENS[2]]


def loss(name, scale, s):
    """rho(s) of the squared residual, the textbook forms with rho(s) ~ s near zero."""
    a = scale * scale
    if name == "huber":
        return s if s <= a else 2 * scale * math.sqrt(s) - a
    if name == "cauchy":
        return a * math.log(1 + s / a)
    if name == "tukey":
        return a / 3 * (1 - max(0.0, 1 - s / a) ** 3)
    return s


def squared(a, b):
    return sum((x - y) ** 2 for x, y in zip(a, b))


class Bal:
    """A problem in memory: a camera that drives along x past points, with perturbed start and noisy pixels."""

    def __init__(self, cameras=8, points=80, noise=0.0, outliers=0):
        rng = random.Random(1)
        truth = []
        for i in range(cameras):
            turn = [0.01 * (i % 9), -0.02 * (i % 7), 0.03]
            truth.append(turn + rotate(turn, [-0.3 * i, 0.01 * (i % 5), 0.0]) + [400.0, -0.05, 0.01])
        width = 0.3 * cameras
        world = [[rng.uniform(-2, width + 2), rng.uniform(-2, 2), rng.uniform(-8, -4)] for _ in range(points)]
        self.observations = []
        for c, camera in enumerate(truth):
            for p, point in enumerate(world):
                if abs(point[0] - 0.3 * c) < 2.5:
                    pixel = [v + rng.gauss(0, noise) for v in bal_pixel(camera, point)]
                    self.observations.append((c, p, pixel))
        seen = collections.Counter(p for _, p, _ in self.observations)
        self.observations = [o for o in self.observations if seen[o[1]] > 1]
        for i in range(outliers):
            c, p, pixel = self.observations[7 * i]
            self.observations[7 * i] = (c, p, [pixel[0] + 40, pixel[1] - 30])
        self.cameras = [[v + rng.gauss(0, 1e-3) for v in camera[:6]] + camera[6:] for camera in truth]
        self.points = [[v + rng.gauss(0, 0.02) for v in point] for point in world]

    def text(self):
        lines = [f"{len(self.cameras)} {len(self.points)} {len(self.observations)}"]
        lines += [f"{c} {p}     {u:.17g} {v:.17g}" for c, p, (u, v) in self.observations]
        lines += [repr(v) for block in self.cameras + self.points for v in block]
        return "\n".join(lines) + "\n"

    def cost(self, name="none", scale=1.0):
        return 0.5 * sum(loss(name, scale, squared(bal_pixel(self.cameras[c], self.points[p]), pixel))
                         for c, p, pixel in self.observations)

    @staticmethod
    def parsed(text):
        words = iter(text.split())
        problem = Bal.__new__(Bal)
        cameras, points, observations = (int(next(words)) for _ in range(3))
        problem.observations = [(int(next(words)), int(next(words)), [float(next(words)), float(next(words))])
                                for _ in range(observations)]
        problem.cameras = [[float(next(words)) for _ in range(9)] for _ in range(cameras)]
        problem.points = [[float(next(words)) for _ in range(3)] for _ in range(points)]
        assert next(words, None) is None
        return problem


class Colmap:
    """A model in memory, pixels from the corner of the first one; some keypoints belong to no point."""

    def __init__(self, images=6, points=60, noise=0.3):
        rng = random.Random(2)
        world = [[rng.uniform(-3, 3), rng.uniform(-2, 2), rng.uniform(5, 9)] for _ in range(points)]
        truth = [{"q": quaternion([0.01 * i + 0.01, 0.02, -0.01 * i]), "t": [0.3 * i - 0.8, 0.02 * i, 0.0]}
                 for i in range(images)]
        self.images, self.tracks = [], [[] for _ in world]
        for i, image in enumerate(truth):
            keypoints = [(3.5, 4.25, -1)]
            for p, point in enumerate(world):
                pixel = [v + rng.gauss(0, noise) for v in colmap_pixel(image, point)]
                self.tracks[p].append((10 + i, len(keypoints)))
                keypoints.append((pixel[0], pixel[1], 100 + p))
            keypoints.append((1.5, 2.5, -1))
            start = {"q": [v + rng.gauss(0, 1e-3) for v in image["q"]],
                     "t": [v + rng.gauss(0, 0.01) for v in image["t"]]}
            self.images.append({"id": 10 + i, "name": f"frame {9 - i}.jpg", "keypoints": keypoints, **start})
        self.points = [[v + rng.gauss(0, 0.02) for v in point] for point in world]
        self.colours = [(rng.randrange(256), 7, 255) for _ in world]

    def cameras_txt(self):
        return "1 SIMPLE_PINHOLE 640 480 %r %r %r\n2 FOV 64 48 50.0 50.0 32.0 24.0 0.9\n" % LENS

    def images_txt(self):
        lines = ["# comment"]
        for image in self.images:
            lines.append(" ".join(map(repr, [image["id"], *image["q"], *image["t"], 1])) + " " + image["name"])
            lines.append(" ".join(f"{u!r} {v!r} {p}" for u, v, p in image["keypoints"]))
        return "\n".join(lines) + "\n"

    def points_txt(self):
        return "".join(" ".join(map(str, [100 + p, *map(repr, self.points[p]), *self.colours[p], -1,
                                          *(v for element in self.tracks[p] for v in element)])) + "\n"
                       for p in range(len(self.points)))

    def write_text(self, folder):
        folder.mkdir(parents=True)
        (folder / "cameras.txt").write_text(self.cameras_txt())
        (folder / "images.txt").write_text(self.images_txt())
        (folder / "points3D.txt").write_text(self.points_txt())
        return folder

    def write_binary(self, folder):
        folder.mkdir(parents=True)
        none = 2**64 - 1
        (folder / "cameras.bin").write_bytes(struct.pack("<QIiQQ3d", 2, 1, 0, 640, 480, *LENS) +
                                             struct.pack("<IiQQ5d", 2, 7, 64, 48, 50, 50, 32, 24, 0.9))
        images = struct.pack("<Q", len(self.images))
        for i in self.images:
            images += struct.pack("<I7dI", i["id"], *i["q"], *i["t"], 1) + i["name"].encode() + b"\0"
            images += struct.pack("<Q", len(i["keypoints"]))
            images += b"".join(struct.pack("<ddQ", u, v, none if p < 0 else p) for u, v, p in i["keypoints"])
        (folder / "images.bin").write_bytes(images)
        points = struct.pack("<Q", len(self.points))
        for p, point in enumerate(self.points):
            points += struct.pack("<Q3d3BdQ", 100 + p, *point, *self.colours[p], -1, len(self.tracks[p]))
            points += b"".join(struct.pack("<II", *element) for element in self.tracks[p])
        (folder / "points3D.bin").write_bytes(points)
        return folder

    def adjusted(self, folder):
        """This model with the poses, positions and errors of the text model in a folder."""
        lines = [line for line in (folder / "images.txt").read_text().split("\n") if not line.startswith("#")]
        for image, line in zip(self.images, lines[0::2]):
            words = line.split(" ", 9)
            assert (int(words[0]), int(words[8]), words[9]) == (image["id"], 1, image["name"]), line
            image["q"], image["t"] = [float(w) for w in words[1:5]], [float(w) for w in words[5:8]]
        self.errors = []
        lines = [line.split() for line in (folder / "points3D.txt").read_text().split("\n")
                 if line and not line.startswith("#")]
        for p, words in enumerate(lines):
            assert int(words[0]) == 100 + p and tuple(map(int, words[4:7])) == self.colours[p], words
            self.points[p] = [float(w) for w in words[1:4]]
            self.errors.append(float(words[7]))
        return self

    def residuals(self, p):
        return [squared(colmap_pixel(self.images[i - 10], self.points[p]), self.images[i - 10]["keypoints"][k][:2])
                for i, k in self.tracks[p]]


class AdjustTest(ProgramTest):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"

    def adjust(self, source, *arguments, code=0):
        done = run("adjust", source, "--out", self.out, *arguments)
        self.assertEqual(done.returncode, code, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertIn("version:", (self.out / "config.yaml").read_text())
        self.assertTrue((self.out / "points.ply").read_bytes().startswith(b"ply"))
        return report


class AdjustBal(AdjustTest):
    def test_exact_pixels_are_found_again(self):
        start = Bal()
        source = self.file("a.problem.txt", start.text())
        for method in ("global", "local", "hierarchical"):
            report = self.adjust(source, "--method", method, "--seed", 3)
            self.assertAlmostEqual(report["cost"]["initial"], start.cost(), delta=1e-6 * start.cost())
            self.assertLess(report["cost"]["final"], 1e-6 * start.cost(), method)
            self.assertLess(report["rms_reprojection_px"], 1e-2)
            self.assertEqual((report["method"], report["seed"], report["intrinsics"]), (method, 3, "refined"))
            self.assertEqual((report["cameras"], report["points"], report["dropped"]), (8, 80, 0))
            self.assertEqual(report["observations"], len(start.observations))
            self.assertGreater(report["iterations"], 0)
            self.assertGreater(report["timing"]["solve_s"], 0)
            end = Bal.parsed((self.out / "a.problem.txt").read_text())
            self.assertEqual(end.observations, start.observations)
            self.assertLess(end.cost(), 1e-6 * start.cost())
        self.assertEqual(source.read_text(), start.text())

    def test_cost_is_that_of_the_loss(self):
        start = Bal(noise=0.5, outliers=10)
        source = self.file("p.txt.bz2", bz2.compress(start.text().encode()))
        for name, scale in (("none", 1.0), ("huber", 1.5), ("cauchy", 2.0), ("tukey", 200.0)):
            report = self.adjust(source, "--loss", name, "--loss-scale", scale)
            end = Bal.parsed(bz2.decompress((self.out / "p.txt.bz2").read_bytes()).decode())
            self.assertAlmostEqual(report["cost"]["initial"], start.cost(name, scale), delta=1e-9 * start.cost())
            self.assertAlmostEqual(report["cost"]["final"], end.cost(name, scale), delta=1e-9 * start.cost())
            self.assertLess(report["cost"]["final"], report["cost"]["initial"])
            rms = math.sqrt(2 * end.cost() / len(end.observations))
            self.assertAlmostEqual(report["rms_reprojection_px"], rms, delta=1e-9 * rms)

    def test_same_bytes_for_any_number_of_threads(self):
        source = self.file("p.txt", Bal(noise=0.5).text())
        contents = []
        for threads in (1, 2, 3):
            self.adjust(source, "--threads", threads)
            contents.append((self.out / "p.txt").read_bytes())
        self.assertEqual(contents[0], contents[1])
        self.assertEqual(contents[0], contents[2])

    def test_what_cannot_be_adjusted_is_left_as_it_was(self):
        problem = Bal(noise=0.5)
        problem.points += [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]  # seen once and never
        problem.cameras.append([0.1] * 9)                    # sees only the former
        problem.observations.append((8, 80, [0.0, 0.0]))
        problem.observations.append((8, 80, [1.0, 0.0]))
        report = self.adjust(self.file("p.txt", problem.text()))
        self.assertEqual(report["left_out"], {"images": 1, "points": 2})
        end = Bal.parsed((self.out / "p.txt").read_text())
        self.assertEqual((end.points[80:], end.cameras[8]), (problem.points[80:], problem.cameras[8]))
        self.assertEqual(end.observations, problem.observations)

    def test_bad_input(self):
        text = Bal().text()
        first, rest = text.split("\n", 1)
        packed = bz2.compress(text.encode())
        cases = {
            "lie.txt": ("9 80 1\n" + rest, ["lie.txt:"]),
            "huge.txt": ("2000000000 2000000000 2000000000\n" + rest, ["huge.txt:1: 2000000000 cameras", "bytes"]),
            "range.txt": (text.replace("\n0 0 ", "\n8 0 ", 1), ["range.txt:2: observation 0: camera: '8'", "0 to 7"]),
            "nan.txt": (text.rsplit("\n", 2)[0] + "\nnan\n", ["point 79: z: 'nan' is not allowed", "a number from"]),
            "cut.txt": (text[:len(text) // 2], ["cut.txt:", "the file ends before"]),
            "long.txt": (text + "1\n", ["long.txt:", "'1' is not allowed"]),
            "empty.txt": ("", ["empty.txt:1: the file ends before number of cameras"]),
            "cut.bz2": (packed[:-20], ["cut.bz2: cut off"]),
            "bad.bz2": (packed[:100] + b"?" * 50 + packed[150:], ["bad.bz2: damaged"]),
            "bomb.bz2": (bz2.compress(b" " * 50000000), ["bomb.bz2: unpacks to more than"]),
        }
        for name, (content, says) in cases.items():
            self.refused("adjust", self.file(name, content), "--out", self.out, says=says)
        good = self.file("p.txt", text)
        self.refused("adjust", self.folder / "missing", "--out", self.out, says=["missing: no such file"])
        for flag, value in (("--max-iterations", 0), ("--loss-scale", 0), ("--loss-scale", "nan")):
            self.refused("adjust", good, "--out", self.out, flag, value, says=[flag, value])
        self.assertNotEqual(run("adjust", good, "--out", self.out, "--method", "best").returncode, 0)
        self.refused("adjust", good, "--out", good, says=[good])
        self.assertFalse(self.out.exists())

    def test_input_is_never_overwritten(self):
        text = Bal().text()
        source = self.file("out/p.txt", text)
        self.refused("adjust", source, "--out", self.out, says=["overwrite the input", source])
        (self.folder / "link").symlink_to(self.out)
        self.refused("adjust", source, "--out", self.folder / "link", says=["overwrite the input"])
        self.assertEqual(source.read_text(), text)
        self.assertEqual([path.name for path in self.out.iterdir()], ["p.txt"])

    def test_nothing_to_adjust(self):
        behind = "2 1 2\n0 0 1 2\n1 0 1 2\n" + "0 0 0 0 0 9 1 0 0 " * 2 + "0 0 1"
        for text in ("0 0 0\n", "1 1 1\n0 0 1 2\n" + "1 " * 12, behind):
            done = run("adjust", self.file("p.txt", text), "--out", self.out)
            self.assertEqual((done.returncode, done.stdout), (3, ""), done.stderr)
            self.assertIn("p.txt: nothing to adjust", done.stderr.splitlines()[-1])

    def test_configuration(self):
        source = self.file("p.txt", Bal().text())
        config = self.file("c.yaml", "loss: cauchy\nloss-scale: 2.5\nmethod: local\n")
        report = self.adjust(source, "--config", config, "--method", "global")
        self.assertEqual((report["loss"], report["method"]), ({"name": "cauchy", "scale_px": 2.5}, "global"))
        again = self.adjust(source, "--config", self.out / "config.yaml")
        self.assertEqual(again["cost"], report["cost"])
        self.refused("adjust", source, "--out", self.out, "--config", self.file("d.yaml", "loss: none\nwindow: 3\n"),
                     says=["d.yaml", "window"])

    def test_interrupted(self):
        source = self.file("p.txt", Bal(cameras=150, points=3000, noise=2.0).text())
        command = [program.PROGRAM, "adjust", source, "--out", self.out, "--threads", "1"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            self.assertIn("iteration 1, cost", running.stderr.readline())
            running.send_signal(signal.SIGINT)
            running.communicate(timeout=60)
        self.assertEqual(running.returncode, 130)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["termination"], "interrupted")
        end = Bal.parsed((self.out / "p.txt").read_text())
        self.assertAlmostEqual(report["cost"]["final"], end.cost(), delta=1e-6 * end.cost())


class AdjustColmap(AdjustTest):
    def check(self, start, end, report):
        """The output against the definitions of the format."""
        errors = [end.residuals(p) for p in range(len(end.points))]
        self.assertAlmostEqual(report["cost"]["final"], 0.5 * sum(map(sum, errors)), delta=1e-6)
        initial = 0.5 * sum(sum(start.residuals(p)) for p in range(len(start.points)))
        self.assertAlmostEqual(report["cost"]["initial"], initial, delta=1e-9 * initial)
        self.assertLess(report["cost"]["final"], 0.1 * initial)
        for p, squares in enumerate(errors):
            mean = sum(map(math.sqrt, squares)) / len(squares)
            self.assertAlmostEqual(end.errors[p], mean, delta=1e-9)
        self.assertEqual(report["intrinsics"], "fixed")
        self.assertEqual((report["cameras"], report["keyframes"], report["points"]), (2, 6, 60))

    def test_text(self):
        source = Colmap().write_text(self.folder / "model")
        for method in ("global", "local", "hierarchical"):
            report = self.adjust(source, "--method", method)
            self.check(Colmap(), Colmap().adjusted(self.out / "sparse"), report)
        data = re.sub("#.*\n", "", (self.out / "sparse" / "cameras.txt").read_text())
        self.assertEqual(data, "1 SIMPLE_PINHOLE 640 480 500 320 240\n2 FOV 64 48 50 50 32 24 0.90000000000000002\n")
        lines = [line for line in (self.out / "sparse" / "images.txt").read_text().split("\n") if line[:1] != "#"]
        for image, line in zip(Colmap().images, lines[1::2]):
            words = line.split()
            keypoints = [(float(u), float(v), int(p)) for u, v, p in zip(words[0::3], words[1::3], words[2::3])]
            self.assertEqual(keypoints, image["keypoints"])

    def test_binary_holds_the_same_as_text(self):
        self.adjust(Colmap().write_text(self.folder / "text"))
        expected = Colmap().adjusted(self.out / "sparse")
        source = Colmap().write_binary(self.folder / "project" / "sparse" / "0")
        self.adjust(self.folder / "project")
        for p, error in enumerate(expected.errors):
            self.assertGreater(error, 0, p)
        points = (self.out / "sparse" / "points3D.bin").read_bytes()
        at, count = 8, struct.unpack_from("<Q", points)[0]
        self.assertEqual(count, 60)
        for p in range(count):
            identifier, x, y, z, r, g, b, error, length = struct.unpack_from("<Q3d3BdQ", points, at)
            self.assertEqual((identifier, [x, y, z], (r, g, b), error),
                             (100 + p, expected.points[p], expected.colours[p], expected.errors[p]))
            at += struct.calcsize("<Q3d3BdQ") + 8 * length
        self.assertEqual(at, len(points))
        self.assertEqual((self.out / "sparse" / "cameras.bin").read_bytes(), (source / "cameras.bin").read_bytes())
        images = (self.out / "sparse" / "images.bin").read_bytes()
        before = (source / "images.bin").read_bytes()
        self.assertEqual(len(images), len(before))
        first = struct.unpack_from("<I7dI", images, 8)
        self.assertEqual(list(first[1:8]), expected.images[0]["q"] + expected.images[0]["t"])
        end = 8 + 64 + 12 + 8 + 24 * 62  # the first image, of which only the pose may change
        self.assertEqual(images[72:end], before[72:end])

    def test_colmap_agrees(self):
        """The same costs in the same cameras before and after; the pixels are those of a pinhole."""
        if not shutil.which("colmap"):
            self.skipTest("colmap is not installed")
        model = Colmap()
        for image in model.images:
            image["name"] = image["name"].replace(" ", "_")  # COLMAP's text reader ends names at a space
        source = model.write_text(self.folder / "model")
        (self.folder / "theirs").mkdir()
        fixed = [f"--BundleAdjustment.refine_{what}=0" for what in ("focal_length", "principal_point", "extra_params")]
        for camera in ("RADIAL 640 480 500 320 240 0.01 -0.01", "OPENCV 640 480 500 505 320 240 0.01 -0.01 0.001 0.002",
                       "FULL_OPENCV 640 480 500 500 320 240 0.01 0 0.001 0 0 0.02 0 0",
                       "OPENCV_FISHEYE 640 480 520 520 320 240 0.3 0.1 0 0", "SIMPLE_PINHOLE 640 480 500 320 240"):
            (source / "cameras.txt").write_text(f"1 {camera}\n")
            report = self.adjust(source)
            done = subprocess.run(["colmap", "bundle_adjuster", f"--input_path={source}",
                                   f"--output_path={self.folder / 'theirs'}", *fixed], capture_output=True, text=True,
                                  check=True, timeout=120)
            costs = re.findall(r"cost : ([0-9.e+-]+) \[px\]", done.stdout + done.stderr)
            for ours, theirs in zip(("initial", "final"), map(float, costs), strict=True):
                root = math.sqrt(report["cost"][ours] / (2 * report["observations"]))
                self.assertAlmostEqual(root, theirs, delta=2e-5 * theirs, msg=camera)
        # Of the last camera, the mean error as COLMAP reads it from our files.
        done = subprocess.run(["colmap", "model_analyzer", "--path", self.out / "sparse"], capture_output=True,
                              text=True, check=True, timeout=60)
        mean = float(re.search(r"Mean reprojection error: ([0-9.]+)px", done.stdout + done.stderr).group(1))
        end = model.adjusted(self.out / "sparse")
        expected = sum(map(math.sqrt, (s for p in range(60) for s in end.residuals(p)))) / report["observations"]
        self.assertAlmostEqual(mean, expected, delta=1e-5)

    def test_points_seen_once_stay(self):
        model = Colmap()
        for image, keypoint in model.tracks[7][1:]:
            u, v, _ = model.images[image - 10]["keypoints"][keypoint]
            model.images[image - 10]["keypoints"][keypoint] = (u, v, -1)
        model.tracks[7] = model.tracks[7][:1]
        before = list(model.points[7])
        report = self.adjust(model.write_text(self.folder / "model"))
        self.assertEqual(report["left_out"], {"images": 0, "points": 1})
        end = model.adjusted(self.out / "sparse")
        self.assertEqual((end.points[7], end.errors[7]), (before, -1))

    def test_bad_input(self):
        source = Colmap().write_text(self.folder / "model")
        def refused(file, old, new, says):
            path = source / file
            text = path.read_text()
            self.assertIn(old, text)
            path.write_text(text.replace(old, new, 1))
            self.refused("adjust", source, "--out", self.out, says=says)
            path.write_text(text)
        refused("cameras.txt", "SIMPLE_PINHOLE", "SIMPLE_HOLE",
                ["cameras.txt:1: MODEL: 'SIMPLE_HOLE'", "OPENCV_FISHEYE"])
        refused("cameras.txt", "1 SIMPLE_PINHOLE 640 480 500.0 320.0 240.0", "1 FOV 640 480 1 1 1 1 1", ["FOV"])
        refused("cameras.txt", "2 FOV", "1 FOV", ["camera 1: a second time"])
        refused("cameras.txt", "1 SIMPLE", "3 SIMPLE", ["images.txt: image 10: camera 1"])
        refused("images.txt", "\n11 ", "\n10 ", ["image 10: a second time"])
        refused("points3D.txt", "100 ", "101 ", ["points3D.txt"])
        refused("points3D.txt", " 10 1 ", " 10 1000 ", ["point 100: image 10 keypoint 1000", "62 keypoints"])
        (source / "points3D.txt").unlink()
        self.refused("adjust", source, "--out", self.out, says=["points3D.txt: no such file"])
        self.refused("adjust", self.folder, "--out", self.out, says=["no model in this folder"])
        self.assertFalse(self.out.exists())

    def test_input_is_never_overwritten(self):
        source = Colmap().write_text(self.out / "sparse")
        before = (source / "images.txt").read_text()
        for given in (source, self.out):
            self.refused("adjust", given, "--out", self.out, says=["overwrite the input"])
        self.assertEqual((source / "images.txt").read_text(), before)

    def test_nothing_to_adjust(self):
        model = Colmap(points=0)
        done = run("adjust", model.write_text(self.folder / "model"), "--out", self.out)
        self.assertEqual((done.returncode, done.stdout), (3, ""))
        self.assertIn("nothing to adjust", done.stderr)


if __name__ == "__main__":
    program.main()
