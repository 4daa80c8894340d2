"""The Python package: python_test.py PROGRAM PACKAGE_FOLDER [unittest arguments], by the Python that it was built for."""
import ast
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings

PACKAGE = os.path.abspath(sys.argv.pop(2))
sys.path.insert(0, PACKAGE)

import numpy
import raysfm

import adjust_test
import program
import solve_test
from program import ProgramTest, main, run

ROOT = pathlib.Path(__file__).resolve().parents[1]
SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", ROOT.parent / "shared" / "data"))
# Times are in the other files of a result.
SAME = ["trajectory.txt", "keyframes.txt", "covariance.csv", "points.ply", "sparse/cameras.bin", "sparse/images.bin",
        "sparse/points3D.bin"]
CAMERA = """raysfm_camera: 1
cameras:
  - {name: c, model: pinhole, resolution: [64, 48], intrinsics: {fx: 50, fy: 40, cx: 31.5, cy: 23.5}}
"""
STREET = None  # a sequence of 60 frames, 512 x 384 pixels
TRACKED = None  # its result


def setUpModule():
    global STREET, TRACKED
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    STREET, TRACKED = pathlib.Path(folder.name) / "street", pathlib.Path(folder.name) / "tracked"
    for command in (("synth", "street", "--frames", 60, "--fps", 7.5, "--length", 9.4, "--samples", 1, "--out", STREET),
                    ("track", STREET, "--out", TRACKED)):
        done = run(*command, "--quiet")
        assert (done.returncode, done.stderr) == (0, ""), done.stderr


def frames():
    return list(raysfm.Frames(STREET))


class PythonTest(ProgramTest):
    def assert_same_files(self, one, other, names=SAME):
        for name in names:
            self.assertEqual((pathlib.Path(one) / name).read_bytes(), (pathlib.Path(other) / name).read_bytes(), name)

    def says(self, kind, text, function, *arguments, **options):
        with self.assertRaises(kind) as caught:
            function(*arguments, **options)
        self.assertIn(text, str(caught.exception))
        return caught.exception

    def program_says(self, *arguments):
        done = run(*arguments)
        self.assertNotEqual(done.returncode, 0)
        return done.stderr.strip().splitlines()[-1].split(": ", 1)[1]


class Cameras(PythonTest):
    def test_a_pinhole_by_its_formula(self):
        camera = raysfm.parse_cameras(CAMERA)[0]
        self.assertEqual((camera.name, camera.model, camera.width, camera.height), ("c", "pinhole", 64, 48))
        self.assertEqual(camera.parameters["fy"], 40)
        pixels = numpy.array([[[31.5, 23.5], [0, 0], [63, 10]], [[1, 2], [3, 4], [5, 6]]])
        expected = numpy.stack([(pixels[..., 0] - 31.5) / 50, (pixels[..., 1] - 23.5) / 40, numpy.ones((2, 3))], axis=-1)
        expected /= numpy.linalg.norm(expected, axis=-1, keepdims=True)
        origins, directions = camera.ray(pixels)
        numpy.testing.assert_allclose(directions, expected, atol=1e-15)
        numpy.testing.assert_array_equal(origins, numpy.zeros((2, 3, 3)))
        numpy.testing.assert_allclose(camera.project(7 * directions), pixels, atol=1e-12)
        # Every second one of other numbers, and behind the camera.
        numpy.testing.assert_allclose(camera.project(numpy.float32([[0, 0, 2], [9, 9, 9], [2, 1, 4]])[::2]),
                                      [[31.5, 23.5], [31.5 + 25, 23.5 + 10]])
        numpy.testing.assert_array_equal(camera.project([[0, 0, -1], [numpy.nan, 0, 1]]), numpy.full((2, 2), numpy.nan))
        self.assertEqual(camera.project([0, 0, 1]).shape, (2,))

    def test_what_sees_nothing_is_nan_and_what_has_no_formula_is_searched(self):
        text = CAMERA.replace("pinhole", "unified").replace("cy: 23.5", "cy: 23.5, xi: 2")
        camera = raysfm.parse_cameras(text)[0]
        far = camera.ray([[31.5, 23.5], [10000, 0]])[1]
        self.assertEqual(numpy.isnan(far).tolist(), [[False] * 3, [True] * 3])
        # Unified without distortion is EUCM with alpha = xi / (1 + xi), beta = 1, focal lengths by 1 + xi shorter.
        eucm = camera.convert("eucm")
        self.assertAlmostEqual(eucm.parameters["alpha"], 2 / 3)
        self.assertAlmostEqual(eucm.parameters["fx"], 50 / 3)
        table = camera.convert("ray-table", grid=(12, 10))
        self.assertFalse(table.can_project)
        pixels = numpy.array([[20.0, 20.0], [40.25, 30.5]])
        numpy.testing.assert_allclose(table.project(camera.ray(pixels)[1]), pixels, atol=0.05)
        self.says(raysfm.BadInputError, "with --fit, the nearest", camera.convert, "radtan")
        self.says(ValueError, "grid: 3", camera.convert, "ray-table", grid=(3, 10))

    def test_files(self):
        path = self.file("c\u00e4mera \udcff.yaml", CAMERA) if os.name == "posix" else self.file("c.yaml", CAMERA)
        rig = raysfm.load_cameras(path)
        self.assertEqual(len(rig), 1)
        for target in ("kalibr", "opencv", "colmap"):
            written = run("camera", "convert", path, "--to", target)
            self.assertEqual("".join(rig.format(target).values()), written.stdout)
        rig.save(self.folder / "copy.yaml")
        self.assertEqual(rig.format("raysfm"), raysfm.load_cameras(self.folder / "copy.yaml").format())
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            raysfm.load_cameras(path)
        self.assertEqual(heard, [])
        with self.assertRaises(IndexError):
            rig[1]

    def test_errors_have_the_text_of_the_program(self):
        wrong = self.file("wrong.yaml", CAMERA.replace("pinhole", "plate"))
        for path in (wrong, self.folder / "missing.yaml"):
            said = self.program_says("camera", "show", path)
            error = self.says(raysfm.BadInputError, "", raysfm.load_cameras, path)
            self.assertEqual(str(error), said)
            self.assertIsInstance(error, ValueError)

    def test_wrong_arrays(self):
        camera = raysfm.parse_cameras(CAMERA)[0]
        for value, kind in ((numpy.zeros((3, 3)), ValueError), (numpy.zeros((2, 3, 1)), ValueError), (5.0, ValueError),
                            (numpy.zeros((3, 2), complex), TypeError), (["a", "b"], TypeError), (None, TypeError),
                            (numpy.zeros((3, 2), bool), TypeError), ([[1, 2], [3]], TypeError)):
            self.says(kind, "pixels", camera.ray, value)
        self.assertEqual(camera.ray(numpy.zeros((0, 2)))[0].shape, (0, 3))
        with self.assertRaises(ValueError):
            camera.rig_from_cam = numpy.ones((4, 4))
        with self.assertRaises(TypeError):
            raysfm.Camera()


class Track(PythonTest):
    def test_the_same_bytes_as_the_program(self):
        heard = []
        result = raysfm.track(STREET, out=self.folder / "tracked",
                              progress=lambda *numbers: heard.append(numbers), event=lambda *said: heard.append(said))
        self.assert_same_files(self.folder / "tracked", TRACKED, [*SAME, "config.yaml"])
        self.assertIn((60, 60, 60), heard)
        self.assertTrue(any(entry[0] == "info" and "started from frames" in entry[1] for entry in heard), heard)
        self.assertEqual(result.report["frames"], {**result.report["frames"], "total": 60, "posed": 60})
        self.assertEqual(result.report["version"], raysfm.__version__)
        self.assertEqual(json.loads((self.folder / "tracked/report.json").read_text())["points"],
                         len(result.reconstruction.points))
        # The arrays are what the files say.
        poses = numpy.loadtxt(TRACKED / "trajectory.txt")
        r = result.reconstruction
        numpy.testing.assert_array_equal(r.timestamps, poses[:, 0])
        numpy.testing.assert_array_equal(r.positions, poses[:, 1:4])
        numpy.testing.assert_array_equal(r.quaternions, poses[:, 4:])
        numpy.testing.assert_allclose(r.poses[:, :3, 3], poses[:, 1:4])
        x, y, z, w = poses[:, 4:].T
        numpy.testing.assert_allclose(r.poses[:, 0, 1], 2 * (x * y - z * w), atol=1e-12)
        lines = (TRACKED / "covariance.csv").read_text().splitlines()
        covariance = numpy.loadtxt([line for line in lines if line[0].isdigit()], delimiter=",")
        numpy.testing.assert_array_equal(r.covariances[:, *numpy.triu_indices(6)], covariance[:, 1:])
        self.assertEqual(r.colors.dtype, numpy.uint8)
        seen = r.observations
        self.assertEqual(set(seen), {"keyframe", "point", "camera", "pixel"})
        self.assertEqual(seen["keyframe"].max(), len(r.keyframes) - 1)
        # Every observation is where its point projects.
        of_world = r.poses[r.keyframes[seen["keyframe"]]]
        inside = numpy.einsum("nji,nj->ni", of_world[:, :3, :3], r.points[seen["point"]] - of_world[:, :3, 3])
        error = numpy.linalg.norm(r.rig[0].project(inside) - seen["pixel"], axis=1)
        self.assertLess(numpy.sqrt(numpy.mean(error**2)), 1.01 * r.rms_reprojection_px + 1e-9)

    def test_options_and_the_same_errors(self):
        raysfm.track([STREET], out=self.folder / "out", features=900, refine_lens="off", threads=1, seed=numpy.int64(3))
        run("track", STREET, "--out", self.folder / "program", "--features", 900, "--refine-lens", "off", "--seed", 3, "--quiet")
        self.assert_same_files(self.folder / "out", self.folder / "program")
        self.says(TypeError, "unexpected keyword argument 'feature'", raysfm.track, STREET, feature=9)
        self.says(TypeError, "refine-lens", raysfm.track, STREET, **{"refine-lens": "off"})
        self.says(TypeError, "features: 'many'", raysfm.track, STREET, features="many")
        self.says(TypeError, "features: True", raysfm.track, STREET, features=True)
        self.says(TypeError, "fov: '60'", raysfm.track, STREET, fov="60")
        self.says(TypeError, "mono: 1", raysfm.track, STREET, mono=1)
        self.says(TypeError, "error: 3", raysfm.track, STREET, error=3)
        self.says(ValueError, "features: 99999999999 is not allowed", raysfm.track, STREET, features=99999999999)
        self.says(ValueError, "seed: -1 is not allowed", raysfm.track, STREET, seed=-1)
        self.says(TypeError, "inputs: int", raysfm.track, 5)
        self.says(raysfm.BadInputError, "must be one of auto, on, off", raysfm.track, STREET, refine_lens="maybe")
        for wrong in (("track", self.folder / "none.mp4", "--out", self.folder / "x"),
                      ("track", STREET, "--out", self.folder / "x", "--features", "3")):
            said = self.program_says(*wrong)
            options = {"features": 3} if "--features" in wrong else {}
            self.assertEqual(str(self.says(raysfm.BadInputError, "", raysfm.track, wrong[1], **options)), said)

    def test_no_reconstruction(self):
        black = self.folder / "black"
        for i in range(4):
            self.file(f"black/{i}.pgm", b"P5 512 384 255\n" + bytes(512 * 384))
        camera = STREET / "camera.yaml"
        said = self.program_says("track", black, "--camera", camera, "--out", self.folder / "one")
        error = self.says(raysfm.NoReconstructionError, said, raysfm.track, black, camera=camera, out=self.folder / "two")
        self.assertEqual(str(error), said)
        self.assertEqual(len(error.result.reconstruction.reasons), 4)
        self.assertEqual(json.loads((self.folder / "two/report.json").read_text())["frames"]["posed"], 0)
        self.assertTrue(numpy.isnan(error.result.reconstruction.poses).all())

    def test_ends_early_when_told_to(self):
        def stops(frames, total, posed):
            if frames == 30:
                raise raysfm.Stop
        result = raysfm.track(STREET, progress=stops)
        self.assertTrue(result.report["interrupted"])
        self.assertEqual(len(result.reconstruction.timestamps), 30)

        def fails(frames, total, posed):
            raise KeyError("mine")
        self.says(KeyError, "mine", raysfm.track, STREET, progress=fails)

    def test_other_threads_go_on(self):
        counted, ended = [0], threading.Event()

        def count():
            while not ended.wait(0.001):
                counted[0] += 1
        counter = threading.Thread(target=count)
        counter.start()
        start = time.monotonic()
        raysfm.track(STREET)
        spent = time.monotonic() - start
        ended.set()
        counter.join()
        self.assertGreater(counted[0], 50 * spent)

    def test_interrupt(self):
        many = self.folder / "many"
        (many / "images").mkdir(parents=True)
        shutil.copy(STREET / "camera.yaml", many)
        for i in range(20000):
            (many / f"images/{i:06}.png").symlink_to(STREET / f"images/{min(i % 118, 118 - i % 118):06}.png")
        code = ("import raysfm, sys\n"
                "try: raysfm.track(sys.argv[1], progress=lambda f, t, p: f == 20 and print('go', flush=True))\n"
                "except KeyboardInterrupt: print('heard'); sys.exit(7)")
        with subprocess.Popen([sys.executable, "-c", code, many], env={**os.environ, "PYTHONPATH": PACKAGE},
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            self.assertEqual(running.stdout.readline(), "go\n")
            start = time.monotonic()
            running.send_signal(signal.SIGINT)
            said = running.communicate(timeout=60)
        self.assertEqual((running.returncode, said[0]), (7, "heard\n"), said)
        self.assertLess(time.monotonic() - start, 5)


class Tracker(PythonTest):
    def track(self, pushed, **options):
        tracker = raysfm.Tracker(raysfm.load_cameras(STREET / "camera.yaml"), **options)
        self.live = [tracker.push(*frame) for frame in pushed]
        result = tracker.finish()
        result.write(self.folder / "pushed")
        return result

    def test_images_pushed_give_the_same_bytes(self):
        self.track(frames())
        self.assert_same_files(self.folder / "pushed", TRACKED)
        last = self.live[-1]
        self.assertEqual((last.frame, last.state, last.world, last.reason), (59, "tracking", 0, ""))
        self.assertEqual(last.pose.shape, (4, 4))
        numpy.testing.assert_array_equal(last.pose[:3, 3], last.position)
        numpy.testing.assert_allclose(last.covariance, last.covariance.T, rtol=1e-12)
        self.assertGreater(numpy.linalg.eigvalsh(last.covariance)[0], 0)
        first = self.live[0]
        self.assertEqual((first.state, first.pose, first.covariance), ("starting", None, None))
        self.assertNotEqual(first.reason, "")

    def test_views_of_any_strides_are_the_same(self):
        """Cut out, upside down, blue first, with an opacity: the pixels count, wherever they are."""
        def cut(image):
            around = numpy.full((image.shape[0] + 9, image.shape[1] + 13, *image.shape[2:]), 77, numpy.uint8)
            around[5:-4, 6:-7] = image
            return around[5:-4, 6:-7]

        def upside_down(image):
            return numpy.ascontiguousarray(image[::-1])[::-1]
        gray = [(images[0] if images[0].ndim == 2 else images[0][..., 1].copy(), t, name) for images, t, name in frames()]
        color = [(numpy.dstack([g, numpy.roll(g, 3, 1), 255 - g]), t, name) for g, t, name in gray]
        for plain, others in (
                (gray, [[(upside_down(cut(i)), t, n) for i, t, n in gray], [(i[..., None], t, n) for i, t, n in gray],
                        [([i], t, n) for i, t, n in gray]]),
                (color, [[(cut(i), t, n) for i, t, n in color],
                         [(numpy.ascontiguousarray(i[..., ::-1])[..., ::-1], t, n) for i, t, n in color],
                         [(numpy.dstack([i, i[..., :1]]), t, n) for i, t, n in color]])):
            expected = self.track(plain[:25]).reconstruction
            self.assertGreater(expected.posed.sum(), 20)
            for other in others:
                found = self.track(other[:25]).reconstruction
                numpy.testing.assert_array_equal(found.poses, expected.poses)
                numpy.testing.assert_array_equal(found.colors, expected.colors)
        expected = self.track(color[:25]).reconstruction
        found = self.track([(numpy.ascontiguousarray(i[..., ::-1]), t, n) for i, t, n in color[:25]], channels="bgr")
        numpy.testing.assert_array_equal(found.reconstruction.colors, expected.colors)

    def test_views_read_ahead_give_the_same_bytes(self):
        tracker = raysfm.Tracker(raysfm.load_cameras(STREET / "camera.yaml"))
        for view in tracker.views(STREET):
            tracker.push(view)
        tracker.finish().write(self.folder / "pushed")
        self.assert_same_files(self.folder / "pushed", TRACKED)

    @unittest.skipUnless((SHARED / "redkitchen-handheld").is_dir(), "no shared data")
    def test_the_kitchen_gives_the_same_bytes(self):
        """All of it, as its rolling shutter is found late; and what is told of one."""
        source = SHARED / "redkitchen-handheld"
        for frames, flags, options in ((420, [], {}), (80, ["--rolling-shutter", 25], {"rolling_shutter": "25"}),
                                       (80, ["--rolling-shutter", "none"], {"rolling_shutter": "none"})):
            kitchen = self.folder / f"kitchen {frames} {options}"
            (kitchen / "images").mkdir(parents=True)
            shutil.copy(source / "camera.yaml", kitchen)
            (kitchen / "times.txt").write_text("".join((source / "times.txt").read_text().splitlines(True)[:frames]))
            for path in sorted((source / "images").iterdir())[:frames]:
                (kitchen / "images" / path.name).symlink_to(path)
            done = run("track", kitchen, "--out", kitchen / "program", "--quiet", *flags)
            self.assertEqual(done.returncode, 0, done.stderr)
            tracker = raysfm.Tracker(raysfm.load_cameras(kitchen / "camera.yaml"), **options)
            for view in tracker.views(kitchen):
                tracker.push(view)
            tracker.finish().write(kitchen / "pushed")
            self.assert_same_files(kitchen / "program", kitchen / "pushed")
        self.says(raysfm.BadInputError, "rolling-shutter = 'slow'", raysfm.Tracker, raysfm.load_cameras(source / "camera.yaml"), rolling_shutter="slow")

    def test_wrong_images(self):
        tracker = raysfm.Tracker(raysfm.load_cameras(STREET / "camera.yaml"))
        image = numpy.zeros((384, 512), numpy.uint8)
        for wrong, kind, text in (
                (image.astype(float), TypeError, "dtype float64"), (image.astype(numpy.int8), TypeError, "dtype int8"),
                (image.tolist(), TypeError, "images[0]: list"), ("a.png", TypeError, "images: str"), (None, TypeError, "images"),
                (image[:, :100], raysfm.BadInputError, "100 x 384"), (image.T, ValueError, "side by side"),
                (numpy.zeros((384, 1024), numpy.uint8)[:, ::2], ValueError, "side by side"), (image[:, ::-1], ValueError, "side by side"),
                (numpy.zeros((384, 512, 2), numpy.uint8), ValueError, "(384, 512, 2)"), (numpy.zeros(9, numpy.uint8), ValueError, "(9,)"),
                (numpy.zeros((0, 512), numpy.uint8), ValueError, "(0, 512)"), ([image, image], raysfm.BadInputError, "2 given"),
                (numpy.broadcast_to(numpy.uint8(3), (384, 512)), ValueError, "side by side"),
                (numpy.broadcast_to(numpy.uint8(3), (99999, 99999)), ValueError, "2 GiB")):
            self.says(kind, text, tracker.push, wrong, 0.0)
        self.says(raysfm.BadInputError, "timestamp", tracker.push, image, float("nan"))
        self.says(TypeError, "push", tracker.push, image, "now")
        self.assertEqual(tracker.frames, 0)
        # Rows that are all one row are safe.
        self.assertIsNone(tracker.push(numpy.broadcast_to(image[0], image.shape), 0.0).pose)
        self.assertIn("no image", tracker.push([None], 1.0).reason)
        self.says(raysfm.BadInputError, "timestamp", tracker.push, image, 1.0)
        self.assertEqual((tracker.frames, tracker.posed), (2, 0))
        other = raysfm.Tracker(raysfm.load_cameras(STREET / "camera.yaml"))
        view = next(other.views(STREET))
        self.says(raysfm.BadInputError, "another tracker", tracker.push, view)
        other.push(view)
        self.says(raysfm.BadInputError, "the next one is 1", other.push, view)
        self.assertEqual(tracker.finish().reconstruction.posed.tolist(), [False, False])
        self.says(raysfm.InternalError, "finish", tracker.push, image, 9.0)
        self.says(raysfm.InternalError, "finish", tracker.finish)
        self.says(raysfm.InternalError, "finish", tracker.snapshot)
        self.assertEqual(tracker.frames, 2)

    def test_wrong_options(self):
        rig = raysfm.parse_cameras(CAMERA)
        self.says(TypeError, "unexpected keyword argument 'map'", raysfm.Tracker, rig, map="x")
        self.says(ValueError, "channels", raysfm.Tracker, rig, channels="hsv")
        self.says(raysfm.BadInputError, "1 x 2 pixels", raysfm.Tracker, rig, masks=[numpy.zeros((2, 1), numpy.uint8)])
        self.says(raysfm.BadInputError, "masks: 2 for 1", raysfm.Tracker, rig, masks=[None, None])
        self.says(raysfm.BadInputError, "no cameras", raysfm.Tracker, raysfm.Rig([]))
        self.says(raysfm.BadInputError, "features", raysfm.Tracker, rig, features=1)

    def test_threads_wait_for_each_other(self):
        tracker = raysfm.Tracker(raysfm.load_cameras(STREET / "camera.yaml"))
        stamp, refused = iter(range(1000)), []

        def push():
            for images, _, _ in frames()[:8]:
                try:
                    tracker.push(images, float(next(stamp)))
                    tracker.snapshot()
                except raysfm.BadInputError as error:
                    refused.append(str(error))  # another one was faster
        threads = [threading.Thread(target=push) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(tracker.frames + len(refused), 24)


class Others(PythonTest):
    def test_frames_whose_place_is_held(self):
        held = self.folder / "held"
        shutil.copytree(TRACKED, held)
        report = json.loads((held / "report.json").read_text())
        self.assertEqual(report["frames"]["place_held"], [])
        report["frames"]["place_held"] = [{"first": 2, "last": 4}]
        (held / "report.json").write_text(json.dumps(report))
        self.assertEqual(numpy.flatnonzero(raysfm.read_reconstruction(held).place_held).tolist(), [2, 3, 4])

    def test_read_and_evaluate(self):
        result = raysfm.read_reconstruction(TRACKED)
        said = json.loads(run("eval", TRACKED, STREET, "--json").stdout)
        self.assertEqual(raysfm.evaluate(TRACKED, STREET), said)
        self.assertEqual(raysfm.evaluate(result, STREET / "truth.txt"), said)
        self.assertEqual(len(result.worlds), 1)
        # A path and the same one turned, moved and twice as large.
        estimate = (result.timestamps, result.poses)
        turn = numpy.array([[0, -1, 0, 3], [1, 0, 0, 4], [0, 0, 1, 5], [0, 0, 0, 1.0]])
        larger = result.poses.copy()
        larger[:, :3, 3] *= 2
        found = raysfm.evaluate(estimate, (result.timestamps, turn @ larger))
        self.assertAlmostEqual(found["scale"], 2, places=9)
        self.assertLess(found["ate"]["rmse"], 1e-9)
        self.assertGreater(raysfm.evaluate(estimate, (result.timestamps, turn @ larger), align="se3")["ate"]["rmse"], 0.1)
        self.says(raysfm.BadInputError, "must be one of", raysfm.evaluate, TRACKED, STREET, align="all")
        self.says(TypeError, "truth", raysfm.evaluate, estimate, 4)
        self.says(ValueError, "truth", raysfm.evaluate, estimate, (result.timestamps, result.poses[:, :3]))
        self.says(ValueError, "timestamp 1", raysfm.evaluate, estimate, (0 * result.timestamps, result.poses))
        nothing = self.folder / "nothing"
        self.assertEqual(str(self.says(raysfm.BadInputError, "", raysfm.read_reconstruction, nothing)),
                         self.program_says("view", nothing, "--html", self.folder / "x.html"))

    def test_solve(self):
        rows = solve_test.Scene().rows(lambda j: 700 + 60 * j)
        tracks = self.file("tracks.csv", solve_test.text(rows))
        self.assertEqual(run("solve", tracks, "--size", "800x600", "--out", self.folder / "program", "--quiet").returncode, 0)
        raysfm.solve(tracks, size="800x600", out=self.folder / "out")
        self.assert_same_files(self.folder / "out", self.folder / "program", [*SAME, "lens.csv", "config.yaml"])
        values = numpy.loadtxt(tracks, delimiter=",", skiprows=1)
        found = raysfm.solve_tracks(values[:, 0].astype(int), values[:, 1].astype(int), values[:, 2:], size=(800, 600),
                                    out=self.folder / "arrays").reconstruction
        self.assert_same_files(self.folder / "arrays", self.folder / "program", [*SAME, "lens.csv"])
        self.assertEqual(len(found.lenses), found.posed.sum())
        self.assertAlmostEqual(found.lenses[0]["camera"].parameters["fx"] / 700, 1, places=1)
        image, point, pixel = values[:, 0].astype(int), values[:, 1].astype(int), values[:, 2:]
        for wrong, kind in (((image * 1.0, point, pixel), TypeError), ((image, point[1:], pixel), ValueError),
                            ((image, point, pixel.T), ValueError), ((image, point, pixel.astype(complex)), TypeError),
                            ((image, point, numpy.full_like(pixel, numpy.nan)), raysfm.BadInputError)):
            self.says(kind, "", raysfm.solve_tracks, *wrong, size=(800, 600))

    def test_adjust(self):
        problem = self.file("problem.txt", adjust_test.Bal(noise=0.5).text())
        self.assertEqual(run("adjust", problem, "--out", self.folder / "program", "--quiet").returncode, 0)
        costs = []
        result = raysfm.adjust(problem, out=self.folder / "out", progress=lambda iteration, cost: costs.append(cost))
        self.assert_same_files(self.folder / "out", self.folder / "program", ["problem.txt", "points.ply", "config.yaml"])
        self.assertLess(result.report["cost"]["final"], result.report["cost"]["initial"])
        self.assertEqual(len(costs), result.report["iterations"])
        self.says(raysfm.BadInputError, "must be one of", raysfm.adjust, problem, loss="square")

    def test_examples(self):
        pictures = [self.folder / "one.png", self.folder / "two.png"]
        for command in (["plot_trajectory.py", TRACKED, pictures[0]],
                        ["track_frames.py", STREET, STREET / "camera.yaml", pictures[1]]):
            done = subprocess.run([sys.executable, ROOT / "examples" / command[0], *command[1:]], text=True, capture_output=True,
                                  env={**os.environ, "PYTHONPATH": PACKAGE})
            self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("frames posed", done.stdout)
        from matplotlib import image
        for picture in pictures:
            pixels = image.imread(picture)
            self.assertGreater(len(numpy.unique((pixels * 255).astype(int).reshape(-1, 4), axis=0)), 40)
        done = subprocess.run([sys.executable, ROOT / "examples/plot_trajectory.py", self.folder, pictures[0]], text=True,
                              capture_output=True, env={**os.environ, "PYTHONPATH": PACKAGE})
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)

    @unittest.skipUnless((SHARED / "redkitchen-handheld").is_dir(), "no shared data")
    def test_what_a_frame_frees_is_kept_for_the_next(self):
        """Pages that are brought in anew are time that the program does not spend."""
        kitchen, code = SHARED / "redkitchen-handheld", ("import raysfm, sys\n"
                                                         "tracker = raysfm.Tracker(raysfm.load_cameras(sys.argv[1] + '/camera.yaml'))\n"
                                                         "for view in tracker.views(sys.argv[1]): tracker.push(view)\n"
                                                         "tracker.finish().write(sys.argv[2])\n")

        def faults(*command):
            running = subprocess.Popen([*map(str, command)], env={**os.environ, "PYTHONPATH": PACKAGE}, stdout=subprocess.DEVNULL)
            _, status, used = os.wait4(running.pid, 0)
            running.returncode = os.waitstatus_to_exitcode(status)
            self.assertEqual(running.returncode, 0)
            return used.ru_minflt
        programs = faults(program.PROGRAM, "track", kitchen, "--out", self.folder / "program", "--quiet")
        of_python = faults(sys.executable, "-c", "import sys")
        # 1,300 to 2,100 of each, as up to 512 small pages lie before the first large one; 23,000 were it not kept.
        self.assertLess(faults(sys.executable, "-c", code, kitchen, self.folder / "python") - of_python, 2 * programs)

    # numpy takes longer to load than the rest: who needs no array does not wait for it.
    def test_a_file_is_tracked_without_numpy(self):
        code = ("import sys, raysfm\n"
                "tracker = raysfm.Tracker(raysfm.load_cameras(sys.argv[2]))\n"
                "for view in tracker.views(sys.argv[1]): tracker.push(view)\n"
                "tracker.finish().write(sys.argv[3])\n"
                "print([name for name in ('numpy', 'typing', 'tempfile') if name in sys.modules])\n")
        done = subprocess.run([sys.executable, "-c", code, STREET, STREET / "camera.yaml", self.folder / "out"], text=True,
                              capture_output=True, env={**os.environ, "PYTHONPATH": PACKAGE})
        self.assertEqual((done.returncode, done.stderr, done.stdout), (0, "", "[]\n"))

    def test_stubs_have_what_the_module_has(self):
        stubs = ast.parse((ROOT / "python/raysfm/_raysfm.pyi").read_text())
        module = raysfm._raysfm

        def names(nodes):
            return {node.name for node in nodes if isinstance(node, (ast.FunctionDef, ast.ClassDef))} | {
                node.target.id for node in nodes if isinstance(node, ast.AnnAssign)}

        def public(thing):
            return {name for name in vars(thing) if not name.startswith("_")}
        self.assertEqual({name for name in names(stubs.body) if not name.startswith("_")}, public(module))
        self.assertEqual(public(module) | {"__version__", "solve_tracks"}, set(raysfm.__all__))
        for node in stubs.body:
            if isinstance(node, ast.ClassDef) and not node.bases:
                self.assertEqual({name for name in names(node.body) if not name.startswith("_")},
                                 public(getattr(module, node.name)) - {"result"}, node.name)
                for name in public(getattr(module, node.name)) - {"timestamp", "name", "reconstruction"}:
                    self.assertTrue(getattr(module, node.name).__dict__[name].__doc__, f"{node.name}.{name}")

    def test_types(self):
        if subprocess.run([sys.executable, "-c", "import mypy"], capture_output=True).returncode != 0:
            self.skipTest("no mypy")
        environment = {**os.environ, "MYPYPATH": PACKAGE, "MYPY_CACHE_DIR": str(self.folder / "mypy")}
        wrong = self.file("wrong.py", "import raysfm\nraysfm.read_reconstruction(3)\n")
        for path, problems in ((ROOT / "examples/plot_trajectory.py", 0), (ROOT / "examples/track_frames.py", 0), (wrong, 1)):
            done = subprocess.run([sys.executable, "-m", "mypy", "--ignore-missing-imports", "--check-untyped-defs", path], text=True,
                                  capture_output=True, env=environment)
            self.assertEqual(done.returncode, problems, done.stdout + done.stderr)


if __name__ == "__main__":
    main()
