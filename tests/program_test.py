"""The program as its users meet it: program_test.py PROGRAM [unittest arguments]. Its `track` has track_test.py."""
import json
import math
import os
import unittest

import program
from program import ProgramTest, run

SUBCOMMANDS = ["track", "adjust", "eval", "synth"]


class Usage(ProgramTest):
    def test_help(self):
        self.assertEqual(run("--help").returncode, 0)
        for subcommand in SUBCOMMANDS:
            done = run(subcommand, "--help")
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            self.assertIn("Usage: raysfm " + subcommand, done.stdout)

    def test_version(self):
        done = run("--version")
        self.assertEqual(done.returncode, 0)
        self.assertRegex(done.stdout, r"\A\d+\.\d+\.\d+\ncompiler: \S+ [\d.]+, \w+\nSIMD: \w+ on this machine, of .*\nparts: OpenCV 4\.")

    def test_bad_usage(self):
        for arguments in ([], ["nonsense"], ["eval"], ["eval", "a"], ["eval", "a", "b", "--no-such-flag"],
                          ["track"], ["synth"], ["--threads", "-1", "eval", "a", "b"], ["--seed", "x", "eval", "a", "b"]):
            done = run(*arguments)
            self.assertEqual(done.returncode, 2, arguments)
            self.assertNotEqual(done.stderr, "", arguments)

    def test_values_that_cannot_be(self):
        images = self.file("images/0.pgm", b"P5 64 48 255\n" + bytes(64 * 48)).parent
        for seed in ("-1", "18446744073709551616", "1.5", ""):
            self.refused("track", images, "--out", self.folder / "out", "--seed", seed, says=["--seed", "0 to 18446744073709551615"])
        self.refused("track", images, "--out", "", says=["--out", "empty name"])
        self.refused("track", "", "--out", self.folder / "out", says=["INPUT", "empty name"])
        self.refused("solve", images, "--out", self.folder / "out", "--fps", "1e308", says=["fps", "1e+308"])
        self.refused("track", images, "--camera", "x", "--out", self.folder / "out", "--features", 2147483647,
                     says=["--features = 2147483647", "at most"])
        for subcommand in ("track", "adjust", "solve"):
            self.refused(subcommand, "--out", self.folder / "out", says=["INPUT is missing"])

    @unittest.skipUnless(os.path.exists("/dev/full"), "there is no full device here")
    def test_help_that_nobody_gets(self):
        with open("/dev/full", "w") as full:
            done = run("--help", stdout=full)
        self.assertEqual(done.returncode, 2)
        self.assertIn("standard output cannot be written", done.stderr)

    def test_configuration(self):
        images = self.file("images/0.pgm", b"P5 64 48 255\n" + bytes(64 * 48)).parent
        for text, says in (("window: 7\nwindow: 8\n", ["line 2", "window", "twice"]),
                           ("foo: 1\n", ["'foo' is no setting", "window"]), ("input: {a: 1}\n", ["input", "a list"]),
                           ("version: [1]\n", ["version", "a text"]), ("[" * 100000, ["line 1", "nested deeper"]),
                           ("a: [1, 2\n", ["config.yaml: line 2", "YAML"])):
            config = self.file("config.yaml", text)
            done = run("track", images, "--config", config, "--out", self.folder / "out")
            self.assertEqual((done.returncode, done.stderr.count("\n")), (2, 1), done.stderr)
            self.assertNotIn("yaml-cpp", done.stderr)
            for word in (config, *says):
                self.assertIn(str(word), done.stderr)
        config = self.file("config.yaml", 'version: "9.9"\ninput:\n  - "no/such/video.mp4"\n')
        done = run("track", "--config", config, "--out", self.folder / "out")
        self.assertEqual(done.returncode, 2)
        self.assertIn("of version 9.9", done.stderr)
        self.assertIn("no/such/video.mp4", done.stderr)


def tum(poses):
    return "".join("%.9f %.12g %.12g %.12g 0 0 0 1\n" % pose for pose in poses)


def spiral(count=50):
    """(t, x, y, z) of a path that spans all directions."""
    return [(0.1 * i, 0.01 * i * math.cos(0.3 * i), 0.05 * i, 0.01 * i * math.sin(0.3 * i)) for i in range(count)]


class Synth(ProgramTest):
    def test_list(self):
        done = run("synth", "--list")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for word in ("street", "terrace", "room", "corridor", "town", "board", "drive", "loop", "handheld", "orbit", "rotate"):
            self.assertIn(word, done.stdout)

    def test_layout(self):
        out = self.folder / "sequence"
        done = run("synth", "room", "--frames", 3, "--samples", 1, "--out", out, "--quiet")
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        self.assertEqual(len(list((out / "images").glob("*.png"))), 3)
        self.assertEqual(len((out / "times.txt").read_text().splitlines()), 3)
        self.assertIn("raysfm_camera: 1", (out / "camera.yaml").read_text())
        truth = [line for line in (out / "truth.txt").read_text().splitlines() if not line.startswith("#")]
        self.assertEqual([len(line.split()) for line in truth], [8, 8, 8])

    def test_same_seed_same_bytes(self):
        for name, options in {"a": ["--threads", 1], "b": ["--threads", 3], "c": ["--seed", 5]}.items():
            run("synth", "street", "--frames", 1, "--samples", 1, "--out", self.folder / name, *options)
        a, b, c = ((self.folder / name / "images" / "000000.png").read_bytes() for name in "abc")
        self.assertEqual(a, b)
        self.assertNotEqual(a, c)

    def test_bad_input(self):
        out = self.folder / "out"
        self.refused("synth", says=["WORLD"])
        self.refused("synth", "nowhere", "--out", out, says=["nowhere", "street"])
        self.refused("synth", "street", says=["--out"])
        self.refused("synth", "street", "--motion", "swim", "--out", out, says=["swim", "drive"])
        self.refused("synth", "street", "--noise", "-1", "--out", out, says=["noise", "-1"])
        self.refused("synth", "street", "--camera", self.folder / "missing.yaml", "--out", out,
                     says=["missing.yaml", "no such file"])
        occupied = self.file("occupied", "")
        self.refused("synth", "street", "--frames", "1", "--out", occupied / "out", says=[occupied])
        self.file("full/images/1.png", "")
        self.refused("synth", "street", "--frames", "1", "--out", self.folder / "full", says=["not empty"])


class Eval(ProgramTest):
    def setUp(self):
        super().setUp()
        self.truth = self.file("truth.txt", tum(spiral()))

    def json(self, *arguments):
        done = run("eval", *arguments, "--json")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return json.loads(done.stdout)

    def test_json_of_the_contract(self):
        scaled = self.file("scaled.txt", tum([(t, 3 * x + 1, 3 * y + 2, 3 * z) for t, x, y, z in spiral()[:40]]))
        result = self.json(scaled, self.truth)
        self.assertEqual(result["align"], "sim3")
        self.assertAlmostEqual(result["scale"], 1 / 3, places=9)
        self.assertEqual(result["matched"], 40)
        self.assertAlmostEqual(result["coverage"], 0.8)
        self.assertEqual(set(result["ate"]), {"rmse", "mean", "median", "max"})
        self.assertLess(result["ate"]["max"], 1e-8)
        self.assertLess(result["ate_xy"]["mean"], 1e-8)
        self.assertLess(result["rpe"]["trans"], 1e-8)
        self.assertLess(result["rpe"]["rot_deg"], 1e-6)
        self.assertEqual(result["kitti"], {"t_rel_percent": None, "r_rel_deg_per_100m": None})
        length = sum(math.dist(a[1:], b[1:]) for a, b in zip(spiral()[:39], spiral()[1:40]))
        self.assertAlmostEqual(result["length_m"], length, places=6)

    def covariances(self, sigma, count=50):
        """All alike, of positions and orientations."""
        line = ",".join(repr(sigma ** 2) if i == j else "0" for i in range(6) for j in range(i, 6))
        return self.file(f"covariance-{sigma}-{count}.csv", "".join(f"{t},{line}\n" for t in range(count)))

    def test_covariances(self):
        """Every second pose is 1 mm off, which is nothing beside 1 cm and much beside 0.1 mm."""
        off = self.file("off.txt", tum([(t, x, y + 0.001 * (i % 2), z) for i, (t, x, y, z) in enumerate(spiral())]))
        large = self.json(off, self.truth, "--covariance", self.covariances(0.01))["covariance"]
        self.assertEqual([(w["length"], w["windows"], w["frames"]) for w in large], [(10, 5, 50), (20, 2, 40), (40, 1, 40)])
        small = self.json(off, self.truth, "--covariance", self.covariances(0.0001))["covariance"]
        for w in range(3):
            self.assertEqual(large[w]["position"]["held"], 1)
            self.assertLess(small[w]["position"]["held"], 0.2)
            self.assertGreater(small[w]["position"]["normalised_error2"], 5)
            self.assertEqual(small[w]["orientation"]["held"], 1)
        table = run("eval", off, self.truth, "--covariance", self.covariances(0.01)).stdout
        self.assertIn("5 windows of 10 frames", table)
        self.assertNotIn("ellipsoids", run("eval", off, self.truth).stdout)

    def test_covariances_that_do_not_belong(self):
        self.refused("eval", self.truth, self.truth, "--covariance", self.covariances(0.01, 49),
                     says=["49.csv", "49 covariances for 50 poses"])
        self.refused("eval", self.truth, self.truth, "--covariance", self.folder / "none.csv", says=["none.csv"])

    def test_alignments(self):
        moved = self.file("moved.txt", tum([(t, x + 3, y - 4, z) for t, x, y, z in spiral()]))
        self.assertLess(self.json(moved, self.truth, "--align", "se3")["ate"]["max"], 1e-8)
        self.assertAlmostEqual(self.json(moved, self.truth, "--align", "none")["ate"]["mean"], 5, places=9)

    def test_max_dt(self):
        late = self.file("late.txt", tum([(t + 0.03, x, y, z) for t, x, y, z in spiral()]))
        self.refused("eval", late, self.truth, says=[late, self.truth, "0 poses of the estimate match"])
        self.assertEqual(self.json(late, self.truth, "--max-dt", "0.04")["matched"], 50)

    def test_folders(self):
        self.file("out/trajectory.txt", tum(spiral()))
        self.file("sequence/times.txt", "".join("%.9f\n" % pose[0] for pose in spiral()))
        self.file("sequence/poses.txt", "".join("1 0 0 %.12g 0 1 0 %.12g 0 0 1 %.12g\n" % p[1:] for p in spiral()))
        self.assertLess(self.json(self.folder / "out", self.folder / "sequence")["ate"]["max"], 1e-8)

    def test_each_world_is_judged_alone(self):
        """The second world is turned over, three times as large and elsewhere: a joint alignment would be far off."""
        path = spiral()
        for name in ("trajectory.txt", "keyframes.txt"):
            self.file("out/" + name, tum(path[:25]))
            self.file("out/worlds/1/" + name, tum([(t, 3 * y + 7, -3 * x, 3 * z) for t, x, y, z in path[30:40]]))
            self.file("out/worlds/2/" + name, tum(path[48:]))
        for estimate in (self.folder / "out", self.folder / "out/trajectory.txt", self.folder / "out/keyframes.txt"):
            result = self.json(estimate, self.truth)
            self.assertEqual((result["matched"], result["coverage"]), (25, 0.5))
            self.assertLess(result["ate"]["max"], 1e-8)
            self.assertAlmostEqual(result["coverage_all"], 0.7)
            main, second, third = result["worlds"]
            for key in set(main) - {"poses"}:
                self.assertEqual(main[key], result[key], key)
            self.assertEqual((main["poses"], second["poses"], third["poses"]), (25, 10, 2))
            self.assertLess(second["ate"]["max"], 1e-8)
            self.assertAlmostEqual(second["scale"], 1 / 3)
            self.assertAlmostEqual(second["coverage"], 0.2)
            self.assertIn("at least 3 are needed", third["reason"])
        table = run("eval", self.folder / "out", self.truth).stdout
        for text in ("main of 3 worlds", "worlds/1", "coverage 20.0 %", "worlds/2", "all             coverage 70.0 %"):
            self.assertIn(text, table)
        self.assertEqual(len(self.json(self.truth, self.truth)["worlds"]), 1)
        self.assertNotIn("worlds", run("eval", self.truth, self.truth).stdout)

    def test_table_and_quiet(self):
        done = run("eval", self.truth, self.truth)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for text in ("sim3, scale 1", "coverage 100.0 %", "of the path", "%"):
            self.assertIn(text, done.stdout)
        self.assertEqual(run("eval", self.truth, self.truth, "--quiet").stdout, "")

    def test_plot(self):
        picture = self.folder / "plot.png"
        self.assertEqual(run("eval", self.truth, self.truth, "--plot", picture).returncode, 0)
        self.assertEqual(picture.read_bytes()[:8], b"\x89PNG\r\n\x1a\n")
        other = self.file("other.txt", tum(spiral()))
        for files in ((other, self.truth), (self.truth, other)):
            self.refused("eval", *files, "--plot", other, says=["--plot", other, "overwrite"])
        self.assertEqual(other.read_text(), tum(spiral()))

    def test_bad_input(self):
        bad = self.file("bad.txt", "0 0 0 0 0 0 0 1\n1 0 0 zero 0 0 0 1\n")
        self.refused("eval", bad, self.truth, says=[f"{bad}:2", "field 4", "'zero'"])
        self.refused("eval", self.truth, bad, says=[f"{bad}:2", "field 4", "'zero'"])
        self.refused("eval", self.folder / "missing", self.truth, says=[self.folder / "missing", "no such file"])
        self.refused("eval", self.folder / "..", self.truth, says=["no trajectory in this folder"])
        self.refused("eval", self.truth, self.truth, "--max-dt", "-1", says=["--max-dt", "-1"])
        self.refused("eval", self.truth, self.truth, "--max-dt", "nan", says=["--max-dt", "nan"])
        self.refused("eval", self.truth, self.truth, "--plot", self.folder / "no" / "plot.png",
                     says=["plot.png", "No such file or directory"])
        self.refused("eval", self.truth, self.truth, "--config", bad, says=["--config"])
        short = self.file("short.txt", tum(spiral()[:2]))
        self.refused("eval", short, self.truth, says=["2 poses", "at least 3"])
        self.assertEqual(run("eval", self.truth, self.truth, "--align", "affine").returncode, 2)

    @unittest.skipUnless(os.path.exists("/dev/full"), "needs /dev/full")
    def test_full_standard_output(self):
        with open("/dev/full", "w", encoding="utf-8") as full:
            self.assertEqual(run("eval", self.truth, self.truth, stdout=full).returncode, 2)


if __name__ == "__main__":
    program.main()
