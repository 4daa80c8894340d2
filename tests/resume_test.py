"""`raysfm track --resume`: resume_test.py PROGRAM [unittest arguments]."""
import json
import os
import pathlib
import random
import signal
import subprocess
import tempfile
import time
import unittest

import program
from program import ProgramTest, run

SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"))
KITCHEN = SHARED / "redkitchen-handheld"  # 420 frames, a calibration that is refined
ROOM = None  # 12 frames


def setUpModule():
    global ROOM
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    ROOM = pathlib.Path(folder.name) / "room"
    done = run("synth", "room", "--motion", "handheld", "--frames", 12, "--fps", 10, "--length", 2, "--out", ROOM, "--quiet")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def result(folder):
    """All files, without what tells times."""
    files = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    files.pop("report.html", None)  # has the report
    report = json.loads(files.pop("report.json"))
    del report["timing"]
    return files, report


class Resume(ProgramTest):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"
        self.checkpoint = self.folder / ".out.checkpoint"

    def track(self, source, *options, code=0):
        done = run("track", source, "--out", self.out, "--resume", *options)
        self.assertEqual(done.returncode, code, done.stderr)
        return done.stderr

    def kill(self, source, *options, after):
        """Starts a run and kills it so many seconds after its first checkpoint."""
        with subprocess.Popen([program.PROGRAM, "track", source, "--out", self.out, "--resume", *options],
                              stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as started:
            while started.poll() is None and not self.checkpoint.exists():
                time.sleep(0.01)
            time.sleep(after)
            started.send_signal(signal.SIGKILL)
        return started.returncode == -signal.SIGKILL

    def kitchen(self):
        """There and back, with a loss on the way: 760 frames."""
        images = sorted((KITCHEN / "images").iterdir())
        blind = self.file("blind.jpg", b"no image")
        film = images[:200] + 20 * [blind] + images[240:] + images[:60:-1]
        for i, image in enumerate(film):
            (self.folder / "film").mkdir(exist_ok=True)
            (self.folder / "film" / f"{i:06}.jpg").symlink_to(image)
        return self.folder / "film", "--camera", KITCHEN / "camera.yaml"

    @unittest.skipUnless(KITCHEN.exists(), f"no shared data: {KITCHEN.name} (set RAYSFM_SHARED_DATA)")
    def test_a_run_that_was_killed_goes_on_with_the_same_bytes(self):
        film = self.kitchen()
        self.assertIn("nothing to go on from", self.track(*film))
        self.assertFalse(self.checkpoint.exists())
        whole = result(self.out)
        killed = 0
        for after in (0, random.uniform(0, 1), random.uniform(0.5, 2)):
            if not self.kill(*film, "--threads", "1", after=after):
                continue
            killed += 1
            self.assertTrue(self.checkpoint.exists())
            self.assertIn("goes on from frame", self.track(*film))
            self.assertEqual(result(self.out), whole, f"{after} s after the first checkpoint")
            self.assertFalse(self.checkpoint.exists())
        self.assertGreater(killed, 0)

    @unittest.skipUnless(KITCHEN.exists(), f"no shared data: {KITCHEN.name} (set RAYSFM_SHARED_DATA)")
    def test_what_is_not_of_this_run_is_not_gone_on_from(self):
        film = self.kitchen()
        if not self.kill(*film, after=0):
            self.skipTest("too fast to be killed")
        left = self.checkpoint.read_bytes()
        track = ["track", *film, "--out", self.out, "--resume"]
        self.refused(*track, "--window", 12, "--quiet", says=[self.checkpoint.name, "window: 12"])
        self.refused("track", ROOM, "--out", self.out, "--resume", "--quiet", says=[self.checkpoint.name])
        (self.folder / "film" / "000003.jpg").rename(self.folder / "film" / "000003b.jpg")
        self.refused(*track, "--quiet", says=[self.checkpoint.name, "the input has others"])
        self.assertEqual(self.checkpoint.read_bytes(), left)

    def test_a_checkpoint_that_is_not_whole_is_as_if_it_were_not_there(self):
        self.track(ROOM)
        whole = result(self.out)
        for content in (b"", b"raysfm checkpoint 6\n", b"raysfm checkpoint 6\n" + 100 * b"\xff", b"something else"):
            self.checkpoint.write_bytes(content)
            self.assertIn("starts anew", self.track(ROOM))
            self.assertEqual(result(self.out), whole)


if __name__ == "__main__":
    program.main()
