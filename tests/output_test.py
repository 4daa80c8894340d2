"""The output folder is replaced as a whole or not at all: output_test.py PROGRAM [unittest arguments].

RAYSFM_MOMENTS=N in the environment: ends a run at N random moments instead of 20.
"""
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import adjust_test
import program
import solve_test
from program import ProgramTest, run

MOMENTS = int(os.environ.get("RAYSFM_MOMENTS", 20))
PAGE = "report.html"  # not of every build; page_test.py looks at it
OTHER_SCENE = 30  # frames of it
STREET = None  # a sequence of 60 frames, 512 x 384 pixels


def setUpModule():
    global STREET
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a test started with nohup
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    STREET = pathlib.Path(folder.name) / "street"
    done = run("synth", "street", "--frames", 60, "--fps", 7.5, "--length", 9.4, "--samples", 1, "--out", STREET, "--quiet")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def poses(path):
    return [line.split() for line in path.read_text().splitlines() if line[0] != "#"]


class OutputTest(ProgramTest):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"

    def track(self, *arguments, source=None, **options):
        return run("track", source or STREET, "--out", self.out, "--quiet", *arguments, **options)

    def older_result(self):
        self.assertEqual(self.track("--features", 900).returncode, 0)
        return contents(self.out)

    def report(self, name="report.json"):
        return json.loads((self.out / name).read_text())

    def assert_whole(self):
        """Every file is of one run, and none is missing."""
        report = self.report()
        self.assertEqual(set(contents(self.out)) - {"failed.json"}, set(report["files"]))
        self.assertEqual(len(poses(self.out / "trajectory.txt")), report["worlds"][0]["frames"])
        self.assertEqual(len(poses(self.out / "keyframes.txt")), report["worlds"][0]["keyframes"])
        self.assertIn(b"element vertex %d\n" % report["worlds"][0]["points"], (self.out / "points.ply").read_bytes())
        return report

    def nothing_hidden(self):
        self.assertEqual([path for path in self.folder.rglob(".*raysfm-*")], [])

    def black(self):
        for i in range(4):
            self.file(f"black/{i}.pgm", b"P5 512 384 255\n" + bytes(512 * 384))
        return self.folder / "black"


class Worlds(OutputTest):
    def test_two_scenes_are_two_worlds(self):
        """Each file holds one of them, and eval gives each an error of its own."""
        other = self.folder / "other"
        run("synth", "corridor", "--frames", OTHER_SCENE, "--fps", 15, "--length", 2.2, "--out", other, "--quiet")
        both = self.folder / "both"
        shutil.copytree(STREET, both)
        for i in range(OTHER_SCENE):
            shutil.copy(other / f"images/{i:06}.png", both / f"images/{60 + i:06}.png")
        truth = poses(STREET / "truth.txt") + poses(other / "truth.txt")
        truth = [[f"{0.1 * i:.9f}", *pose[1:]] for i, pose in enumerate(truth)]
        (both / "times.txt").write_text("".join(pose[0] + "\n" for pose in truth))
        (both / "truth.txt").write_text("".join(" ".join(pose) + "\n" for pose in truth))
        done = run("track", both, "--out", self.out)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("in worlds/", done.stdout)

        report = self.assert_whole()
        self.assertEqual([world["folder"] for world in report["worlds"]], [".", "worlds/1"])
        self.assertEqual([world["frames"] for world in report["worlds"]], [60, OTHER_SCENE])
        self.assertEqual(report["closures"], [])
        second = self.out / "worlds/1"
        self.assertEqual({"worlds/1/" + name for name in contents(second)},
                         {name for name in report["files"] if name.startswith("worlds/1/")})
        self.assertEqual(set(contents(second)) | {"report.json", "config.yaml"},
                         {name for name in report["files"] if not name.startswith("worlds/")} - {PAGE})
        self.assertEqual([float(pose[0]) for pose in poses(self.out / "trajectory.txt")], [float(pose[0]) for pose in truth[:60]])
        self.assertGreaterEqual(float(poses(second / "keyframes.txt")[0][0]), 6)

        result = json.loads(run("eval", self.out, both, "--json").stdout)
        self.assertAlmostEqual(result["coverage"], 60 / (60 + OTHER_SCENE))
        self.assertEqual(result["coverage_all"], 1)
        for world in result["worlds"]:
            self.assertLess(world["ate"]["mean"], 0.01 * world["length_m"])

        # The next run has one world again.
        self.assertEqual(self.track().returncode, 0)
        self.assertFalse((self.out / "worlds").exists())


class OlderResult(OutputTest):
    def test_no_reconstruction(self):
        before = self.older_result()
        camera = ["--camera", STREET / "camera.yaml"]
        done = self.track(*camera, source=self.black())
        self.assertEqual(done.returncode, 3)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn("failed.json", done.stderr)
        failed = self.report("failed.json")
        self.assertEqual((failed["frames"]["total"], failed["frames"]["posed"]), (4, 0))
        after = contents(self.out)
        del after["failed.json"]
        self.assertEqual(after, before)
        # Without an older result the report is there as ever, and a result replaces it and failed.json.
        self.out = self.folder / "new"
        self.assertEqual(self.track(*camera, source=self.folder / "black").returncode, 3)
        self.assertEqual(self.report()["frames"]["posed"], 0)
        self.assertFalse((self.out / "failed.json").exists())
        self.file("new/failed.json", "{}")
        self.assertEqual(self.track().returncode, 0)
        self.assert_whole()
        self.assertFalse((self.out / "failed.json").exists())

    def test_interrupted_before_the_start(self):
        before = self.older_result()
        black = self.black()
        for i in range(4, 3000):
            (black / f"{i}.pgm").symlink_to("0.pgm")
        command = [program.PROGRAM, "track", black, "--camera", STREET / "camera.yaml", "--out", self.out]
        with subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
            while "frame" not in running.stderr.readline():
                self.assertIsNone(running.poll())
            running.send_signal(signal.SIGINT)
            running.communicate(timeout=60)
        self.assertEqual(running.returncode, 130)
        failed = self.report("failed.json")
        self.assertTrue(failed["interrupted"])
        self.assertEqual(failed["frames"]["in_input"], 3000)
        self.assertLess(failed["frames"]["total"], 3000)
        after = contents(self.out)
        del after["failed.json"]
        self.assertEqual(after, before)

    def test_files_of_a_solve_run_go_those_of_the_user_stay(self):
        self.file("out/notes.txt", "mine")
        self.file("out/sparse/project.ini", "mine")
        self.file("out/lens.csv", "of solve")
        self.file("out/lens.png", "of solve")
        self.file("out/report.json", '{"lens": "fixed", "frames": {"posed": 3}}')
        self.assertEqual(self.track().returncode, 0)
        report = self.report()
        self.assertEqual(set(contents(self.out)), {*report["files"], "notes.txt", "sparse/project.ini"})
        self.assertEqual((self.out / "notes.txt").read_text(), "mine")
        # lens.csv of a sequence is no file of an older result.
        self.file("out/lens.csv", "mine")
        self.assertEqual(self.track().returncode, 0)
        self.assertEqual((self.out / "lens.csv").read_text(), "mine")

    def test_each_command_leaves_its_own_files_and_those_of_the_user(self):
        tracks = self.file("tracks.csv", solve_test.text(solve_test.Scene().rows(lambda j: 700 + 60 * j)))
        problem = self.file("problem.txt", adjust_test.Bal(noise=0.5).text())
        self.file("out/notes.txt", "mine")
        common = {"config.yaml", "points.ply", "report.json"}
        posed = common | {"trajectory.txt", "keyframes.txt", "covariance.csv", "sparse/cameras.bin", "sparse/images.bin",
                          "sparse/points3D.bin"}
        solve, adjust, track = ("solve", tracks, "--size", "800x600"), ("adjust", problem), ("track", STREET)
        for command, files in ((solve, posed | {"lens.csv", "lens.png"}), (adjust, common | {"problem.txt"}), (track, posed),
                               (adjust, common | {"problem.txt"}), (solve, posed | {"lens.csv", "lens.png"})):
            done = run(*command, "--out", self.out, "--quiet")
            self.assertEqual(done.returncode, 0, done.stderr)
            report = self.report()
            self.assertEqual(report["command"], command[0])
            self.assertEqual(set(report["files"]) - {PAGE}, files)
            self.assertEqual(set(contents(self.out)), {*report["files"], "notes.txt"})

    def test_a_report_reaches_no_file_outside(self):
        outside = self.file("outside.txt", "mine")
        self.file("out/report.json", json.dumps({"files": ["../outside.txt", str(outside)], "frames": {"posed": 3}}))
        self.assertEqual(self.track().returncode, 0)
        self.assertEqual(outside.read_text(), "mine")
        self.nothing_hidden()

    def test_limit_of_file_sizes(self):
        before = self.older_result()
        limit = ["sh", "-c", 'ulimit -f 40; exec "$@"', "sh", program.PROGRAM, "track", STREET, "--out", self.out, "--quiet"]
        done = subprocess.run([str(word) for word in limit], stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn(str(self.out), done.stderr)
        self.assertIn("File too large", done.stderr)
        self.assertEqual(contents(self.out), before)
        self.nothing_hidden()

    @unittest.skipUnless(os.geteuid() == 0, "only root mounts")
    def test_full_disk(self):
        """Both where the folder is a disk of its own and where it is below one."""
        disk = self.folder / "disk"
        for self.out in (disk, disk / "out"):
            disk.mkdir(exist_ok=True)
            mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", disk], capture_output=True)
            if mounted.returncode != 0:
                self.skipTest("tmpfs cannot be mounted here")
            try:
                before = self.older_result()
                room = os.statvfs(disk)
                (disk / "filler").write_bytes(bytes(room.f_bavail * room.f_frsize - 100_000))
                done = self.track()
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertIn("No space left on device", done.stderr)
                (disk / "filler").unlink()
                self.assertEqual(contents(self.out), before)
                self.nothing_hidden()
                self.assertEqual(self.track().returncode, 0)
                self.assert_whole()
            finally:
                subprocess.run(["umount", disk], check=True)

    def test_inputs_are_not_replaced(self):
        camera = self.file("out/config.yaml", (STREET / "camera.yaml").read_text())
        self.refused("track", STREET, "--camera", camera, "--out", self.out, "--quiet",
                     says=["--out", "overwrite", camera])
        points = self.file("out/points.ply", "a video, let us say")
        self.refused("track", points, "--camera", camera, "--out", self.folder, says=["points.ply"])
        (self.out / "points.ply").write_bytes((STREET / "images/000000.png").read_bytes())
        self.refused("track", points, "--camera", STREET / "camera.yaml", "--out", self.out, says=["overwrite", points])


class Moments(OutputTest):
    """Whenever a run ends, the old result is there whole or the new one is."""

    def end_at(self, seconds, which, writing):
        """Starts a run and ends it after the time, or that long after it began to write."""
        command = [program.PROGRAM, "track", STREET, "--out", self.out, "--features", "800"]
        with subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
            while writing and running.poll() is None and not list(self.folder.glob(".out.raysfm-*")):
                time.sleep(0.001)
            time.sleep(seconds)
            if running.poll() is None:
                running.send_signal(which)
            running.wait(timeout=120)
        return running.returncode

    def test_random_moments(self):
        before = self.older_result()
        start = time.monotonic()
        self.assertEqual(run("track", STREET, "--out", self.folder / "full", "--features", 800, "--quiet").returncode, 0)
        duration = time.monotonic() - start
        chance = random.Random(7)
        outcomes = {"old": 0, "new": 0}
        for moment in range(MOMENTS):
            shutil.rmtree(self.out)
            for name, content in before.items():
                self.file("out/" + name, content)
            which = (signal.SIGTERM, signal.SIGKILL, signal.SIGHUP, signal.SIGPIPE)[moment % 4]
            writing = moment % 8 >= 4
            after = chance.uniform(0, 0.05 if writing else 1.1 * duration)
            code = self.end_at(after, which, writing)
            with self.subTest(moment=moment, signal=which.name, after=after, writing=writing):
                self.assertIn(code, (0, 128 + which, -which))
                now = contents(self.out)
                failed = now.pop("failed.json", None)
                outcomes["old" if now == before else "new"] += 1
                if now != before:
                    self.assertIn("features: 800\n", now["config.yaml"].decode())
                    self.assertEqual(self.assert_whole()["interrupted"], code == 128 + which)
                    self.assertIsNone(failed)
                elif which != signal.SIGKILL and code > 0:
                    self.assertTrue(json.loads(failed)["interrupted"])
                for left in self.folder.glob(".out.raysfm-*"):
                    self.assertEqual(code, -which)
                    shutil.rmtree(left)
        self.assertTrue(all(outcomes.values()), outcomes)

    def test_a_closed_terminal_or_pipe_keeps_what_there_is(self):
        for which in (signal.SIGHUP, signal.SIGPIPE):
            command = [program.PROGRAM, "track", STREET, "--out", self.out, "--features", "3000"]
            with subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as running:
                while b"started" not in running.stderr.readline():
                    self.assertIsNone(running.poll())
                if which == signal.SIGPIPE:
                    running.stderr.close()  # it learns of that when it next says something
                for _ in range(2):
                    running.send_signal(which)
                running.wait(timeout=60)
            self.assertEqual(running.returncode, 128 + which)
            report = self.assert_whole()
            self.assertTrue(report["interrupted"])
            self.assertGreater(report["frames"]["posed"], 0)
            self.assertEqual(report["segments"][-1]["reason"], "interrupted")


if __name__ == "__main__":
    program.main()
