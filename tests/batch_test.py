"""`raysfm batch`, on this machine and on clusters of it: batch_test.py PROGRAM [unittest arguments]."""
import csv
import ctypes
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import program
import slurm_node
from program import ProgramTest, run

SYSTEM_PYTHON = "/usr/bin/python3"
PR_SET_CHILD_SUBREAPER = 36  # of <sys/prctl.h>
# Times are in the other files of a result.
SAME = ["trajectory.txt", "keyframes.txt", "covariance.csv", "points.ply", "sparse/images.bin", "sparse/points3D.bin"]
FILMS = None  # a folder with three sequences and a list of them
ALONE = None  # their results, each by a run of its own
LIST = """# name   flags
'a street' --features 900
second --name "long one" --refine-lens off   # another

track third
"""
NAMES = ["a street", "long one", "third"]


def setUpModule():
    global FILMS, ALONE
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    FILMS, ALONE = pathlib.Path(folder.name) / "films", pathlib.Path(folder.name) / "alone"
    for seed, (name, flags) in enumerate(zip(NAMES, (["--features", 900], ["--refine-lens", "off"], []))):
        film = FILMS / ("second" if name == NAMES[1] else name)
        done = run("synth", "street", "--frames", 40, "--fps", 7.5, "--length", 6.3, "--samples", 1, "--seed", seed, "--out", film,
                   "--quiet")
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
        done = run("track", film, "--out", ALONE / name, *flags, "--quiet")
        assert (done.returncode, done.stderr) == (0, ""), done.stderr
    (FILMS / "list.txt").write_text(LIST)


def running_in(folder):
    """Processes that work on results in a folder."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"--out" in words and words[1:2] != [b"batch"] and any(w.startswith(os.fsencode(folder)) for w in words):
            found.append(int(path.parent.name))
    return found


class BatchTest(ProgramTest):
    def setUp(self):
        super().setUp()
        self.out = self.folder / "out"

    def batch(self, *arguments, videos=None, **options):
        return run("batch", videos or FILMS / "list.txt", "--out", self.out, *arguments, **options)

    def table(self):
        with open(self.out / "batch.csv", newline="") as file:
            return {row["name"]: row for row in csv.DictReader(file)}

    def assert_all_as_alone(self):
        for name in NAMES:
            for file in SAME:
                self.assertEqual((self.out / name / file).read_bytes(), (ALONE / name / file).read_bytes(), f"{name}/{file}")
        table = self.table()
        self.assertEqual(list(table), NAMES)
        for row in table.values():
            self.assertEqual((row["frames"], row["worlds"], row["exit"], row["reason"]), ("40", "1", "0", ""))
            self.assertGreater(int(row["posed"]), 30)

    def list_with_a_long_one(self, count=4000):
        """The list, and a video that takes long."""
        long = self.folder / "long"
        (long / "images").mkdir(parents=True)
        shutil.copy(FILMS / "third/camera.yaml", long)
        for i in range(count):
            (long / f"images/{i:06}.png").symlink_to(FILMS / f"third/images/{min(i % 78, 78 - i % 78):06}.png")
        text = "".join(f"'{FILMS / film}' --name '{name}' {flags}\n" for film, name, flags in
                       (("a street", NAMES[0], "--features 900"), ("second", NAMES[1], "--refine-lens off"), ("third", NAMES[2], "")))
        return self.file("list.txt", f"{long}\n" + text)


class Pieces(BatchTest):
    def test_a_long_video_is_cut_and_joined(self):
        films = self.file("list.txt", f"'{FILMS / 'a street'}' --features 900 --pieces 2 --overlap 2.5\n")
        done = self.batch(videos=films)
        self.assertEqual((done.returncode, done.stderr.count("done")), (0, 3), done.stderr)
        table = self.table()
        self.assertEqual(list(table), ["a street.piece-1", "a street.piece-2", "a street"])
        self.assertEqual([row["frames"] for row in table.values()], ["29", "29", "40"])
        self.assertEqual((table["a street"]["worlds"], table["a street"]["exit"]), ("1", "0"))
        whole = self.out / "a street"
        error = json.loads(run("eval", whole, FILMS / "a street/truth.txt", "--json").stdout)
        self.assertLess(error["ate"]["rmse"], 0.01 * error["length_m"])
        self.assertEqual(error["matched"], int(table["a street"]["posed"]))
        self.assertEqual(run("map", "check", whole / "map.raysfm").returncode, 0)
        report = json.loads((whole / "report.json").read_text())
        self.assertEqual(report["input"], json.loads((ALONE / "a street/report.json").read_text())["input"])
        settings = (self.out / "a street.piece-1/config.yaml").read_text().splitlines(True)
        of_the_piece = ("from:", "to:", "save-map:")
        self.assertEqual((whole / "config.yaml").read_text(), "".join(s for s in settings if not s.startswith(of_the_piece)))
        # Pictures of the whole are found, and those of a piece, which begins in the middle.
        for result, first in ((whole, 0), (self.out / "a street.piece-2", 11)):
            done = run("export", result, "--format", "colmap", "--images", FILMS / "a street", "--out", self.folder / "colmap")
            self.assertEqual(done.returncode, 0, done.stderr)
            names = sorted(p.name for p in (self.folder / "colmap/images").glob("*.png"))
            self.assertGreaterEqual(int(names[0][:6]), first)
        # Nothing is done twice; where a piece is made anew, so is the whole.
        before = (whole / "trajectory.txt").read_bytes()
        self.assertIn("has a result already (1 of 1)", self.batch(videos=films).stderr)
        (self.out / "batch/a street.piece-2.json").unlink()
        done = self.batch(videos=films)
        self.assertEqual(done.stderr.count("done"), 2, done.stderr)
        self.assertEqual((whole / "trajectory.txt").read_bytes(), before)

    def test_parts_do_the_pieces_and_the_summary_joins_them(self):
        films = self.file("list.txt", f"'{FILMS / 'a street'}' --features 900 --pieces 2 --overlap 2.5\n")
        for part in ("2/2", "1/2"):
            self.assertFalse((self.out / "a street").exists())
            self.assertEqual(self.batch("--part", part, videos=films).returncode, 0)
        done = self.batch("--summary", videos=films)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.table()["a street"]["frames"], "40")

    def test_what_cannot_be_cut_is_refused(self):
        for flags, words in (("--pieces 0", ["--pieces = '0'", "1 to"]), ("--pieces", ["--pieces", "missing"]),
                             ("--pieces 2 --overlap x", ["--overlap = 'x'"]),
                             ("--pieces 2 --overlap 1 --from 3", ["--from", "--pieces"])):
            done = self.batch(videos=self.file("list.txt", f"'{FILMS / 'a street'}' {flags}\n"))
            self.assertEqual(done.returncode, 2)
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            for word in ["line 1", *words]:
                self.assertIn(word, done.stderr)

    def test_what_cannot_be_cut_is_named_and_the_rest_goes_on(self):
        videos = self.file("list.txt", f"gone.mp4 --pieces 3\n'{FILMS}/second' --pieces 2\n'{FILMS}/third'\n")
        done = self.batch("--summary", videos=videos)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertEqual([row["exit"] for row in self.table().values()], ["2"] * 3)
        # A part has it as it has any other video.
        for part, code, says in (("1/3", 2, "gone: "), ("2/3", 2, "second: "), ("3/3", 0, "third: done")):
            done = self.batch("--part", part, videos=videos)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(says, done.stderr)
        done = self.batch(videos=videos)
        self.assertEqual(done.returncode, 2, done.stderr)
        self.assertIn("2 of 3 videos have no result", done.stdout)
        table = self.table()
        self.assertEqual([(name, row["exit"]) for name, row in table.items()], [("gone", "2"), ("second", "2"), ("third", "0")])
        self.assertIn("gone.mp4", table["gone"]["reason"])
        for word in ("--pieces = 2", "2.6", "overlap", "10 s"):
            self.assertIn(word, table["second"]["reason"])
        # Put right, it is done; gone again, what was made of it is left alone.
        self.file("list.txt", "gone.mp4 --pieces 2 --overlap 2.5\n")
        (self.folder / "gone.mp4").symlink_to(FILMS / "second")
        done = self.batch(videos=videos)
        self.assertEqual((done.returncode, done.stderr.count("done")), (0, 3), done.stderr)
        (self.folder / "gone.mp4").unlink()
        for flags in ([], ["--summary"]):
            done = self.batch(*flags, videos=videos)
            self.assertEqual((done.returncode, done.stderr.count("done")), (0, 0), done.stderr)
            self.assertEqual(self.table()["gone"]["frames"], "40")
        # Not so where the line has been changed.
        for flags in ("--pieces 3 --overlap 2.5", "--pieces 2 --overlap 2", "--pieces 2 --overlap 2.5 --features 900"):
            self.file("list.txt", f"gone.mp4 {flags}\n")
            self.assertEqual(self.batch(videos=videos).returncode, 2)
            self.assertIn("gone.mp4", self.table()["gone"]["reason"])


class List(BatchTest):
    def test_bad_lists(self):
        for text, says in (("", ["no videos"]), ("# nothing\n\n", ["no videos"]), ("a.mp4\n'b.mp4\n", ["line 2", "' is not closed"]),
                           ("--features 9 a.mp4\n", ["line 1", "must begin with"]), ("track\n", ["line 1", "must begin with"]),
                           ("a.mp4 --out x\n", ["line 1", "--out"]), ("a.mp4 --out=x\n", ["--out"]), ("a.mp4 --threads 3\n", ["--threads"]),
                           ("x/a.mp4\n\ny/a.mp4\n", ["line 3", "'a'", "line 1", "--name"]), ("a.mp4 --name\n", ["--name"]),
                           ("a.mp4 --name ../b\n", ["--name", "../b"]), ("a.mp4 --name ''\n", ["--name"]),
                           ("a.mp4 --name batch\n", ["--name"]), ("a.mp4 --name .hidden\n", ["--name"]),
                           (f"a.mp4 --name {'n' * 300}\n", ["--name", "200"]), (b"a\0b\n", ["line 1", "text"])):
            with self.subTest(text):
                self.refused("batch", self.file("bad.txt", text), "--out", self.out, says=says)
                self.assertFalse(self.out.exists())
        self.refused("batch", self.folder / "none.txt", "--out", self.out, says=["none.txt"])
        self.refused("batch", FILMS / "list.txt", "--out", self.file("file", "x"), says=["file"])
        for part in ("0/2", "3/2", "1", "a/b", "1/2/3", "/"):
            self.refused("batch", FILMS / "list.txt", "--out", self.out, "--part", part, says=["--part", part])
        self.refused("batch", FILMS / "list.txt", "--out", self.out, "--slurm", FILMS / "list.txt", says=["list.txt"])

    def test_words(self):
        """Names as a shell reads them; the program tells which it looked for."""
        videos = self.file("videos.txt", "'it'\\''s.mp4' --name a\n\"say \\\"x\\\" $y.mp4\" --name b\nwith\\ space.mp4 --name c\n"
                                         "caf\u00e9#1.mp4 --name d # no name\n")
        done = self.batch(videos=videos)
        self.assertEqual(done.returncode, 2)
        reasons = [row["reason"] for row in self.table().values()]
        for reason, name in zip(reasons, ("it's.mp4", 'say "x" $y.mp4', "with space.mp4", "caf\u00e9#1.mp4")):
            self.assertIn(name, reason)


class Local(BatchTest):
    def test_alone_or_several_at_once(self):
        for jobs in (1, 2):
            self.out = self.folder / f"out{jobs}"
            done = self.batch("--jobs", jobs)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assert_all_as_alone()
            for name in NAMES:
                self.assertIn(name, done.stdout)
                self.assertIn(f"{name}: done", done.stderr)
        done = self.batch("--quiet")
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))

    def test_what_is_missing_is_named_and_the_rest_goes_on(self):
        black = self.folder / "black"
        for i in range(4):
            self.file(f"black/{i}.pgm", b"P5 512 384 255\n" + bytes(512 * 384))
        videos = self.file("list.txt", f"gone.mp4\n{black} --camera '{FILMS}/third/camera.yaml'\n'{FILMS}/third' --fetures 3 --name flag\n"
                                       f"'{FILMS}/third' --help --name helped\n".replace(" --help", " --fps x") + f"'{FILMS}/third'\n")
        done = self.batch(videos=videos)
        self.assertEqual(done.returncode, 2)
        self.assertIn("4 of 5 videos have no result", done.stdout)
        table = self.table()
        self.assertEqual([row["exit"] for row in table.values()], ["2", "3", "2", "2", "0"])
        self.assertIn("gone.mp4", table["gone"]["reason"])
        self.assertRegex(table["black"]["reason"], "^too few corners: 0.*nearly black")
        self.assertIn("--fetures", table["flag"]["reason"])
        self.assertEqual((table["black"]["frames"], table["black"]["posed"]), ("4", "0"))
        # Put right, only what had no result is done.
        shutil.copytree(FILMS / "second", self.folder / "gone.mp4")
        done = self.batch(videos=videos)
        for name, says in (("gone", "done"), ("black", "has a result already"), ("third", "has a result already")):
            self.assertIn(f"{name}: {says}", done.stderr)
        self.assertEqual(self.table()["gone"]["exit"], "0")
        # Another line is another run.
        videos.write_text(f"'{FILMS}/third' --features 900\n")
        self.assertIn("not run yet", self.batch("--summary", videos=videos).stdout)
        self.assertIn("third: done", self.batch(videos=videos).stderr)

    def test_what_surely_has_no_result_is_not_tried_again(self):
        """`solve` leaves no report where it finds none."""
        (self.folder / "still").mkdir()
        for name in "abcd":
            (self.folder / f"still/{name}.png").symlink_to(FILMS / "third/images/000000.png")
        videos = self.file("list.txt", "solve still\n")
        for says in ("no motion", "has a result already"):
            done = self.batch(videos=videos)
            self.assertEqual(done.returncode, 3, done.stderr)
            self.assertIn(says, done.stderr)

    def test_a_crash_of_one_ends_no_other(self):
        videos = self.list_with_a_long_one()
        with subprocess.Popen([program.PROGRAM, "batch", videos, "--out", self.out, "--jobs", "2"], stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True) as running:
            while not (found := running_in(self.out / "long")):
                time.sleep(0.01)
            time.sleep(0.2)
            os.kill(found[0], signal.SIGSEGV)
            said = running.communicate(timeout=120)
        self.assertEqual(running.returncode, 128 + signal.SIGSEGV, said)
        row = self.table()["long"]
        self.assertEqual((row["exit"], row["reason"]), (str(128 + signal.SIGSEGV), "ended by a signal: Segmentation fault"))
        for name in NAMES:
            self.assertEqual(self.table()[name]["exit"], "0")

    def test_interrupted_and_resumed(self):
        for number, (how, code) in enumerate(((signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9))):
            self.out = self.folder / f"out{number}"
            shutil.rmtree(self.folder / "long", ignore_errors=True)
            videos = self.list_with_a_long_one()
            with subprocess.Popen([program.PROGRAM, "batch", videos, "--out", self.out, "--jobs", "2"], stdout=subprocess.PIPE,
                                  stderr=subprocess.PIPE, text=True) as running:
                while not (self.out / "batch" / f"{NAMES[0]}.json").exists():
                    self.assertIsNone(running.poll())
                    time.sleep(0.01)
                self.assertTrue(running_in(self.out / "long"))
                running.send_signal(how)
                said = running.communicate(timeout=60)
            self.assertEqual(running.returncode, code, said)
            deadline = time.monotonic() + 10
            while running_in(self.out) and time.monotonic() < deadline:
                time.sleep(0.05)
            self.assertEqual(running_in(self.out), [])
            self.assertFalse((self.out / "batch/long.json").exists())
            kept = (self.out / NAMES[0] / "report.json").stat().st_mtime_ns
            # The long one has become short; the finished one is left alone.
            shutil.rmtree(self.folder / "long")
            shutil.copytree(FILMS / "third", self.folder / "long")
            done = self.batch("--jobs", 2, videos=videos)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(f"{NAMES[0]}: has a result already", done.stderr)
            self.assertIn("long: done", done.stderr)
            self.assertEqual((self.out / NAMES[0] / "report.json").stat().st_mtime_ns, kept)
            for file in SAME:
                self.assertEqual((self.out / "long" / file).read_bytes(), (ALONE / "third" / file).read_bytes())
            videos.write_text("".join(videos.read_text().splitlines(True)[1:]))
            self.batch("--summary", videos=videos)
            self.assert_all_as_alone()

    def test_what_a_killed_batch_has_left_running_is_waited_for(self):
        """A job is told to end with its batch, and may take long to: it writes what it has after the batch is started again."""
        videos = self.list_with_a_long_one(400)
        # Orphans of this session go to this process: to one of another session they would be woken by the kernel as their batch ends.
        prctl = ctypes.CDLL(None).prctl
        self.assertEqual(prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0), 0)
        self.addCleanup(prctl, PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
        command = [program.PROGRAM, "batch", videos, "--out", self.out, "--jobs", "1"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
            log = self.out / "batch/long.log"
            while not log.exists() or "100 posed" not in log.read_text():
                self.assertIsNone(running.poll())
                time.sleep(0.01)
            job = running_in(self.out / "long")[0]
            os.kill(job, signal.SIGSTOP)
            running.kill()
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as again:
            while not (self.out / f"batch/{NAMES[2]}.json").exists():
                time.sleep(0.01)
            self.assertEqual(os.waitpid(job, os.WNOHANG), (0, 0), "not stopped any more")
            os.kill(job, signal.SIGCONT)
            os.waitpid(job, 0)
            said = again.communicate(timeout=120)
        self.assertEqual(again.returncode, 0, said)
        self.assertEqual(run("track", self.folder / "long", "--out", self.folder / "alone", "--quiet").returncode, 0)
        for file in SAME:
            self.assertEqual((self.out / "long" / file).read_bytes(), (self.folder / "alone" / file).read_bytes(), file)


class Clusters(BatchTest):
    def test_slurm(self):
        if reason := slurm_node.missing():
            self.skipTest(reason)
        try:
            node = self.enterContext(slurm_node.SlurmNode(self.folder))
        except OSError as failure:
            self.skipTest(str(failure))
        self.assertEqual(self.batch("--slurm", self.folder / "job.sh").returncode, 0)
        done = subprocess.run(["sbatch", "--wait", self.folder / "job.sh"], text=True, capture_output=True, env=node.environment,
                              timeout=120, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr + done.stdout)
        done = self.batch("--summary")
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assert_all_as_alone()

    def test_daemons_of_slurm_end_with_what_started_them(self):
        if reason := slurm_node.missing():
            self.skipTest(reason)
        code = ("import pathlib, slurm_node, sys\n"
                "with slurm_node.SlurmNode(pathlib.Path(sys.argv[1])): print('ready', flush=True); sys.stdin.read()\n")
        for number, how in enumerate((signal.SIGTERM, signal.SIGKILL)):
            folder = self.folder / str(number)
            folder.mkdir()
            with subprocess.Popen([sys.executable, "-c", code, folder], cwd=pathlib.Path(__file__).parent, stdin=subprocess.PIPE,
                                  stdout=subprocess.PIPE, text=True) as running:
                self.assertEqual(running.stdout.readline(), "ready\n")
                daemons = [int((folder / f"{name}.pid").read_text()) for name in ("munged", "slurmctld", "slurmd")]
                running.send_signal(how)
            deadline = time.monotonic() + 10
            while (left := [d for d in daemons if pathlib.Path(f"/proc/{d}/exe").exists()]) and time.monotonic() < deadline:
                time.sleep(0.05)
            self.assertEqual(left, [])

    def test_dask(self):
        if subprocess.run([SYSTEM_PYTHON, "-c", "import dask.distributed"], capture_output=True).returncode != 0:
            self.skipTest("no python3-distributed")
        self.assertEqual(self.batch("--dask", self.folder / "job.py").returncode, 0)
        done = subprocess.run([SYSTEM_PYTHON, self.folder / "job.py"], text=True, capture_output=True, timeout=300, cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr + done.stdout)
        self.assertEqual(self.batch("--summary").returncode, 0)
        self.assert_all_as_alone()

    def test_parts_are_all_of_the_list_once(self):
        for part in ("1/2", "2/2"):
            done = self.batch("--part", part)
            self.assertEqual((done.returncode, done.stdout), (0, ""), done.stderr)
            self.assertNotIn("has a result already", done.stderr)
        self.assertEqual(self.batch("--summary").returncode, 0)
        self.assert_all_as_alone()


if __name__ == "__main__":
    program.main()
