"""The subcommand `camera`: camera_test.py PROGRAM [unittest arguments]."""
import os
import pathlib
import unittest

import program
from program import ProgramTest, run

BOARDS = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA",
                                     pathlib.Path(__file__).resolve().parents[2] / "shared" / "data")) / "boards"

FISHEYE = """raysfm_camera: 1
cameras:
  - name: left
    model: kannala-brandt
    resolution: [640, 480]
    intrinsics: {fx: 200, fy: 200, cx: 319.5, cy: 239.5, k1: 0.01}
  - name: right
    model: kannala-brandt
    resolution: [640, 480]
    intrinsics: {fx: 201, fy: 201, cx: 319.5, cy: 239.5, k1: 0.01}
    stream: 1
    rig_from_cam: {rotation: [0, 0, 0, 1], translation: [0.12, 0, 0]}
"""


class Camera(ProgramTest):
    def test_show(self):
        file = self.file("rig.yaml", FISHEYE)
        plot = self.folder / "plot.png"
        done = run("camera", "show", file, "--plot", plot)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for text in ("left: kannala-brandt, 640 x 480", "field of view", "pixels/degree", "axial, 2 cameras",
                     "baseline 0.12", "right stands 0.12 right, 0 below"):
            self.assertIn(text, done.stdout)
        self.assertTrue(plot.read_bytes().startswith(b"\x89PNG"))
        self.assertEqual(run("camera", "show", file, "--quiet").stdout, "")

    def test_convert_and_back(self):
        file = self.file("rig.yaml", FISHEYE)
        for form in ("kalibr", "opencv", "basalt", "raysfm"):
            out = self.folder / form
            self.assertEqual(run("camera", "convert", file, "--to", form, "--out", out).returncode, 0)
            done = run("camera", "check", out, "--against", file)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("no warnings", done.stdout)
            self.assertRegex(done.stdout, r"rays differ by .* (0|\S+e-\d\d) \(max\)")
        out = self.folder / "colmap"
        self.assertEqual(run("camera", "convert", file, "--to", "colmap", "--out", out).returncode, 0)
        self.assertIn("OPENCV_FISHEYE", (out / "cameras.txt").read_text())
        self.assertEqual(run("camera", "check", out / "rigs.txt").returncode, 0)
        self.assertIn("equidistant", run("camera", "convert", file, "--to", "kalibr").stdout)

    def test_inputs_links_and_devices_stay(self):
        file = self.file("rig.yaml", FISHEYE)
        self.refused("camera", "convert", file, "--to", "opencv", "--out", file, says=["--out", file, "overwrite"])
        self.refused("camera", "show", file, "--plot", file, says=["--plot", file, "overwrite"])
        self.assertEqual(file.read_text(), FISHEYE)
        target = self.file("target.yaml", "old")
        link = self.folder / "link.yaml"
        link.symlink_to("target.yaml")
        self.assertEqual(run("camera", "convert", file, "--to", "opencv", "--out", link).returncode, 0)
        self.assertTrue(link.is_symlink())
        self.assertIn("%YAML", target.read_text())
        done = run("camera", "convert", file, "--to", "opencv", "--out", "/dev/stdout")
        self.assertEqual((done.returncode, done.stdout), (0, target.read_text()))

    def test_masks_are_looked_at(self):
        file = self.file("rig.yaml", FISHEYE.replace("model: k", "mask: mask.pgm\n    model: k", 1))
        head = b"P5 640 480 255\n"
        for mask, says in ((head + bytes(640 * 480), "no pixel of the mask sees the scene"),
                           (head + b"\1" * (640 * 480), "brightest pixel of the mask is 1"),
                           (b"P5 64 48 255\n" + b"\xff" * (64 * 48), "64 x 48; allowed: the camera's 640 x 480"),
                           (b"", "mask.pgm"), (b"no image", "mask.pgm")):
            self.file("mask.pgm", mask)
            done = run("camera", "check", file)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn("warning: left: ", done.stdout)
            self.assertIn(says, done.stdout)
        self.file("mask.pgm", head + b"\xff" * (640 * 480))
        self.assertIn("no warnings", run("camera", "check", file).stdout)

    def test_fit(self):
        file = self.file("rig.yaml", FISHEYE)
        self.refused("camera", "convert", file, "--to", "opencv", "--model", "unified", says=["rig.yaml", "--fit"])
        done = run("camera", "convert", file, "--to", "opencv", "--model", "unified", "--fit")
        self.assertEqual(done.returncode, 0)
        self.assertRegex(done.stderr, r"unified fitted to kannala-brandt: rms \S+ px, max \S+ px")
        self.assertIn("xi1:", done.stdout)
        table = self.folder / "table.yaml"
        self.assertEqual(run("camera", "convert", file, "--to", "ray-table", "--grid", 30, 24, "--out", table).returncode, 0)
        self.assertIn("ray-table", run("camera", "show", table).stdout)

    def test_check(self):
        good = self.file("rig.yaml", FISHEYE)
        done = run("camera", "check", good)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("is it true that right stands 0.12 right", done.stdout)
        odd = self.file("odd.yaml", FISHEYE.replace("cx: 319.5", "cx: 700"))
        done = run("camera", "check", odd)
        self.assertEqual(done.returncode, 0)
        self.assertIn("outside the image", done.stdout)

    def test_check_against_images(self):
        sequence = self.folder / "sequence"
        self.assertEqual(run("synth", "room", "--frames", 2, "--samples", 1, "--out", sequence, "--quiet").returncode, 0)
        camera = sequence / "camera.yaml"
        done = run("camera", "check", camera, "--images", sequence)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        wrong = self.file("rig.yaml", FISHEYE)
        self.refused("camera", "check", wrong, "--images", sequence, says=["rig.yaml", "stream: 1"])

    def test_broken_files(self):
        for text, says in (("cx: 319.5", ["intrinsics.cx", "finite"]), ("k1: 0.01", ["intrinsics.k1", "finite"]),
                           ("[640, 480]", ["resolution"])):
            file = self.file("broken.yaml", FISHEYE.replace(text, text.split(":")[0] + ": nan" if ":" in text else "7"))
            for command in ("show", "check"):
                self.refused("camera", command, file, says=["broken.yaml", *says])
            self.refused("camera", "convert", file, "--to", "kalibr", says=["broken.yaml", *says])
        self.refused("camera", "show", self.folder / "missing.yaml", says=["missing.yaml"])
        self.assertEqual(run("camera", "convert", file, "--to", "nonsense").returncode, 2)
        self.assertEqual(run("camera").returncode, 2)

    def test_size_from_the_command_line(self):
        file = self.file("calib.txt", "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n")
        self.refused("camera", "convert", file, "--to", "colmap", says=["calib.txt", "--size"])
        done = run("camera", "convert", file, "--to", "colmap", "--size", 1226, 370)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("PINHOLE 1226 370 700 700 600.5 180.5", done.stdout)

    @unittest.skipUnless(BOARDS.exists(), f"no shared data: {BOARDS}")
    def test_calibrate_a_rig(self):
        out = self.folder / "rig.yaml"
        pair = BOARDS / "pinhole-stereo"
        done = run("camera", "calibrate", f"{pair}/left*", f"{pair}/right*", "--board", "9x6", "--square", 0.03, "--out", out)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for text in ("26 of 26 images show the board", "cam1: radtan, 640 x 480", "right, ", "film more: cam0: no corner"):
            self.assertIn(text, done.stdout)
        self.assertTrue((self.folder / "rig.png").read_bytes().startswith(b"\x89PNG"))
        text = out.read_text()
        self.assertRegex(text, r"# cam0 fx: standard deviation 0\.\d+\n")
        self.assertRegex(text, r"# cam1 place: standard deviation 0\.00\d+\n")
        shown = run("camera", "show", out)
        self.assertRegex(shown.stdout, r"baseline 0\.(099|100)")  # 3.33 squares

    @unittest.skipUnless(BOARDS.exists(), f"no shared data: {BOARDS}")
    def test_boards_that_tell_no_camera(self):
        left = BOARDS / "pinhole-stereo" / "left*"
        out = self.folder / "x.yaml"
        calibrate = ("camera", "calibrate", "--out", out)
        self.refused(*calibrate, left, "--board", "9x9", says=["9x9", "13 images", "9x6 seems to be there"])
        self.refused(*calibrate, left, "--board", "9by6", says=["--board = '9by6'", "as in 9x6"])
        self.refused(*calibrate, left, "--model", "mirror", says=["--model = 'mirror'", "kannala-brandt"])
        self.refused(*calibrate, left, "--square", -1, says=["--square = -1", "above 0"])
        for i in range(5):
            (self.folder / f"same-{i}.jpg").symlink_to(left.parent / "left01.jpg")
        self.refused(*calibrate, self.folder / "same-*.jpg", says=["5 images", "1 of them", "at least 3"])
        (self.folder / "same-5.jpg").symlink_to(BOARDS / "fisheye-stereo" / "left1.jpg")
        self.refused(*calibrate, self.folder / "same-*.jpg", says=["same-5.jpg", "960x600", "640x480"])
        self.assertFalse(out.exists())


if __name__ == "__main__":
    program.main()
