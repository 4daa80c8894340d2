"""Too little memory, for every subcommand: memory_test.py PROGRAM [unittest arguments]."""
import pathlib
import resource
import subprocess
import tempfile
import unittest

import program
from program import ProgramTest, run

LIMITS = (18, 30, 45, 70, 110, 170, 260)  # MiB of addresses; libraries alone take the most of them
STREET = None


def setUpModule():
    global STREET
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    STREET = pathlib.Path(folder.name) / "street"
    done = run("synth", "street", "--frames", 24, "--fps", 7.5, "--length", 4, "--out", STREET, "--quiet")
    assert (done.returncode, done.stderr) == (0, ""), done.stderr


def bal_text(cameras=40, points=400):
    text = [f"{cameras} {points} {cameras * points}"]
    text += [f"{c} {p} {(p % 20) - 10 + 0.1 * c} {p // 20 - 10}" for c in range(cameras) for p in range(points)]
    text += [f"0 0 0 {0.01 * c} 0 0 500 0 0" for c in range(cameras)]
    text += [f"{(p % 20) / 100} {p // 20 / 100} {-5 - p % 7 / 10}" for p in range(points)]
    return "\n".join(text) + "\n"


class Memory(ProgramTest):
    def contents(self):
        return {str(p.relative_to(self.folder)): p.read_bytes() for p in self.folder.rglob("*") if p.is_file()}

    def within(self, *arguments):
        """Runs under every limit: it ends well, or with one line that tells the cause and nothing is touched."""
        short = 0
        for limit in LIMITS:
            before = self.contents()
            size = limit << 20
            done = run(*arguments, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (size, size)))
            said = (limit, arguments[0], done.returncode, done.stderr)
            if done.returncode == 0:
                continue
            short += 1
            self.assertEqual(done.returncode, 1, said)
            self.assertIn("not enough memory", done.stderr.splitlines()[-1], said)
            for word in ("internal error", "damaged", "terminate", "cannot be loaded", "bad_alloc"):
                self.assertNotIn(word, done.stderr, said)
            self.assertEqual(self.contents(), before, said)
        return short

    def test_track(self):
        out = self.folder / "out"
        self.assertEqual(run("track", STREET, "--out", out, "--quiet").returncode, 0)
        self.assertGreater(self.within("track", STREET, "--out", out, "--threads", 2), 0)

    def test_video(self):
        video = self.folder / "street.mp4"
        subprocess.run(["ffmpeg", "-loglevel", "error", "-framerate", "7.5", "-i", STREET / "images" / "%06d.png",
                        "-c:v", "libx264", video], check=True)
        self.assertGreater(self.within("track", video, "--camera", STREET / "camera.yaml", "--out", self.folder / "out",
                                       "--threads", 2), 0)

    def test_solve(self):
        self.assertGreater(self.within("solve", STREET, "--out", self.folder / "out", "--threads", 2), 0)

    def test_adjust(self):
        problem = self.file("problem.txt", bal_text())
        self.assertGreater(self.within("adjust", problem, "--out", self.folder / "out", "--max-iterations", 3), 0)

    def test_synth(self):
        self.assertGreater(self.within("synth", "street", "--frames", 2, "--out", self.folder / "out"), 0)

    def test_plots(self):
        truth = STREET / "truth.txt"
        self.assertGreater(self.within("eval", truth, truth, "--plot", self.folder / "plot.png"), 0)
        self.assertGreater(self.within("camera", "show", STREET / "camera.yaml", "--plot", self.folder / "plot.png"), 0)


if __name__ == "__main__":
    program.main()
