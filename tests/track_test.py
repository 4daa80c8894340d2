"""`raysfm track` as its users meet it: track_test.py PROGRAM [unittest arguments]."""
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

import program
from program import ProgramTest, run

CAMERA = """raysfm_camera: 1
cameras:
  - name: front
    model: pinhole
    resolution: [64, 48]
    intrinsics: {fx: 50, fy: 50, cx: 31.5, cy: 23.5}
"""
OUTPUT = ["trajectory.txt", "keyframes.txt", "covariance.csv", "points.ply", "report.json", "config.yaml",
          "sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin"]
NOBODY = 65534
SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"))
STREET = None  # a sequence of 60 frames, 512 x 384 pixels


def setUpModule():
    global STREET
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    STREET = pathlib.Path(folder.name) / "street"
    done = run("synth", "street", "--frames", 60, "--fps", 7.5, "--length", 9.4, "--out", STREET, "--quiet")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


class TrackTest(ProgramTest):
    def setUp(self):
        super().setUp()
        self.camera = self.file("camera.yaml", CAMERA)
        self.out = self.folder / "out"

    def image(self, name, size=(64, 48), level=lambda x, y: (7 * x + 13 * y) % 256):
        width, height = size
        pixels = bytes(level(x, y) for y in range(height) for x in range(width))
        return self.file(name, b"P5 %d %d 255\n" % size + pixels)

    def images(self, name, count, size=(64, 48), level=lambda x, y: (7 * x + 13 * y) % 256):
        for i in range(count):
            self.image(f"{name}/{i:03}.pgm", size, level)
        return self.folder / name

    def video(self, name, *options):
        """The street as a video."""
        path = self.folder / name
        subprocess.run(["ffmpeg", "-loglevel", "error", "-framerate", "7.5", "-i", STREET / "images" / "%06d.png",
                        "-c:v", "libx264", "-crf", "20", *options, path], check=True)
        return path

    def street_camera(self, name, *replacements):
        text = (STREET / "camera.yaml").read_text()
        for old, new in replacements:
            self.assertIn(old, text)
            text = text.replace(old, new)
        return self.file(name, text)

    def track(self, source, *arguments, out=None):
        return run("track", source, "--out", out or self.out, "--quiet", *arguments)

    def error(self, out):
        """Mean error of a reconstruction of the street in metres."""
        return json.loads(run("eval", out, STREET, "--json").stdout)["ate"]["mean"]

    def only_turns(self, report):
        """No map, and no frame whose place is known."""
        self.assertEqual(report["points"], 0)
        held = sum(run["last"] - run["first"] + 1 for run in report["frames"]["place_held"])
        self.assertEqual(report["frames"]["posed"], held)

    def complete(self, out):
        """The files of an output folder are all there and nothing else is; returns the report."""
        found = {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}
        self.assertEqual(found - {"report.html"}, set(OUTPUT))  # page_test.py looks at that
        poses = [line.split() for line in (out / "trajectory.txt").read_text().splitlines() if line[0] != "#"]
        self.assertLessEqual({len(pose) for pose in poses}, {8})
        report = json.loads((out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], len(poses))
        return report


class Success(TrackTest):
    def test_a_map_that_never_grew_is_told(self):
        film = self.folder / "film"
        (film / "images").mkdir(parents=True)
        for i in range(23):  # it moves for eight frames, and stands
            shutil.copy(STREET / "images" / f"{min(i, 7):06}.png", film / "images" / f"{i:06}.png")
        said = "the map is that of the three views which started it, and none of 23 frames has added to it"
        for images, told in ((film / "images", True), (STREET / "images", False)):
            done = run("track", images, "--camera", STREET / "camera.yaml", "--fps", 7.5, "--out", self.out)
            self.assertEqual(done.returncode, 0, done.stderr)
            warnings = json.loads((self.out / "report.json").read_text())["warnings"]
            self.assertEqual((said in done.stderr, any(said in w for w in warnings)), (told, told), done.stderr)

    def test_street(self):
        done = self.track(STREET)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        report = self.complete(self.out)
        self.assertEqual(report["frames"]["total"], 60)
        self.assertEqual(report["frames"]["posed"], 60)
        self.assertEqual(report["camera_class"], "central")
        self.assertEqual(report["error"], "pixel")
        self.assertEqual(report["scale"], "arbitrary")
        self.assertEqual(len(report["segments"]), 1)
        self.assertLess(report["rms_reprojection_px"], 1)
        self.assertGreater(report["timing"]["frames_per_second"], 0)
        done = run("eval", self.out, STREET, "--json")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        result = json.loads(done.stdout)
        self.assertEqual(result["coverage"], 1)
        self.assertAlmostEqual(result["length_m"], 9.4, delta=0.3)
        self.assertLess(result["ate"]["mean"], 0.01 * result["length_m"])

    def test_threads_change_nothing(self):
        for threads in (1, 2, 4):
            done = self.track(STREET, "--threads", threads, out=self.folder / str(threads))
            self.assertEqual(done.returncode, 0, done.stderr)
        for name in set(OUTPUT) - {"report.json", "config.yaml"}:
            content = [(self.folder / str(threads) / name).read_bytes() for threads in (1, 2, 4)]
            self.assertEqual(content[0], content[1], name)
            self.assertEqual(content[0], content[2], name)

    def test_configuration_runs_again_identically(self):
        first, second, third = (self.folder / name for name in ("first", "second", "third"))
        config = self.file("config.yaml", "features: 800\nseed: 3\nwindow: 8\nfinal: global\n")
        self.assertEqual(self.track(STREET, "--config", config, "--window", 7, out=first).returncode, 0)
        effective = (first / "config.yaml").read_text()
        for line in ("features: 800", "seed: 3", "window: 7", 'final: "global"'):
            self.assertIn("\n" + line + "\n", effective)
        self.assertEqual(self.track(STREET, "--config", first / "config.yaml", out=second).returncode, 0)
        again = self.folder / "again"
        done = run("track", "--config", first / "config.yaml", "--out", again, "--quiet")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertEqual((first / "trajectory.txt").read_bytes(), (again / "trajectory.txt").read_bytes())
        for name in set(OUTPUT) - {"report.json"}:
            self.assertEqual((first / name).read_bytes(), (second / name).read_bytes(), name)
        self.assertEqual(self.track(STREET, "--config", config, "--window", 7, "--seed", 4, out=third).returncode, 0)
        self.assertIn("\nseed: 4\n", (third / "config.yaml").read_text())
        self.assertNotEqual((first / "trajectory.txt").read_bytes(), (third / "trajectory.txt").read_bytes())

    def test_given_camera_wins(self):
        sequence = self.folder / "sequence"
        sequence.mkdir()
        (sequence / "images").symlink_to(STREET / "images")
        self.file("sequence/camera.yaml", "no camera file\n")
        self.refused("track", sequence, "--out", self.out, says=["sequence/camera.yaml"])
        done = run("track", sequence, "--camera", STREET / "camera.yaml", "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("camera.yaml is not used", done.stderr)

    def test_part_of_the_image(self):
        """The same as if the images had been cut out beforehand."""
        size = ("resolution: [512, 384]", "resolution: [448, 352]")
        whole = self.street_camera("whole.yaml", size)
        part = self.street_camera("part.yaml", (size[0], size[1] + "\n    roi: [32, 16, 448, 352]"))
        (self.folder / "cut").mkdir()
        subprocess.run(["ffmpeg", "-loglevel", "error", "-i", STREET / "images" / "%06d.png", "-vf", "crop=448:352:32:16",
                        "-start_number", "0", self.folder / "cut" / "%06d.png"], check=True)
        self.assertEqual(self.track(self.folder / "cut", "--camera", whole, out=self.folder / "expected").returncode, 0)
        self.assertEqual(self.track(STREET / "images", "--camera", part).returncode, 0)
        for name in set(OUTPUT) - {"report.json", "config.yaml"}:
            self.assertEqual((self.out / name).read_bytes(), (self.folder / "expected" / name).read_bytes(), name)

    def test_mask(self):
        self.image("mask.pgm", (512, 384), lambda x, y: 0)
        camera = self.street_camera("masked.yaml", ("    model:", "    mask: mask.pgm\n    model:"))
        done = self.track(STREET, "--camera", camera)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn("too few corners", done.stderr)
        self.image("mask.pgm", (512, 384), lambda x, y: 255 if y < 330 else 0)
        self.assertEqual(self.track(STREET, "--camera", camera).returncode, 0)
        self.assertLess(self.error(self.out), 0.1)

    def test_output_beside_the_input(self):
        sequence = self.folder / "sequence"
        shutil.copytree(STREET, sequence)
        self.assertEqual(self.track(sequence, out=sequence).returncode, 0)
        for path in STREET.rglob("*"):
            if path.is_file():
                self.assertEqual(path.read_bytes(), (sequence / path.relative_to(STREET)).read_bytes(), path)
        self.assertEqual(self.track(sequence, out=sequence).returncode, 0)

    def test_refined_camera_file(self):
        """A calibration that lacks a distortion is written as refined, and leaves the given file alone."""
        source = SHARED / "kitti07-mono"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        self.assertEqual(self.track(source).returncode, 0)
        numbers = json.loads((self.out / "report.json").read_text())["calibration"]
        k1 = next(n for n in numbers if n["name"] == "k1")
        self.assertTrue(k1["told"])
        self.assertEqual(k1["given"], 0)
        self.assertGreater(k1["refined"], 0.01)
        self.assertIn(f"k1: {k1['refined']}", (self.out / "camera.yaml").read_text())
        self.assertIn("camera.yaml", json.loads((self.out / "report.json").read_text())["files"])
        kept = self.folder / "kept"
        self.assertEqual(self.track(source, "--refine-lens", "off", out=kept).returncode, 0)
        self.assertFalse((kept / "camera.yaml").exists())
        beside = self.folder / "camera.yaml"
        beside.write_bytes((source / "camera.yaml").read_bytes())
        self.assertEqual(self.track(source, "--camera", beside, out=self.folder).returncode, 0)
        self.assertEqual(beside.read_bytes(), (source / "camera.yaml").read_bytes())
        self.assertTrue((self.folder / "camera-refined.yaml").exists())

    def test_a_rolling_shutter_that_is_found_late(self):
        """What was tracked before is tracked again with it: as well as where the camera file tells it."""
        camera = self.file("phone.yaml", """raysfm_camera: 1
cameras:
  - {name: c, model: pinhole, resolution: [480, 270], intrinsics: {fx: 360, fy: 360, cx: 239.5, cy: 134.5}}
""")
        film = self.folder / "film"
        done = run("synth", "room", "--motion", "handheld", "--frames", 150, "--readout", 33, "--samples", 1, "--noise", 2,
                   "--camera", camera, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        # Until the end there are too few key frames to ask in the first four seconds.
        for seconds, frames in ((4, 61), (10, 150)):
            error = {}
            for lens in (camera, film / "camera.yaml"):
                done = run("track", film, "--camera", lens, "--to", seconds, "--out", self.out)
                self.assertEqual(done.returncode, 0, done.stderr)
                report = json.loads((self.out / "report.json").read_text())
                self.assertEqual(report["frames"]["posed"], frames)
                self.assertEqual("all is tracked again with it" in done.stderr, lens == camera, done.stderr)
                error[lens] = json.loads(run("eval", self.out, film, "--json").stdout)["ate"]["mean"]
                if lens == camera:
                    readout = next(n for n in report["calibration"] if n["name"] == "readout_down")
                    self.assertEqual((readout["given"], readout["told"]), (0, True))
                    self.assertAlmostEqual(readout["refined"] / 0.033, 1, delta=0.1)
                    self.assertIn("direction: down", (self.out / "camera.yaml").read_text())
            self.assertLess(error[camera], 1.5 * error[film / "camera.yaml"], seconds)
        done = run("track", film, "--camera", camera, "--to", 4, "--save-map", self.folder / "map.db", "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertNotIn("all is tracked again", done.stderr)
        self.assertIn("with --save-map nothing is tracked again", done.stderr)

    def test_a_rolling_shutter_that_few_points_do_not_tell(self):
        camera = self.file("fisheye.yaml", """raysfm_camera: 1
cameras:
  - {name: c, model: kannala-brandt, resolution: [640, 480], intrinsics: {fx: 303.2, fy: 303.2, cx: 316, cy: 243, k1: 0.02}}
""")
        film = self.folder / "film"
        done = run("synth", "street", "--motion", "walk", "--frames", 120, "--fps", 10, "--length", 9.8, "--readout", 10,
                   "--samples", 1, "--noise", 1, "--camera", camera, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.track(film, "--camera", camera).returncode, 0)
        numbers = json.loads((self.out / "report.json").read_text())["calibration"]
        self.assertAlmostEqual(next(n for n in numbers if n["name"] == "readout_down")["refined"] / 0.01, 1, delta=0.15)

    def test_a_lens_that_is_not_that_of_the_footage(self):
        """A map made with it says nothing against it: the footage does, and its own lens takes the place of the given one."""
        source = SHARED / "tsukuba-mono"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        given = (source / "camera.yaml").read_text()
        wrong = self.file("wrong.yaml", re.sub(r"(fx|fy): ([\d.]+)", lambda m: f"{m[1]}: {1.3 * float(m[2])}", given))
        error = {}
        for name, camera in (("right", source / "camera.yaml"), ("wrong", wrong)):
            done = run("track", source, "--camera", camera, "--out", self.folder / name)
            self.assertEqual(done.returncode, 0, done.stderr)
            result = json.loads(run("eval", self.folder / name, source / "truth.txt", "--json").stdout)
            error[name] = result["ate"]["mean"] / result["length_m"]
            warnings = json.loads((self.folder / name / "report.json").read_text())["warnings"]
            if name == "right":
                self.assertEqual(warnings, [])
        said = re.match(r"the lens is another one than that of the camera file: .* (\d+) px, not 800 px, and is tracked with its own",
                        warnings[0])
        self.assertLess(abs(int(said[1]) / 615 - 1), 0.03)
        self.assertIn(f"warning: {warnings[0]}", done.stderr)
        report = json.loads((self.folder / "wrong" / "report.json").read_text())
        self.assertEqual((report["lens_source"], report["frames"]["posed"]), ("footage", 100))
        self.assertLess(error["wrong"], 2 * error["right"])

    def test_lenses_of_a_rig_and_of_a_mirror_that_are_not_theirs(self):
        """All of a rig's, the second one's alone, a mirror's: tracked with what the footage tells, as well as with the right file."""
        for name, factor, cameras, limit in (("tri-rig", 0.7, (0, 1, 2), 0.0004), ("tri-rig", 1.25, (1,), 0.0004),
                                             ("mirror", 1.4, (0,), 0.004)):
            source = SHARED / "rendered" / name
            if not source.exists():
                self.skipTest(f"{source} is missing")
            parts = (source / "camera.yaml").read_text().split("- name:")
            for c in cameras:
                parts[1 + c] = re.sub(r"(fx|fy): ([\d.]+)", lambda m: f"{m[1]}: {factor * float(m[2])}", parts[1 + c])
            wrong = self.file("wrong.yaml", "- name:".join(parts))
            done = run("track", source, "--camera", wrong, "--out", self.out)
            self.assertEqual(done.returncode, 0, done.stderr)
            report = json.loads((self.out / "report.json").read_text())
            self.assertIn("another one than that of the camera file: the footage tells a focal length of", report["warnings"][0])
            for c in cameras:
                focal = next(n for n in report["calibration"] if n["name"] == "fx" and n["camera"] == c)["refined"]
                self.assertLess(abs(focal / (1640 if name == "mirror" else 270) - 1), 0.01)
            result = json.loads(run("eval", self.out, source / "truth.txt", "--json").stdout)
            self.assertLess(result["ate"]["mean"] / result["length_m"], limit)
            if name == "tri-rig":
                self.assertEqual(report["scale"], "metric")
                self.assertLess(abs(result["scale"] - 1), 0.02)

    def test_cameras_that_do_not_see_the_same(self):
        """A straight drive tells no focal length: that one lens of a pair is wrong shows in what they do not share, and no scale is told."""
        source = SHARED / "kitti06-stereo"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        left, right = (source / "camera.yaml").read_text().split("- name: right")
        wrong = self.file("wrong.yaml", left + "- name: right" + right.replace("707.0912", "883.864"))
        report = {}
        for name, camera in (("right", source / "camera.yaml"), ("wrong", wrong)):
            self.assertEqual(self.track(source, "--camera", camera, out=self.folder / name).returncode, 0)
            report[name] = json.loads((self.folder / name / "report.json").read_text())
        self.assertEqual((report["right"]["warnings"], report["right"]["scale"]), ([], "metric"))
        self.assertIn("that should see it too do not", report["wrong"]["warnings"][0])
        self.assertEqual(report["wrong"]["scale"], "arbitrary")

    def test_frames_follow_when_all_is_adjusted(self):
        """Two cameras whose focal lengths are wrong: what that bent between key frames straightens with them."""
        film, camera = self.folder / "film", self.folder / "camera.yaml"
        recipe = pathlib.Path(__file__).resolve().parents[1] / "scripts" / "recipes" / "rig-scale-stereo.yaml"
        done = run("synth", "--config", recipe, "--motion", "look", "--seed", 1, "--length", 3, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)

        def steadiness(*flags):
            out = self.folder / "out"
            shutil.rmtree(out, ignore_errors=True)
            done = run("track", film, "--out", out, "--quiet", "--final", "global", *flags)
            self.assertEqual(done.returncode, 0, done.stderr)
            lines = [line for line in (out / "trajectory.txt").read_text().splitlines() if line[0] != "#"]
            at = [[float(word) for word in line.split()[1:4]] for line in lines]
            steps = sorted(math.dist(a, b) for a, b in zip(at, at[1:]))
            bends = [math.dist([x + z for x, z in zip(a, c)], [2 * y for y in b]) for a, b, c in zip(at, at[1:], at[2:])]
            return max(bends) / steps[len(steps) // 2]

        text = re.sub(r"fx: ([\d.]+), fy: ([\d.]+)",
                      lambda focal: f"fx: {0.98 * float(focal[1])}, fy: {0.98 * float(focal[2])}", (film / "camera.yaml").read_text())
        camera.write_text(text)
        self.assertLess(steadiness("--camera", camera), 1.3 * steadiness())

    def test_a_quick_turn_that_ends(self):
        """Its blur draws corners out to streaks, whose ends draw in as the turn slows down: no start is made of that."""
        film, camera = self.folder / "film", self.folder / "turn.yaml"
        camera.write_text("raysfm_camera: 1\ncameras:\n  - name: camera\n    model: radtan\n    resolution: [640, 360]\n"
                          "    intrinsics: {fx: 492.5, fy: 492.5, cx: 322, cy: 176, k1: 0.06, k2: -0.12, p1: 0, p2: 0}\n")
        done = run("synth", "corridor", "--camera", camera, "--motion", "loop", "--length", 40, "--rounds", 0.0417,
                   "--frames", 40, "--fps", 30, "--blur", 0.012, "--noise", 2, "--samples", 1, "--seed", 3, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = run("track", film, "--camera", camera, "--out", self.folder / "out", "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        judged = json.loads(run("eval", self.folder / "out", film / "truth.txt", "--json").stdout)
        self.assertLess(judged["ate"]["rmse"], 0.02)
        self.assertGreater(judged["coverage"], 0.8)

    def film_judged(self, camera, *synth, told):
        """Of a rendered film that was tracked, with the camera it was filmed with or nothing told."""
        film, file = self.folder / "film", self.folder / "filmed.yaml"
        file.write_text(f"raysfm_camera: 1\ncameras:\n  - {{name: c, {camera}}}\n")
        done = run("synth", *synth, "--camera", file, "--samples", 1, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        if not told:
            (film / "camera.yaml").unlink()
        self.assertEqual(self.track(film).returncode, 0)
        return json.loads(run("eval", self.out, film, "--json").stdout)

    def test_small_pictures_with_noise(self):
        """No three of them have a parallax of many times its error."""
        judged = self.film_judged("model: pinhole, resolution: [320, 240], intrinsics: {fx: 256, fy: 256, cx: 159.5, cy: 119.5}",
                                  "street", "--motion", "drive", "--fps", 10, "--frames", 60, "--length", 25, "--noise", 5, told=True)
        self.assertEqual(judged["coverage"], 1)
        self.assertLess(judged["ate"]["mean"], 0.001 * judged["length_m"])

    def test_drives_with_a_rolling_shutter(self):
        """Adjusted as a whole, the map of a drive is bent by matches that are wrong by less than an inlier may be."""
        errors = []
        for seed in (1, 4):
            judged = self.film_judged("model: pinhole, resolution: [320, 240], intrinsics: {fx: 260, fy: 260, cx: 159.5, cy: 119.5}",
                                      "town", "--motion", "drive", "--fps", 10, "--frames", 120, "--length", 60, "--noise", 2,
                                      "--readout", 33, "--seed", seed, told=True)
            errors.append(judged["ate"]["mean"] / judged["length_m"])
            shutil.rmtree(self.folder / "film")
            shutil.rmtree(self.out)
        self.assertLess(sum(errors) / 2, 0.0003)

    def test_a_wide_lens_held_upright(self):
        """Of a phone that looks about, with a rolling shutter; nobody tells what it is."""
        judged = self.film_judged("model: kannala-brandt, resolution: [450, 800], "
                                  "intrinsics: {fx: 382, fy: 382, cx: 223.6, cy: 407.2, k1: -0.0082, k2: 0, k3: 0, k4: 0}",
                                  "corridor", "--motion", "look", "--fps", 30, "--frames", 60, "--length", 2.4, "--noise", 2,
                                  "--readout", 30, "--seed", 300, told=False)
        self.assertEqual(judged["coverage"], 1)
        self.assertLess(judged["ate"]["mean"], 0.0005 * judged["length_m"])

    def test_a_lens_that_is_far_from_all_guesses(self):
        """Of 25 degrees, which no stretch tells: tracking gets there step by step, from both sides."""
        judged = self.film_judged("model: radtan, resolution: [320, 240], "
                                  "intrinsics: {fx: 721.7, fy: 721.7, cx: 160.4, cy: 118.5, k1: -0.2395, k2: 0.0323, p1: 0, p2: 0}",
                                  "corridor", "--motion", "walk", "--fps", 30, "--frames", 100, "--length", 4.67, "--noise", 3,
                                  "--blur", 0.005, "--readout", 15, "--seed", 29, told=False)
        self.assertEqual(judged["coverage"], 1)
        self.assertLess(judged["ate"]["mean"], 0.001 * judged["length_m"])

    def test_a_pan_that_looks_like_a_crop(self):
        """A rolling shutter that turns moves the axis of the lens that explains it best far to the side."""
        judged = self.film_judged("model: radtan, resolution: [1280, 720], "
                                  "intrinsics: {fx: 640, fy: 640, cx: 634.87, cy: 358.82, k1: -0.0923, k2: 0.0138, p1: 0, p2: 0}",
                                  "street", "--motion", "pan", "--fps", 15, "--frames", 80, "--length", 6.4, "--noise", 4,
                                  "--blur", 0.01, "--readout", 20, "--seed", 441, told=False)
        self.assertGreater(judged["coverage"], 0.9)
        self.assertLess(judged["ate"]["mean"], 0.01 * judged["length_m"])

    def test_a_turn_that_feigns_a_way(self):
        """Blur and a rolling shutter do, which start no map: there are orientations alone."""
        source = SHARED / "fr1-rpy"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        done = self.track(source, "--from", 1305031231.03)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.only_turns(json.loads((self.out / "report.json").read_text()))

    def test_images_that_cannot_be_used(self):
        """Their frames have no pose but a reason; the others are as good as ever, whatever the threads."""
        sequence = self.folder / "sequence"
        shutil.copytree(STREET, sequence)
        whole = (sequence / "images/000030.png").read_bytes()
        (sequence / "images/000030.png").write_bytes(whole[:len(whole) // 2])
        (sequence / "images/000000.png").write_bytes(b"")
        shutil.copy(self.image("small.pgm"), sequence / "images/000045.png")
        for threads in (1, 2, 4):
            out = self.folder / str(threads)
            done = run("track", sequence, "--threads", threads, "--out", out)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(done.stderr.count("3 of 60 frames cannot be used"), 1, done.stderr)
            frames = self.complete(out)["frames"]
            self.assertEqual((frames["total"], frames["posed"]), (60, 57))
            missing = {frame["index"]: frame["reason"] for frame in frames["without_pose"]}
            self.assertEqual(set(missing), {0, 30, 45})
            for index, reason in missing.items():
                self.assertIn(f"{index:06}.png", reason)
            self.assertIn("64 x 48 pixels; allowed: the 512 x 384", missing[45])
        for name in set(OUTPUT) - {"report.json", "config.yaml"}:
            content = [(self.folder / str(threads) / name).read_bytes() for threads in (1, 2, 4)]
            self.assertEqual(content[0], content[1], name)
            self.assertEqual(content[0], content[2], name)
        self.assertLess(self.error(out), 0.01 * 9.4)

    def test_nothing_is_loaded_that_is_not_needed(self):
        def loaded(*arguments):
            done = subprocess.run([program.PROGRAM, *map(str, arguments)], env={**os.environ, "LD_DEBUG": "files"},
                                  stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=True)
            return [name for name in ("opencv", "libavcodec", "libavdevice") if name in done.stderr]
        camera = ["--camera", STREET / "camera.yaml", "--out", self.out, "--quiet"]
        self.assertEqual(loaded("--version"), [])
        self.assertEqual(loaded("track", STREET, *camera), [])
        self.assertEqual(loaded("track", self.video("street.mkv"), *camera), ["libavcodec"])

    def test_modules_that_are_missing_are_named(self):
        alone = self.folder / "raysfm"
        shutil.copy(program.PROGRAM, alone)
        done = subprocess.run([alone, "track", self.video("street.mkv"), "--camera", STREET / "camera.yaml", "--out",
                               self.out], stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn("raysfm-video.so", done.stderr)
        done = subprocess.run([alone, "track", STREET, "--out", self.out, "--quiet"])
        self.assertEqual(done.returncode, 0)

    def test_truncated_video(self):
        video = self.video("street.mkv")
        video.write_bytes(video.read_bytes()[:video.stat().st_size * 6 // 10])
        done = run("track", video, "--camera", STREET / "camera.yaml", "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("warning: " + str(video) + ": cut short", done.stderr)
        self.assertLess(self.complete(self.out)["frames"]["total"], 60)


class BadInput(TrackTest):
    """Each is refused in one line, before an output folder is made."""

    def setUp(self):
        super().setUp()
        self.source = self.images("images", 3)

    def tearDown(self):
        self.assertFalse(self.out.exists())

    def refuses(self, *arguments, says, camera=None, **options):
        self.refused("track", *arguments, "--camera", camera or self.camera, "--out", self.out, says=says, **options)

    def test_rolling_shutter(self):
        for told in ["-1", "1001", "fast", "nan"]:
            self.refuses(self.source, f"--rolling-shutter={told}", says=["--rolling-shutter", f"'{told}'", "0 to 1000"])

    def test_input(self):
        missing = self.folder / "missing"
        self.refuses(missing, says=[missing, "no such file"])
        (self.folder / "empty").mkdir()
        self.refuses(self.folder / "empty", says=[self.folder / "empty"])
        for name, content in {"nothing.mp4": "", "text.mp4": "this is no video", "zeros.mkv": bytes(5000)}.items():
            self.refuses(self.file(name, content), says=[name])
        self.refuses(self.source, self.source, says=["stream 1", "no camera"])

    def test_damaged_images(self):
        png = (STREET / "images" / "000000.png").read_bytes()
        self.refuses(self.file("short/0.png", png[:-500]).parent, says=["0.png", "damaged"])
        flipped = png[:2000] + bytes(500) + png[2500:]
        done = self.track(self.file("flipped/0.png", flipped).parent, "--camera", STREET / "camera.yaml",
                          out=self.folder / "flipped_out")
        self.assertIn(done.returncode, (2, 3), done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_decoders_say_nothing_themselves(self):
        kinds = ("png", "jpg", "bmp", "tif", "webp")
        for kind in kinds:
            folder = self.folder / kind
            folder.mkdir()
            subprocess.run(["ffmpeg", "-loglevel", "error", "-i", STREET / "images" / "%06d.png", "-frames:v", "5",
                            folder / f"%02d.{kind}"], check=True)
            for i, path in enumerate(sorted(folder.iterdir())):
                content = path.read_bytes()
                size = len(content)
                cut = content[:size * i // 9] if i % 2 else content
                path.write_bytes(cut if i < 2 else cut[:size // 3] + bytes(7 * i) + cut[size // 3 + 9 * i:])
            (folder / f"00.{kind}").write_bytes((folder / f"01.{kind}").read_bytes())
        video = bytearray(self.video("street.mp4", "-frames:v", "12").read_bytes())
        for at in range(2000, len(video) // 2, 997):
            video[at] ^= 0x5a
        for source in (*(self.folder / kind for kind in kinds), self.file("broken.mp4", bytes(video))):
            done = run("track", source, "--camera", STREET / "camera.yaml", "--out", self.folder / "noisy", "--threads", 1)
            for line in done.stderr.splitlines():
                self.assertRegex(line, r"\A(raysfm track: |warning: |frame \d|started |no start|track )", source)

    def test_truncated_video_without_index(self):
        video = self.video("street.mp4")
        video.write_bytes(video.read_bytes()[:video.stat().st_size * 6 // 10])
        self.refuses(video, camera=STREET / "camera.yaml", says=[video])

    def test_size(self):
        self.refuses(self.images("large", 2, size=(128, 96)), says=["camera.yaml", "64 x 48", "128 x 96"])
        self.image("mask.pgm", (32, 48))
        masked = self.file("masked.yaml", CAMERA + "    mask: mask.pgm\n")
        self.refuses(self.source, camera=masked, says=["mask.pgm", "32 x 48", "64 x 48"])
        outside = self.file("outside.yaml", CAMERA + "    roi: [10, 0, 64, 48]\n")
        self.refuses(self.source, camera=outside, says=["outside.yaml", "roi", "64 x 48"])

    def test_camera_values(self):
        for old, new, says in (("fx: 50", "fx: .nan", ["fx", "nan"]), ("fx: 50", "fx: -50", ["fx", "-50"]),
                               ("fx: 50", "fx: 0", ["fx", "0"]), ("fy: 50", "fy: .inf", ["fy", "inf"]),
                               ("fx: 50, ", "", ["fx"]), ("cx: 31.5", "cx: middle", ["cx", "middle"]),
                               ("model: pinhole", "model: telescope", ["telescope", "pinhole"]),
                               ("[64, 48]", "[64, -48]", ["resolution", "-48"]),
                               ("[64, 48]", "[64]", ["resolution"]),
                               ("raysfm_camera: 1", "raysfm_camera: 2", ["raysfm_camera", "2"])):
            self.assertIn(old, CAMERA)
            bad = self.file("bad.yaml", CAMERA.replace(old, new))
            self.refuses(self.source, camera=bad, says=["bad.yaml", *says])

    def test_camera_files(self):
        missing = self.folder / "missing.yaml"
        self.refuses(self.source, camera=missing, says=[missing, "no such file"])
        for name, content in {"nothing.yaml": "", "trajectory.txt": "0 0 0 0 0 0 0 1\n", "settings.yaml": "features: 9\n",
                              "list.yaml": "- 1\n- 2\n", "broken.yaml": "a: [1, 2\n", "zeros.yaml": bytes(100),
                              "mask.yaml": CAMERA + "    mask: no_such.png\n"}.items():
            self.refuses(self.source, camera=self.file(name, content), says=[name])
        self.refuses(self.source, camera=self.source / "000.pgm", says=["000.pgm"])
        self.refuses(self.source, camera=self.folder, says=[self.folder])

    def test_configuration(self):
        for line, says in (("no_such_option: 1", ["no_such_option"]), ("window: many", ["window", "many"]),
                           ("window: 1e9", ["window", "1e9"]), ("final: soon", ["final", "soon", "global"]),
                           ("mono: perhaps", ["mono", "perhaps"]), ("- window", ["name: value"]),
                           ("window: [1", ["YAML"]), ("seed: -1", ["seed", "-1"]), ("features: [1]", ["features"])):
            config = self.file("config.yaml", line + "\n")
            self.refuses(self.source, "--config", config, says=["config.yaml", *says])
        for line in ("threads: -1", "threads: 100000", "features: 3", "free-cameras: 0", "window: 0", "fps: -1", "fps: .nan"):
            config = self.file("config.yaml", line + "\n")
            self.refuses(self.source, "--config", config, says=["config.yaml: line 1: " + line.split(": ")[0]])
        self.refuses(self.source, "--config", self.folder / "missing.yaml", says=["missing.yaml"])
        self.refuses(self.source, "--config", self.folder, says=[self.folder])

    def test_flags(self):
        for flag, value in (("--features", "3"), ("--window", "0"), ("--free-cameras", "-2"), ("--global-until", "-1"),
                            ("--min-matches", "0"), ("--fps", "-1"), ("--fps", "nan"), ("--fps", "inf")):
            self.refuses(self.source, f"{flag}={value}", says=[flag.strip("-"), value])
        for flag in ("--error=none", "--start=late", "--final=all", "--features=many", "--threads=-1", "--no-such-flag"):
            done = run("track", self.source, "--camera", self.camera, "--out", self.out, flag)
            self.assertEqual(done.returncode, 2, flag)
            self.assertNotEqual(done.stderr, "", flag)

    @unittest.skipUnless(hasattr(os, "geteuid") and os.geteuid() == 0, "root passes permissions, others cannot become root")
    def test_unreadable_folder(self):
        self.folder.chmod(0o755)
        self.source.chmod(0)
        try:
            self.refuses(self.source, says=[self.source, "ermission denied"], user=NOBODY)
        except PermissionError:
            self.skipTest("the program is where only root may run it")
        finally:
            self.source.chmod(0o755)


class BadOutput(TrackTest):
    """A folder that cannot be written is found before the frames are read: the last is damaged."""

    def setUp(self):
        super().setUp()
        self.source = self.images("images", 3)
        self.file("images/002.pgm", b"P5 64 48 255\n")

    def refuses(self, out, says, **options):
        self.refused("track", self.source, "--camera", self.camera, "--out", out, "--quiet", says=says, **options)

    def test_not_a_folder(self):
        occupied = self.file("occupied", "")
        self.refuses(occupied, [occupied, "cannot be created"])
        self.refuses(occupied / "out", [occupied, "cannot be created"])
        self.refuses("/proc/no_such_folder", ["/proc/no_such_folder"])

    def test_camera_is_not_overwritten(self):
        camera = self.file("out/config.yaml", CAMERA)
        done = self.track(self.source, "--camera", camera)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("overwrite", done.stderr)
        self.assertEqual(camera.read_text(), CAMERA)

    @unittest.skipUnless(os.geteuid() == 0, "only root becomes another user")
    def test_no_permission(self):
        self.folder.chmod(0o755)
        self.out.mkdir()
        try:
            self.refuses(self.out, [self.out, "ermission denied"], user=NOBODY)
        except PermissionError:
            self.skipTest("the program is where only root may run it")
        self.assertEqual(list(self.out.iterdir()), [])

    @unittest.skipUnless(os.geteuid() == 0, "only root mounts")
    def test_full_disk(self):
        self.out.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=12k", "tmpfs", self.out], capture_output=True,
                                 check=False)
        if mounted.returncode != 0:
            self.skipTest("tmpfs cannot be mounted here")
        self.addCleanup(subprocess.run, ["umount", self.out], check=True)
        self.image("images/002.pgm")
        self.refuses(self.out, [self.out, "No space left on device"])
        left = {str(path.relative_to(self.out)) for path in self.out.rglob("*") if path.is_file()}
        self.assertLess(left - {"report.html"}, set(OUTPUT))
        self.assertFalse((self.out / "report.json").exists())


class OnlyTurns(TrackTest):
    """A camera that turns on the spot has orientations, and no place that anybody knows."""

    def film(self, frames):
        sequence = self.folder / "rotation"
        camera = self.file("small.yaml", CAMERA.replace("[64, 48]", "[320, 240]").replace("50", "250")
                           .replace("31.5", "159.5").replace("23.5", "119.5"))
        run("synth", "room", "--motion", "rotate", "--frames", frames, "--samples", 1, "--camera", camera, "--out", sequence)
        return sequence, camera

    def judge(self, sequence, frames):
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["frames"]["posed"], report["points"]), (frames, 0))
        self.assertEqual(report["frames"]["place_held"], [{"first": 0, "last": frames - 1}])
        self.assertEqual(report["scale"], "arbitrary")
        result = json.loads(run("eval", self.out, sequence, "--align", "sim3", "--json").stdout)
        self.assertEqual(result["matched"], frames)
        self.assertLess(result["rpe"]["rot_deg"], 0.1)
        return report

    def test_with_a_camera_file(self):
        sequence, camera = self.film(120)
        done = self.track(sequence, "--camera", camera)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.judge(sequence, 120)
        self.complete(self.out)
        said = run("track", sequence, "--out", self.folder / "told", "--camera", camera)
        self.assertIn("120 of them were only seen to turn", said.stdout)
        self.assertIn("frames 0 to 119 only turn", said.stderr)
        frames = [int(word) for word in re.findall(r"warning: no start yet: frames .*?, (\d+): ", said.stderr)]
        self.assertGreater(len(frames), 1, said.stderr)
        for earlier, later in zip(frames, frames[1:]):  # now and then, not each time
            self.assertGreaterEqual(later - earlier, 30, said.stderr)

    def test_with_nothing_told(self):
        sequence, camera = self.film(60)
        (sequence / "camera.yaml").unlink()
        done = self.track(sequence)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = self.judge(sequence, 60)
        self.assertEqual(report["lens_source"], "footage")
        self.assertLess(abs(report["lens_focal_px"] / 250 - 1), 0.01)


class NoReconstruction(TrackTest):
    """Exit code 3, one line with the reason, and an output folder that says it frame by frame."""

    def fails(self, source, says, frames, camera=None):
        done = self.track(source, "--camera", camera or STREET / "camera.yaml")
        self.assertEqual((done.returncode, done.stdout), (3, ""), done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn(says, done.stderr)
        report = self.complete(self.out)
        self.assertEqual((report["frames"]["total"], report["frames"]["posed"]), (frames, 0))
        self.assertEqual(len(report["frames"]["without_pose"]), frames)
        for frame in report["frames"]["without_pose"]:
            self.assertIn(says, frame["reason"])

    def test_black(self):
        black = self.images("black", 5, level=lambda x, y: 0)
        self.fails(black, "too few corners: 0, at least 20 are needed; the picture is nearly black", 5, camera=self.camera)

    def test_one_frame(self):
        (self.folder / "one").mkdir()
        shutil.copy(STREET / "images" / "000000.png", self.folder / "one")
        self.fails(self.folder / "one", "at least 3", 1)

    def test_static_camera(self):
        (self.folder / "static").mkdir()
        for i in range(8):
            shutil.copy(STREET / "images" / "000000.png", self.folder / "static" / f"{i}.png")
        self.fails(self.folder / "static", "no motion", 8)


class WithoutCameraFile(TrackTest):
    """The lens comes from the footage, or from the field of view that the user tells."""

    def not_told(self, source, says):
        done = self.track(source)
        self.assertEqual((done.returncode, done.stdout), (3, ""), done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        for word in ("the lens is not told by the footage", says, "--camera or --fov"):
            self.assertIn(word, done.stderr)
        self.assertFalse((self.out / "trajectory.txt").exists())

    def straight(self):
        """A sequence whose motion tells no lens; the field of view of its camera is 61.928 degrees."""
        camera = self.file("straight.yaml", CAMERA.replace("[64, 48]", "[360, 270]").replace("50", "300")
                           .replace("31.5", "179.5").replace("23.5", "134.5"))
        sequence = self.folder / "straight"
        done = run("synth", "corridor", "--motion", "straight", "--frames", 30, "--length", 3, "--samples", 1,
                   "--camera", camera, "--out", sequence, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        (sequence / "camera.yaml").unlink()
        return sequence

    def test_found(self):
        street = self.folder / "street"
        street.mkdir()
        for name in ("images", "times.txt"):
            (street / name).symlink_to(STREET / name)
        self.assertEqual(self.track(STREET, out=self.folder / "calibrated").returncode, 0)
        done = self.track(street)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 60)
        self.assertEqual(report["lens_source"], "footage")
        self.assertEqual(report["lens_frames"], [0, 59])
        self.assertAlmostEqual(report["lens_focal_px"] / 410, 1, delta=0.01)  # the street's camera
        self.assertLess(report["lens_focal_sigma_percent"], 6)
        self.assertEqual((report["lens_not_told"], report["told_fov_deg"]), (None, None))
        self.assertIn("lens", report["timing"])
        self.assertLess(self.error(self.out), 1.5 * self.error(self.folder / "calibrated") + 0.001)
        found = self.out / "camera.yaml"
        self.assertIn("From the footage, frames 0 to 59", found.read_text())
        self.assertEqual(run("camera", "check", found).returncode, 0)
        again = self.folder / "again"
        self.assertEqual(self.track(street, "--camera", found, out=again).returncode, 0)
        report = json.loads((again / "report.json").read_text())
        self.assertEqual((report["lens_source"], report["lens_focal_px"]), ("camera file", None))
        self.assertEqual(report["frames"]["posed"], 60)

    def test_pixels_that_are_not_square(self):
        """The street, squeezed to three quarters of its width, as its video says."""
        self.assertEqual(self.track(STREET, out=self.folder / "calibrated").returncode, 0)
        done = self.track(self.video("street.mkv", "-vf", "scale=384:384,setsar=4/3"))
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 60)
        self.assertAlmostEqual(report["lens_focal_px"] / (0.75 * 410), 1, delta=0.01)
        found = re.search(r"fx: ([\d.]+), fy: ([\d.]+)", (self.out / "camera.yaml").read_text())
        self.assertAlmostEqual(float(found[2]) / float(found[1]), 4 / 3, delta=0.001)
        self.assertLess(self.error(self.out), 2 * self.error(self.folder / "calibrated") + 0.001)

    def test_zoom(self):
        """The zoom is undone, with and without a camera file; with a map to be saved, which is of one lens, the user hears of
        it alone."""
        camera = self.file("start.yaml", CAMERA.replace("[64, 48]", "[360, 270]").replace("50", "260")
                           .replace("31.5", "179.5").replace("23.5", "134.5"))
        room = self.folder / "room"
        done = run("synth", "room", "--motion", "walk", "--frames", 80, "--length", 4, "--samples", 1, "--zoom", 1.4,
                   "--camera", camera, "--out", room, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = run("track", room, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stderr.count("warning"), 1, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["command"], report["lens"], report["frames"]["posed"]), ("solve", "zooming", 80))
        said = re.fullmatch(r"the camera zooms, its focal length is (\d+) to (\d+) px: .* with the zoom undone, .*", report["warnings"][0])
        self.assertLess(abs(int(said[1]) / 260 - 1), 0.02)
        self.assertLess(abs(int(said[2]) / 364 - 1), 0.02)
        for name in ("lens.csv", "lens.png", "config.yaml"):
            self.assertTrue((self.out / name).exists(), name)
        self.assertFalse((self.out / "camera.yaml").exists())
        result = json.loads(run("eval", self.out / "trajectory.txt", room / "truth.txt", "--json").stdout)
        self.assertLess(result["ate"]["rmse"], 0.003 * result["length_m"])
        done = self.track(room, "--save-map", self.folder / "saved.map", "--fov", 65, out=self.folder / "one")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.folder / "one" / "report.json").read_text())
        self.assertEqual(report["command"], "track")
        self.assertIn("look as if the camera zoomed", report["warnings"][-1])
        done = self.track(room, "--camera", camera, out=self.folder / "given")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.folder / "given" / "report.json").read_text())
        self.assertEqual((report["command"], report["lens"], report["frames"]["posed"]), ("solve", "zooming", 80))
        self.assertIn("with the zoom undone", report["warnings"][0])
        result = json.loads(run("eval", self.folder / "given" / "trajectory.txt", room / "truth.txt", "--json").stdout)
        self.assertLess(result["ate"]["rmse"], 0.003 * result["length_m"])

    def test_zoom_and_rolling_shutter(self):
        """A rolling shutter is not taken for a zoom, and hides none; a hand makes few key frames."""
        phone = CAMERA.replace("[64, 48]", "[480, 270]").replace("50", "360").replace("31.5", "239.5").replace("23.5", "134.5")
        camera = self.file("phone.yaml", phone)
        for scene, motion, zooms, ms in (("room", "walk", 1, 33), ("street", "handheld", 1.1, 10)):
            film = self.folder / scene
            done = run("synth", scene, "--motion", motion, "--frames", 80, "--zoom", zooms, "--readout", ms, "--samples", 1,
                       "--noise", 2, "--seed", 4, "--camera", camera, "--out", film, "--quiet")
            self.assertEqual(done.returncode, 0, done.stderr)
            rolling = self.file(f"{scene}.yaml", phone + f"    rolling_shutter: {{readout_ms: {ms}}}\n")
            done = run("track", film, "--camera", rolling, "--out", self.folder / f"{scene} tracked")
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual("the camera zooms" in done.stderr, zooms > 1, done.stderr)
            self.assertEqual("zoom undone" in done.stderr, zooms > 1, done.stderr)
            result = json.loads(run("eval", self.folder / f"{scene} tracked", film, "--json").stdout)
            self.assertLess(result["ate"]["mean"], 0.005 * result["length_m"])

    def test_zoom_that_leaves_nothing_to_one_lens(self):
        """No stretch tells a lens, tracking none either, and nothing looked like a zoom: a lens for each image is found."""
        film = self.folder / "street"
        camera = self.file("phone.yaml", CAMERA.replace("[64, 48]", "[480, 270]").replace("50", "330")
                           .replace("31.5", "239.5").replace("23.5", "134.5"))
        done = run("synth", "street", "--motion", "handheld", "--frames", 110, "--zoom", 1.5, "--samples", 1, "--noise", 2,
                   "--seed", 25, "--camera", camera, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = run("track", film, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("no lens from tracking", done.stderr)
        self.assertIn("there may be no one lens", done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["lens"], report["frames"]["posed"]), ("zooming", 110))
        result = json.loads(run("eval", self.out / "trajectory.txt", film / "truth.txt", "--json").stdout)
        self.assertLess(result["ate"]["mean"], 0.005 * result["length_m"])

    @unittest.skipUnless((SHARED / "rendered" / "zoom").exists(), "no shared data: rendered/zoom (set RAYSFM_SHARED_DATA)")
    def test_zoom_that_bends_the_map_of_its_first_lens(self):
        """By 1.8: the map of the camera file's lens is 17 % off, and tells too little of the zoom."""
        film = SHARED / "rendered" / "zoom"
        done = self.track(film)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["lens"], report["frames"]["posed"]), ("zooming", 60))
        result = json.loads(run("eval", self.out / "trajectory.txt", film / "truth.txt", "--json").stdout)
        self.assertLess(result["ate"]["mean"], 0.01 * result["length_m"])

    def test_fisheye(self):
        """A lens of 140 degrees is found as the fisheye that it is, and followed as well as with its calibration."""
        camera = self.file("fisheye.yaml", """raysfm_camera: 1
cameras:
  - {name: c, model: kannala-brandt, resolution: [320, 240], intrinsics: {fx: 131, fy: 131, cx: 162, cy: 118, k1: 0.01, k2: 0, k3: 0, k4: 0}}
""")
        room = self.folder / "room"
        done = run("synth", "room", "--motion", "walk", "--frames", 60, "--length", 2.5, "--samples", 1, "--camera", camera,
                   "--out", room, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.track(room, out=self.folder / "calibrated").returncode, 0)
        (room / "camera.yaml").unlink()
        done = self.track(room)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 60)
        self.assertEqual((report["lens_source"], report["lens_model"]), ("footage", "kannala-brandt"))
        self.assertAlmostEqual(report["lens_focal_px"] / 131, 1, delta=0.01)
        self.assertLess(report["lens_focal_sigma_percent"], 6)
        self.assertEqual(report["warnings"], [])
        calibrated, found = (json.loads(run("eval", out / "trajectory.txt", room / "truth.txt", "--json").stdout)["ate"]["mean"]
                             for out in (self.folder / "calibrated", self.out))
        self.assertLess(found, 1.5 * calibrated + 0.001)
        lens = self.out / "camera.yaml"
        self.assertIn("kannala-brandt", lens.read_text())
        self.assertEqual(run("camera", "check", lens).returncode, 0)
        done = run("solve", room, "--lens", "fixed", "--out", self.folder / "solved")
        self.assertRegex(done.stderr, r"warning: the lens was found to be 1\d\d degrees wide .* raysfm track .* finds fisheyes")

    def test_a_turn_on_the_spot(self):
        """No stretch tells the lens of a rolling shutter that turns at a place; tracking does, though nothing says how fast the images follow."""
        camera = self.file("phone.yaml", """raysfm_camera: 1
cameras:
  - {name: c, model: radtan, resolution: [400, 226], intrinsics: {fx: 318, fy: 318, cx: 199, cy: 113, k1: 0.06, k2: -0.12, p1: 0, p2: 0}}
""")
        room = self.folder / "room"
        done = run("synth", "room", "--motion", "pan", "--frames", 120, "--fps", 20, "--readout", 33, "--samples", 1, "--noise", 1,
                   "--camera", camera, "--out", room, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = self.track(room / "images")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertIn("the images have no time stamps: the readout that was found is told as if they were a second apart", " ".join(report["warnings"]))
        self.assertGreaterEqual(report["frames"]["posed"], 114)
        self.assertEqual((report["lens_source"], report["lens_frames"]), ("footage", [0, 119]))
        self.assertAlmostEqual(report["lens_focal_px"] / 318, 1, delta=0.02)
        readout = re.search(r"readout_ms: ([\d.]+), direction: down", (self.out / "camera.yaml").read_text())
        self.assertAlmostEqual(float(readout[1]) / (1000 * 0.033 * 20), 1, delta=0.1)

    def test_a_crop(self):
        """The optical axis of cropped images meets them far from the middle: a stretch alone is not believed that, a map that says the same is."""
        camera = self.file("crop.yaml", """raysfm_camera: 1
cameras:
  - {name: c, model: pinhole, resolution: [400, 300], intrinsics: {fx: 320, fy: 320, cx: 255, cy: 131}}
""")
        room = self.folder / "room"
        done = run("synth", "room", "--motion", "handheld", "--frames", 120, "--samples", 1, "--noise", 1, "--camera", camera, "--out", room, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        done = self.track(room / "images")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertGreaterEqual(report["frames"]["posed"], 114)
        number = dict(re.findall(r"(fx|cx|cy): ([\d.]+)", (self.out / "camera.yaml").read_text().split("intrinsics")[1]))
        self.assertAlmostEqual(float(number["fx"]), 320, delta=3)
        self.assertAlmostEqual(float(number["cx"]), 255, delta=3)
        self.assertAlmostEqual(float(number["cy"]), 131, delta=3)

    def test_threads_change_nothing(self):
        for threads in (1, 3):
            done = self.track(STREET / "images", "--threads", threads, out=self.folder / str(threads))
            self.assertEqual(done.returncode, 0, done.stderr)
        for name in ("camera.yaml", "trajectory.txt", "points.ply"):
            self.assertEqual((self.folder / "1" / name).read_bytes(), (self.folder / "3" / name).read_bytes(), name)

    def test_footage_that_does_not_tell(self):
        straight = self.straight()
        self.not_told(straight, "pure translation")
        self.not_told(self.images("still", 8, size=(320, 240)), "no motion")
        done = self.track(straight, "--fov", 61.928)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 30)
        self.assertEqual((report["lens_source"], report["told_fov_deg"]), ("told field of view", 61.928))
        self.assertIn("pure translation", report["lens_not_told"])
        self.assertAlmostEqual(report["lens_focal_px"], 300, delta=0.01)
        result = json.loads(run("eval", self.out, straight, "--json").stdout)
        self.assertLess(result["ate"]["mean"], 0.005 * result["length_m"])

    def test_almost_pure_rotation(self):
        """Its turns tell the lens; what else there is does not start a map, so that there are orientations alone."""
        if not (SHARED / "fr1-rpy").exists():
            self.skipTest(f"{SHARED / 'fr1-rpy'} is missing")
        done = self.track(SHARED / "fr1-rpy" / "rgb")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertGreater(report["frames"]["posed"], 80)
        self.only_turns(report)
        self.assertLess(abs(report["lens_focal_px"] / 517.3 - 1), 2 * report["lens_focal_sigma_percent"] / 100)

    def test_handheld_video(self):
        """The focal length is within what the report says; the trajectory nearly as good as with a calibration."""
        source = SHARED / "redkitchen-handheld"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        calibrated = self.folder / "calibrated"
        self.assertEqual(self.track(source / "first200.mp4", "--camera", source / "camera.yaml", out=calibrated).returncode, 0)
        self.assertEqual(self.track(source / "first200.mp4").returncode, 0)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 200)
        self.assertLess(abs(report["lens_focal_px"] / 526.2 - 1), 2 * report["lens_focal_sigma_percent"] / 100)
        errors = [json.loads(run("eval", out / "trajectory.txt", source / "truth.txt", "--json").stdout)["ate"]["rmse"]
                  for out in (self.out, calibrated)]
        self.assertLess(errors[0], 1.5 * errors[1])

    def test_a_lens_that_a_stretch_says_little_of(self):
        """Tracking begins with it, and its map tells the lens."""
        source = SHARED / "redkitchen-handheld"
        if not source.exists():
            self.skipTest(f"{source} is missing")
        images = self.folder / "few"
        images.mkdir()
        for image in sorted((source / "images").iterdir())[:100]:
            (images / image.name).symlink_to(image)
        done = run("track", images, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stderr, "no lens from the frames before 100: the focal length is known to 1[0-9] % only")
        self.assertIn("tracking ends at a focal length", done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 100)
        self.assertLess(abs(report["lens_focal_px"] / 526.2 - 1), 0.02)

    def test_a_rolling_shutter_bends_the_lens(self):
        """A stretch takes some of what the shutter does for the lens; the map tells them apart."""
        film = self.folder / "film"
        done = run("synth", "room", "--motion", "handheld", "--frames", 120, "--readout", 33, "--samples", 1, "--out", film, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        (film / "camera.yaml").unlink()
        self.assertEqual(self.track(film).returncode, 0)
        found = re.search(r"fx: ([\d.]+)", (self.out / "camera.yaml").read_text())
        self.assertAlmostEqual(float(found[1]) / 410, 1, delta=0.01)
        result = json.loads(run("eval", self.out / "trajectory.txt", film / "truth.txt", "--json").stdout)
        self.assertLess(result["ate"]["mean"], 0.0012 * result["length_m"])

    def test_refused(self):
        images = self.images("few", 3)
        for fov in ("200", "4.9", "-60", "nan"):
            self.refused("track", images, "--out", self.out, f"--fov={fov}", says=["--fov", fov, "5 to 150"])
        self.refused("track", images, "--out", self.out, "--fov", 60, "--camera", self.camera, says=["--fov", "--camera"])
        self.refused("track", images, images, "--out", self.out, says=["2 cameras", "--camera"])
        self.assertFalse((self.out / "report.json").exists())

    def test_footage_wins_over_what_is_told(self):
        done = run("track", STREET / "images", "--fov", 100, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stderr, r"warning: the field of view that was told means .* 214\.8 pixels, the footage says 41\d\.")
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["lens_source"], report["told_fov_deg"]), ("footage", 100))

    def test_images_of_another_size_are_frames_without_pose(self):
        street = self.folder / "mixed"
        shutil.copytree(STREET / "images", street)
        self.image("mixed/000020.png", (64, 48)).rename(street / "000020.png")
        self.assertEqual(self.track(street).returncode, 0)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual([f["index"] for f in report["frames"]["without_pose"]], [20])
        self.assertAlmostEqual(report["lens_focal_px"] / 410, 1, delta=0.01)


class Interrupted(TrackTest):
    """What there is when the signal comes is written whole."""

    def test_while_the_lens_is_looked_for(self):
        command = [program.PROGRAM, "track", STREET / "images", "--out", self.out]
        with subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
            self.assertIn("no camera file", run.stderr.readline())
            run.send_signal(signal.SIGINT)
            run.communicate(timeout=60)
        self.assertEqual(run.returncode, 130)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["interrupted"], report["frames"]["total"]), (True, 0))

    def interrupt(self, which, code):
        command = [program.PROGRAM, "track", STREET / "images", "--camera", STREET / "camera.yaml", "--out", self.out,
                   "--features", "5000"]
        with subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
            while "started" not in run.stderr.readline():
                self.assertIsNone(run.poll())
            run.send_signal(which)
            run.communicate(timeout=60)
        self.assertEqual(run.returncode, code)
        report = self.complete(self.out)
        self.assertGreater(report["frames"]["posed"], 0)
        self.assertLess(report["frames"]["total"], 60)

    def test_sigint(self):
        self.interrupt(signal.SIGINT, 130)

    def test_sigterm(self):
        self.interrupt(signal.SIGTERM, 143)


class Rigs(TrackTest):
    """A stereo pair as two streams, and as one image with two parts, rendered here."""

    RIG = """raysfm_camera: 1
cameras:
  - {{name: left, model: pinhole, resolution: [320, 240], intrinsics: &k {{fx: 240, fy: 240, cx: 159.5, cy: 119.5}}, {left}}}
  - {{name: right, model: pinhole, resolution: [320, 240], intrinsics: *k, {right},
     rig_from_cam: {{rotation: [0, 0, 0, 1], translation: [{x}, 0, 0]}}}}
"""
    STREAMS = dict(left="stream: 0", right="stream: 1")
    PARTS = dict(left="roi: [0, 0, 320, 240]", right="roi: [320, 0, 320, 240]")

    def rig(self, name, x=0.4, streams=STREAMS):
        return self.file(name, self.RIG.format(x=x, **streams))

    def render(self, camera, name):
        done = run("synth", "corridor", "--camera", camera, "--frames", 24, "--fps", 15, "--length", 2, "--samples", 1,
                   "--out", self.folder / name, "--quiet")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return self.folder / name

    def evaluated(self, sequence):
        done = self.track(sequence)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        report = json.loads((self.out / "report.json").read_text())
        error = json.loads(run("eval", self.out, sequence, "--align", "se3", "--json").stdout)
        return report, error

    def test_two_streams_have_metric_scale(self):
        report, error = self.evaluated(self.render(self.rig("rig.yaml"), "stereo"))
        self.assertEqual((report["camera_class"], report["scale"], report["error"]), ("axial", "metric", "pixel"))
        self.assertEqual(report["frames"]["posed"], 24)
        self.assertLess(error["ate"]["mean"], 0.01 * error["length_m"])

    def test_parts_of_one_image_are_the_same_rig(self):
        report, error = self.evaluated(self.render(self.rig("rig.yaml", streams=self.PARTS), "composite"))
        self.assertEqual((report["camera_class"], report["scale"]), ("axial", "metric"))
        self.assertEqual(report["frames"]["posed"], 24)
        self.assertLess(error["ate"]["mean"], 0.01 * error["length_m"])

    def test_a_damaged_image_of_one_stream_is_a_frame_without_pose(self):
        stereo = self.render(self.rig("rig.yaml"), "stereo")
        self.file("stereo/cam1/000010.png", "damaged")
        done = run("track", stereo, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("1 of 24 frames cannot be used", done.stderr)
        frames = json.loads((self.out / "report.json").read_text())["frames"]
        self.assertEqual((frames["total"], frames["posed"]), (24, 23))
        self.assertIn("cam1/000010.png", frames["without_pose"][0]["reason"])

    def test_videos_half_a_frame_apart_belong_together(self):
        """The same instants; the clock of the second camera is half a frame ahead."""
        stereo = self.render(self.rig("rig.yaml"), "stereo")
        for cam, ahead in (("cam0", 0), ("cam1", 0.5 / 15)):
            subprocess.run(["ffmpeg", "-loglevel", "error", "-framerate", "15", "-i", stereo / cam / "%06d.png", "-c:v",
                            "libx264", "-crf", "12", "-bf", "0", "-output_ts_offset", str(ahead), self.folder / f"{cam}.mkv"],
                           check=True)
        done = run("track", self.folder / "cam0.mkv", self.folder / "cam1.mkv", "--camera", stereo / "camera.yaml",
                   "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("not synchronised", done.stderr)
        report = json.loads((self.out / "report.json").read_text())
        self.assertEqual((report["frames"]["posed"], report["scale"]), (24, "metric"))

    def test_poses_in_the_opposite_direction_are_noticed(self):
        stereo = self.render(self.rig("rig.yaml"), "stereo")
        self.refused("track", stereo, "--camera", self.rig("wrong.yaml", x=-0.4), "--out", self.out, "--quiet",
                     says=["wrong.yaml", "rig_from_cam", "opposite direction"])

    def test_cameras_in_one_place_on_the_same_images_are_noticed(self):
        rig = self.rig("twice.yaml", x=0, streams=dict(left="stream: 0", right="stream: 0"))
        done = run("track", self.images("frames", 3, size=(320, 240)), "--camera", rig, "--out", self.out)
        self.assertIn("warning: right: sees the same images as left", done.stderr)
        self.assertIn("warning: right: stands where left stands", done.stderr)

    def test_a_mirror_has_no_pixel_error(self):
        mirror = self.file("mirror.yaml", """raysfm_camera: 1
cameras:
  - name: mirror
    model: mirror
    resolution: [64, 48]
    intrinsics: {fx: 160, fy: 160, cx: 31.5, cy: 23.5}
    mirror: {radius: 0.1, conic: 0, rim: 0.08, apex: [0, 0, 0.4], rotation: [0, 0, 0, 1], body: 0.02}
""")
        self.refused("track", self.images("frames", 3), "--camera", mirror, "--error", "pixel", "--out", self.out,
                     "--quiet", says=["--error pixel", "mirror", "angular"])


if __name__ == "__main__":
    program.main()
