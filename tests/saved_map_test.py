"""`raysfm track` with --save-map, --map and --localise: saved_map_test.py PROGRAM [unittest arguments]."""
import hashlib
import json
import math
import pathlib
import shutil
import sqlite3
import tempfile
import unittest

import program
from program import ProgramTest, run

ROOM = None  # a sequence of 60 frames, 512 x 384 pixels
SPLIT = 36


def setUpModule():
    global ROOM
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    ROOM = pathlib.Path(folder.name) / "room"
    done = run("synth", "room", "--motion", "handheld", "--frames", 60, "--fps", 10, "--length", 3, "--out", ROOM, "--quiet")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def trajectory(path):
    rows = [line.split() for line in path.read_text().splitlines() if not line.startswith("#")]
    return {round(float(r[0]), 3): [float(v) for v in r[1:4]] for r in rows}


class SavedMaps(ProgramTest):
    def part(self, name, first, last):
        """Frames [first, last) of the room, with their time stamps."""
        part = self.folder / name
        (part / "images").mkdir(parents=True)
        for image in sorted((ROOM / "images").iterdir())[first:last]:
            shutil.copy(image, part / "images")
        (part / "times.txt").write_text("".join((ROOM / "times.txt").read_text().splitlines(True)[first:last]))
        shutil.copy(ROOM / "camera.yaml", part)
        return part

    def track(self, part, *options):
        out = self.folder / f"out-{part.name}"
        done = run("track", part, "--out", out, "--quiet", *options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return out

    def mapped(self):
        """The map of the first frames, and its run."""
        path = self.folder / "room.map"
        return path, self.track(self.part("before", 0, SPLIT), "--save-map", path)

    def expect_one_world(self, before, after):
        """Poses of both runs are those of the truth by one similarity: ratios of distances between frames agree."""
        estimate = {**trajectory(before / "trajectory.txt"), **trajectory(after / "trajectory.txt")}
        truth = trajectory(ROOM / "truth.txt")
        times = sorted(set(estimate) & set(truth))
        self.assertGreater(len(times), 50)
        ratios = [math.dist(estimate[a], estimate[b]) / math.dist(truth[a], truth[b])
                  for a in times for b in times if a < times[SPLIT // 2] and b > times[-10]]
        ratios.sort()
        middle = ratios[len(ratios) // 2]
        self.assertLess(ratios[-1] / middle, 1.02)
        self.assertGreater(ratios[0] / middle, 0.98)

    def test_later_frames_are_localised_in_a_map_that_stays_as_it_is(self):
        path, before = self.mapped()
        self.assertEqual(run("map", "check", path).returncode, 0)
        told = hashlib.sha256(path.read_bytes()).digest()
        after = self.track(self.part("after", SPLIT, 60), "--map", path, "--localise")
        self.assertEqual(hashlib.sha256(path.read_bytes()).digest(), told)
        report = json.loads((after / "report.json").read_text())
        self.assertEqual(report["frames"]["posed"], 24)
        self.assertEqual(len(report["worlds"]), 1)
        self.expect_one_world(before, after)

    def test_a_map_grows_from_run_to_run(self):
        path, before = self.mapped()
        frames = len(sqlite_keyframes(path))
        after = self.track(self.part("after", SPLIT, 60), "--map", path, "--save-map", path)
        self.assertEqual(run("map", "check", path).returncode, 0)
        times = sqlite_keyframes(path)
        self.assertGreater(len(times), frames)
        self.assertEqual(times, sorted(times))
        self.assertGreaterEqual(times[-1], 0.1 * SPLIT)
        self.expect_one_world(before, after)

    def test_another_place_is_not_recognised(self):
        path, _ = self.mapped()
        board = self.folder / "board"
        self.assertEqual(run("synth", "corridor", "--frames", 20, "--fps", 10, "--length", 2, "--out", board, "--quiet").returncode, 0)
        done = run("track", board, "--out", self.folder / "out", "--map", path, "--localise", "--quiet")
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn("not recognised in the saved map", done.stderr)

    def test_what_cannot_be_is_refused(self):
        part, out = self.part("some", 0, 4), self.folder / "out"
        track = ["track", part, "--out", out]
        self.refused(*track, "--localise", says=["--localise", "--map"])
        self.refused(*track, "--map", self.folder / "none.map", says=["none.map"])
        self.refused(*track, "--map", ROOM / "camera.yaml", says=["camera.yaml"])
        path, _ = self.mapped()
        self.refused(*track, "--map", path, "--localise", "--save-map", path, says=["--localise", "--save-map"])
        self.refused(*track, "--map", path, "--loops", "off", says=["--map", "--loops"])
        path.write_bytes(path.read_bytes()[:-100])
        self.refused(*track, "--map", path, says=[path.name])

    def test_a_map_of_other_cameras_is_refused(self):
        path, _ = self.mapped()
        small = self.folder / "small"
        camera = self.file("small.yaml", (ROOM / "camera.yaml").read_text().replace("512, 384", "256, 192"))
        self.assertEqual(run("synth", "room", "--camera", camera, "--frames", 3, "--out", small, "--quiet").returncode, 0)
        self.refused("track", small, "--out", self.folder / "out", "--map", path, says=["room.map", "512 x 384", "256 x 192"])


def sqlite_keyframes(path):
    with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as database:
        return [row[0] for row in database.execute("SELECT timestamp FROM keyframe ORDER BY world, keyframe")]


if __name__ == "__main__":
    program.main()
