"""The subcommand `solve` on point tracks: solve_test.py PROGRAM [unittest arguments]. Pixels are those of a camera
computed here; the same camera is the truth."""
import csv
import json
import math
import random
import shutil
import subprocess
import unittest

import program
from program import ProgramTest, run

WIDTH, HEIGHT = 800, 600
CENTRE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)


def cross(a, b):
    return [a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3] for i in range(3)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    return [x / math.sqrt(dot(a, a)) for x in a]


class Scene:
    """Points in a ball, or in a plane, and cameras around them that look at places near the middle."""

    def __init__(self, images=9, points=90, flat=False, standing=False):
        rng = random.Random(4)
        self.points = [[rng.uniform(-1, 1), rng.uniform(-1, 1), 0 if flat else rng.uniform(-1, 1)] for _ in range(points)]
        self.cameras = []
        for j in range(images):
            a = 0.25 * j
            at = [0, 0, -5] if standing else [4 * math.sin(a), 0.7 * math.sin(2.3 * a), -5 - 0.8 * math.sin(1.7 * a)]
            look = [0.5 * math.sin(3 * a), 0.4 * math.cos(2 * a), 0.2]
            up = [math.sin(0.2 * j), math.cos(0.2 * j), 0.1]
            z = unit([p - c for p, c in zip(look, at)])
            x = unit(cross(up, z))
            self.cameras.append((at, [x, cross(z, x), z]))

    def rows(self, focal, noise=0.3):
        """Image, point, u, v; `focal` of an image's number."""
        rng = random.Random(7)
        for j, (at, axes) in enumerate(self.cameras):
            for i, point in enumerate(self.points):
                x, y, z = (dot(axis, [p - c for p, c in zip(point, at)]) for axis in axes)
                yield (j, i, focal(j) * x / z + CENTRE[0] + rng.gauss(0, noise),
                       focal(j) * y / z + CENTRE[1] + rng.gauss(0, noise))


def text(rows):
    return "image,point,u,v\n" + "".join("%d,%d,%.6f,%.6f\n" % row for row in rows)


class SolveTest(ProgramTest):
    def solved(self, content, *arguments):
        """Report and lenses by image."""
        done = run("solve", self.file("tracks.csv", content), "--size", f"{WIDTH}x{HEIGHT}", "--out", self.folder / "out",
                   *arguments)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(self.folder / "out" / "lens.csv", encoding="utf-8") as file:
            lenses = list(csv.DictReader(file))
        return json.loads((self.folder / "out" / "report.json").read_text()), lenses

    def impossible(self, content, *says, arguments=()):
        done = run("solve", self.file("tracks.csv", content), "--size", f"{WIDTH}x{HEIGHT}", "--out", self.folder / "out",
                   *arguments)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        for word in says:
            self.assertIn(word, done.stderr)
        self.assertFalse((self.folder / "out" / "trajectory.txt").exists())

    def test_fixed_lens(self):
        scene = Scene()
        report, lenses = self.solved(text(scene.rows(lambda j: 900)))
        self.assertIn("fixed", json.dumps(report["lens"]))
        self.assertIsNone(report["degenerate"])
        self.assertEqual(report["frames"], report["frames"] | {"total": 9, "posed": 9})
        self.assertEqual(len(lenses), 9)
        for lens in lenses:
            self.assertAlmostEqual(float(lens["fx"]), 900, delta=9)
            self.assertEqual(lens["fx"], lenses[0]["fx"])
        self.assertLess(report["rms_reprojection_px"], 0.45)

    def test_zooming_lens(self):
        focal = lambda j: 700 + 60 * j
        report, lenses = self.solved(text(Scene().rows(focal)))
        self.assertIn("zooming", json.dumps(report["lens"]))
        for j, lens in enumerate(lenses):
            self.assertAlmostEqual(float(lens["fx"]) / focal(j), 1, delta=0.02)

    def test_the_report_has_all_digits_of_the_lenses(self):
        for focal, count in ((lambda j: 700 + 60 * j, 9), (lambda j: 900, 1)):
            report, lines = self.solved(text(Scene().rows(focal)))
            self.assertEqual(len(report["lenses"]), count)
            found = {}
            for lens in report["lenses"]:
                self.assertEqual(lens["resolution"], [WIDTH, HEIGHT])
                for first, last in lens["frames"]:
                    found |= {frame: lens for frame in range(first, last + 1)}
            self.assertEqual(sorted(found), list(range(9)))
            for frame, line in enumerate(lines):
                numbers = [float(line[name]) for name in ("fx", "fy", "cx", "cy", "skew")]
                self.assertEqual([round(v, 6) for v in found[frame]["value"]], numbers)
                self.assertAlmostEqual(found[frame]["sigma"][0] / float(line["fx_sigma"]), 1, delta=1e-5)

    @unittest.skipUnless(shutil.which("colmap"), "colmap is not installed")
    def test_colmap_opens_the_model(self):
        for focal, cameras in ((lambda j: 700 + 60 * j, 9), (lambda j: 900, 1)):
            report, _ = self.solved(text(Scene().rows(focal)))
            done = subprocess.run(["colmap", "model_analyzer", "--path", self.folder / "out/sparse"], capture_output=True,
                                  text=True, check=True, timeout=60)
            said = done.stdout + done.stderr
            for what, count in (("Cameras", cameras), ("Registered images", 9), ("Points", report["points"]),
                                ("Observations", report["observations"])):
                self.assertRegex(said, rf"\b{what}: {count}\b")

    def test_trajectory_has_the_shape_of_the_truth(self):
        scene = Scene()
        self.solved(text(scene.rows(lambda j: 900)))
        lines = (self.folder / "out" / "trajectory.txt").read_text().splitlines()
        found = [list(map(float, line.split()[1:4])) for line in lines if not line.startswith("#")]
        self.assertEqual(len(found), 9)
        truth = [camera[0] for camera in scene.cameras]
        ratios = [math.dist(found[i], found[j]) / math.dist(truth[i], truth[j]) for i in range(9) for j in range(i)]
        self.assertLess(max(ratios) / min(ratios), 1.03)

    def test_same_result_for_any_number_of_threads(self):
        content = text(Scene().rows(lambda j: 700 + 60 * j))
        written = []
        for threads in (1, 2, 3):
            self.solved(content, "--threads", threads)
            written.append([(self.folder / "out" / name).read_bytes() for name in ("lens.csv", "trajectory.txt", "points.ply")])
        self.assertEqual(written[0], written[1])
        self.assertEqual(written[0], written[2])

    def test_outliers_do_no_harm(self):
        rng = random.Random(3)
        rows = [row if rng.random() > 0.1 else row[:2] + (rng.uniform(0, WIDTH), rng.uniform(0, HEIGHT))
                for row in Scene().rows(lambda j: 900)]
        _, lenses = self.solved(text(rows))
        for lens in lenses:
            self.assertAlmostEqual(float(lens["fx"]), 900, delta=18)

    def test_what_tells_no_lens_is_named(self):
        self.impossible(text(Scene(flat=True).rows(lambda j: 900)), "planar")
        self.impossible(text(Scene(standing=True).rows(lambda j: 900)), "rotation")
        self.impossible(text(row for row in Scene().rows(lambda j: 900) if row[0] == 0), "image")
        self.impossible(text(row for row in Scene().rows(lambda j: 900) if row[1] < 5), "point")

    def test_images_that_show_nothing(self):
        """One after the other lighter, and all alike: by themselves, as photos, and one alone."""
        for i in range(5):
            for kind, grey in (("lighter", 200 + i), ("alike", 90)):
                self.file(f"{kind}/{i}.pgm", b"P5 320 240 255\n" + bytes([grey]) * (320 * 240))
        self.file("one/0.pgm", (self.folder / "alike/0.pgm").read_bytes())
        for images, flags, says in (("lighter", [], "no point is seen in two of its 5 images"), ("alike", [], "no motion: 5 frames"),
                                    ("alike", ["--images", "photos"], "no point is seen in two of its 5 images"),
                                    ("one", [], "no point is seen in two of its 1 images")):
            done = run("solve", self.folder / images, *flags, "--out", self.folder / "out", "--quiet")
            self.assertEqual((done.returncode, done.stderr.count("\n")), (3, 1), done.stderr)
            self.assertIn(says, done.stderr)

    def test_bad_tracks(self):
        rows = list(Scene(images=3, points=20).rows(lambda j: 900))
        out = self.folder / "out"

        def refused(content, *says):
            path = self.file("bad.csv", content)
            self.refused("solve", path, "--size", "800x600", "--out", out, says=[path, *says])

        refused(text(rows) + "1,3,nan,5\n", ":62", "nan")
        refused(text(rows) + "1,3,5,6\n", ":62", "1", "3")
        refused(text(rows) + "1,3,5\n", ":62")
        refused("frame,u,v\n1,2,3\n", "image,point,u,v")
        refused("", "image,point,u,v")
        self.assertFalse(out.exists())

    def test_pixels_outside_the_given_size(self):
        rows = "".join(f"{i},{p},{20 + 30 * p},{100 + 7 * p + i}\n" for i in range(3) for p in range(20))
        for mark in ("", "\ufeff"):
            tracks = self.file("tracks.csv", mark + "image,point,u,v\n" + rows)
            self.refused("solve", tracks, "--size", "1x1", "--out", self.folder / "out", "--quiet",
                         says=["--size = '1x1'", "60 of 60 pixels", "outside"])
        self.refused("solve", tracks, "--fps", "nan", "--out", self.folder / "out", "--quiet", says=["fps", "nan"])

    def test_bad_settings(self):
        path = self.file("tracks.csv", text(Scene(images=3, points=20).rows(lambda j: 900)))
        for arguments, says in ((("--lens", "wide"), ("lens", "wide", "fixed")), (("--size", "800"), ("size", "800")),
                                (("--method", "magic"), ("method", "magic", "polished"))):
            self.refused("solve", path, "--out", self.folder / "out", *arguments, says=says)

    CAMERA = f"""raysfm_camera: 1
cameras:
  - name: known
    model: pinhole
    resolution: [{WIDTH}, {HEIGHT}]
    intrinsics: {{fx: 900, fy: 900, cx: {CENTRE[0]}, cy: {CENTRE[1]}}}
"""

    def test_known_camera(self):
        scene = Scene(points=300)
        tracks = self.file("tracks.csv", text(scene.rows(lambda j: 900)))
        camera = self.file("camera.yaml", self.CAMERA)
        done = run("solve", tracks, "--camera", camera, "--out", self.folder / "out")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.folder / "out" / "report.json").read_text())
        self.assertEqual(report["frames"], report["frames"] | {"total": 9, "posed": 9})
        self.assertEqual(report["lens_source"], "camera file")
        self.assertFalse((self.folder / "out" / "lens.csv").exists())
        lines = (self.folder / "out" / "trajectory.txt").read_text().splitlines()
        poses = [[float(x) for x in line.split()] for line in lines if not line.startswith("#")]
        # Distances between cameras, of which one is the unit of length.
        unit_of_truth = math.dist(scene.cameras[0][0], scene.cameras[8][0])
        unit_found = math.dist(poses[0][1:4], poses[8][1:4])
        for j in range(1, 8):
            self.assertAlmostEqual(math.dist(poses[0][1:4], poses[j][1:4]) / unit_found,
                                   math.dist(scene.cameras[0][0], scene.cameras[j][0]) / unit_of_truth, delta=0.005)

    def test_what_a_known_camera_does_not_go_with(self):
        tracks = self.file("tracks.csv", text(Scene(images=3, points=20).rows(lambda j: 900)))
        camera = self.file("camera.yaml", self.CAMERA)
        two = self.file("two.yaml", self.CAMERA + self.CAMERA.split("cameras:\n")[1].replace("known", "other"))
        for arguments, says in ((("--camera", self.folder / "none.yaml"), ("none.yaml", "no such file")),
                                (("--camera", two), ("two.yaml", "2 cameras", "track")),
                                (("--camera", camera, "--lens", "zoom"), ("--lens zoom", "--camera")),
                                (("--camera", camera, "--images", "video"), ("--images video", "track")),
                                (("--camera", camera, "--size", "640x480"), ("--size", "640x480", "800x600"))):
            self.refused("solve", tracks, "--out", self.folder / "out", *arguments, says=says)


if __name__ == "__main__":
    program.main()
