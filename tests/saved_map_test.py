"""`raysfm track` with --save-map, --map and --localise, and `raysfm map merge`: saved_map_test.py PROGRAM [unittest arguments]."""
import hashlib
import json
import math
import os
import pathlib
import shutil
import sqlite3
import tempfile
import unittest

import program
from program import ProgramTest, run

ROOM = None  # a sequence of 60 frames, 512 x 384 pixels
SPLIT = 36
SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"))
KITCHEN = SHARED / "redkitchen-handheld"  # 420 frames


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


def needs(path):
    return unittest.skipUnless(path.exists(), f"no shared data: {path.name} (set RAYSFM_SHARED_DATA)")


class MergedMaps(ProgramTest):
    def mapped(self, name, source, first=0, last=None):
        """Map of frames [first, last) of a sequence."""
        part, path = self.folder / name, self.folder / f"{name}.map"
        (part / "images").mkdir(parents=True)
        for image in sorted((source / "images").iterdir())[first:last]:
            (part / "images" / image.name).symlink_to(image)
        (part / "times.txt").write_text("".join((source / "times.txt").read_text().splitlines(True)[first:last]))
        shutil.copy(source / "camera.yaml", part)
        done = run("track", part, "--out", self.folder / f"out-{name}", "--save-map", path, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        return path

    def merged(self, name, *maps):
        out = self.folder / name
        done = run("map", "merge", *maps, "--out", out)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertEqual(run("map", "check", out).returncode, 0)
        return out, done.stdout

    def worlds(self, path):
        with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as database:
            return [row[0] for row in database.execute("SELECT keyframes FROM world ORDER BY world")]

    @needs(KITCHEN)
    def test_two_halves_of_a_room_become_one_world(self):
        halves = [self.mapped("first", KITCHEN, 0, 241), self.mapped("second", KITCHEN, 180, 420)]
        before = [path.read_bytes() for path in halves]
        out, told = self.merged("merged.map", *halves)
        self.assertIn("second.map, world 0: joined to world 0", told)
        self.assertEqual(self.worlds(out), [self.worlds(halves[0])[0] + self.worlds(halves[1])[0]])
        self.assertEqual([path.read_bytes() for path in halves], before)
        self.assertEqual(out.read_bytes(), self.merged("again.map", *halves)[0].read_bytes())

        done = run("track", KITCHEN, "--map", out, "--localise", "--out", self.folder / "out", "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        report = json.loads((self.folder / "out" / "report.json").read_text())
        self.assertGreaterEqual(report["frames"]["posed"], 416)
        self.assertEqual(len(report["worlds"]), 1)
        judged = run("eval", self.folder / "out", KITCHEN / "truth.txt", "--json")
        self.assertEqual(judged.returncode, 0, judged.stderr)
        self.assertLess(json.loads(judged.stdout)["ate"]["rmse"], 0.05)

    @needs(KITCHEN)
    def test_other_places_stay_worlds_and_other_cameras_are_refused(self):
        kitchen, elsewhere = self.mapped("kitchen", KITCHEN, 0, 80), self.folder / "elsewhere"
        done = run("synth", "room", "--camera", KITCHEN / "camera.yaml", "--motion", "handheld", "--frames", 20, "--fps", 10,
                   "--length", 2, "--out", elsewhere, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        synthetic = self.mapped("synthetic", elsewhere)
        out, told = self.merged("both.map", kitchen, synthetic)
        self.assertEqual(self.worlds(out), self.worlds(kitchen) + self.worlds(synthetic))
        self.assertIn("synthetic.map, world 0: world 1\n", told)

        camera = self.file("other.yaml", (KITCHEN / "camera.yaml").read_text().replace("526.", "590."))
        other = self.folder / "other"
        done = run("synth", "room", "--camera", camera, "--motion", "handheld", "--frames", 12, "--fps", 10, "--length", 2,
                   "--out", other, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        tele = self.mapped("tele", other)
        kept = out.read_bytes()
        self.refused("map", "merge", kitchen, tele, "--out", out, says=["tele.map", "camera 0", "pixels off"])
        self.assertEqual(out.read_bytes(), kept)

    def test_what_cannot_be_merged_is_refused(self):
        room = self.mapped("room", ROOM, 0, 20)
        out = self.folder / "out.map"
        self.refused("map", "merge", room, "--out", out, says=["2 required"])
        self.refused("map", "merge", room, room, "--out", out, says=["room.map", "twice"])
        self.refused("map", "merge", room, self.folder / "none.map", "--out", out, says=["none.map"])
        copy = self.folder / "copy.map"
        shutil.copy(room, copy)
        self.refused("map", "merge", room, copy, "--out", copy, says=["--out", "copy.map"])
        copy.write_bytes(room.read_bytes()[:-100])
        self.refused("map", "merge", room, copy, "--out", out, says=["copy.map"])
        self.assertFalse(out.exists())


def sqlite_keyframes(path):
    with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as database:
        return [row[0] for row in database.execute("SELECT timestamp FROM keyframe ORDER BY world, keyframe")]


if __name__ == "__main__":
    program.main()
