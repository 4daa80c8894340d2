"""Every command of README.md and docs/*.md is run, and their Python: docs_commands_test.py PROGRAM [unittest arguments].

Each page has a folder of its own, with the files that its commands name (FILES), in which bash runs them one after the
other as they are typed, but for what SHORTER takes from them and for what cannot be run here (NOT_RUN, with the reason).
The films are rendered; docs/first-half-hour.md is run on a video of a real kitchen; clusters are of this machine alone.
What a page names between words, and what docs/results says its figures were made by, is not run, but must be there.
"""
import bz2
import http.client
import itertools
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
import unittest

import adjust_test
import doc_pages
import program
import slurm_node
import solve_test
from doc_pages import OURS, PAGES, RESULTS, ROOT
from program import run

SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", ROOT.parent / "shared" / "data"))
KITCHEN, BOARDS = SHARED / "redkitchen-handheld/first200.mp4", SHARED / "boards/pinhole-stereo"
PYTHON = "/usr/bin/python3"  # that of Debian, for which the package is made

# What of a command is run otherwise: page or "", what is looked for, what it becomes.
SHORTER = [
    ("", r"( synth .*?) --frames \d+", r"\1"),
    ("", r"( synth .*?) --samples \d+", r"\1"),
    ("", r"( synth (?!--list).*)", r"\1 --frames 1 --samples 1"),
    ("", r"( view (?!.*--html).*)$", r"\1 --port {port}"),
    ("", r" --view$", " --view {port}"),
    ("", r"\bblender --python", "blender --background --python"),
    ("README.md", "board.mp4 --out my_camera.yaml", "board.mp4 --out of_the_board.yaml"),  # another camera filmed the rest
    ("synth.md", "NAME", "lba09-1-pinhole"),
    ("batch.md", "--to 310", "--to 2.9"),  # of a film of 4.8 seconds
    ("batch.md", "--from 300", "--from 1.9"),
    ("batch.md", "(?=raysfm batch list.txt --out DIR --dask)", "rm -r DIR && "),  # all of it anew
    ("batch.md", "tcp://head:8786", "{dask}"),
    # Which files are compiled to what is there, nothing is compiled.
    ("python.md", r"^cmake -S \. -B build (.*)--build build (.*)$", r"cmake -S {root} -B configured \1--build configured \2 -- -n"),
]
# How a command begins, and why it is not run here.
NOT_RUN = {
    "scripts/package": "it builds for minutes; tests/package/run packs, installs on a bare system and tracks there",
    "sudo apt-get install ./build-package/": "it changes this machine; tests/package/run does it on a bare system",
    "docker build": "it needs a daemon of docker, and builds for minutes what tests/package/run installs without",
}
# What the Python of a page takes for granted.
PRELUDE = "import numpy\nimage, timestamp, use = numpy.zeros((240, 320), numpy.uint8), 0.0, print\n"
# What a page takes for granted that another one tells.
BEFORE = {
    "exports.md": ["raysfm track my_video.mp4 --out out/"],
    "page.md": ["raysfm track my_video.mp4 --out out/"],
    "saved_map.md": [f"raysfm track my_video.mp4 --camera my_camera.yaml --out {name} --save-map {name}.map" for name in ("place", "garden")],
    "README.md": ["raysfm track my_video.mp4 --out out/", "mkdir -p my_project/sparse && cp -rv out/sparse my_project/sparse/0"],
}
CAMERA = """raysfm_camera: 1
cameras:
  - {{name: cam, model: pinhole, resolution: [{}, {}], intrinsics: {{fx: {}, fy: {}, cx: {}, cy: {}}}}}
"""


def camera(width, height, focal, cx=None, cy=None):
    return CAMERA.format(width, height, focal, focal, (width - 1) / 2 if cx is None else cx, (height - 1) / 2 if cy is None else cy)


def tracks(flat=False):
    """Corners of a rendered scene in images of 640 x 480."""
    scene = solve_test.Scene(flat=flat)
    moved = [(j, i, u - 80, v - 60) for j, i, u, v in scene.rows(lambda _: 500)]
    return scene, solve_test.text(row for row in moved if 0 <= row[2] < 640 and 0 <= row[3] < 480)


def filmed(folder, pattern, *options, to):
    subprocess.run(["ffmpeg", "-loglevel", "error", *options, "-i", str(folder / pattern), "-c:v", "libx264", "-crf", "18",
                    "-pix_fmt", "yuv420p", to], check=True)


def make_files(folder):
    """FILES: all that any page names, but for what its own commands make."""
    # A lens that bends, as every one does.
    (folder / "my_camera.yaml").write_text(camera(320, 240, 280).replace("pinhole", "radtan").replace("}}", ", k1: -0.12, k2: 0.02, p1: 0, p2: 0}}"))
    done = run("synth", "room", "--motion", "orbit", "--frames", 48, "--camera", folder / "my_camera.yaml", "--samples", 1,
               "--out", folder / "film", "--quiet")
    assert done.returncode == 0, done.stderr
    filmed(folder / "film/images", "%06d.png", "-framerate", "10", to=folder / "my_video.mp4")
    for name in ("monday", "tuesday", "phone", "hours", "video"):
        shutil.copy(folder / "my_video.mp4", folder / f"{name}.mp4")
    for name in ("phone", "camera"):
        shutil.copy(folder / "my_camera.yaml", folder / f"{name}.yaml")
    shutil.copy(folder / "film/truth.txt", folder)
    (folder / "photos").mkdir()
    for image in sorted((folder / "film/images").iterdir())[::4]:
        shutil.copy(image, folder / "photos")
    (folder / "list.txt").write_text("my_video.mp4 --camera my_camera.yaml\nhours.mp4 --camera phone.yaml --pieces 2 --overlap 1\n")
    if BOARDS.exists():
        for name in ("left", "right"):
            for image in BOARDS.glob(f"{name}*.jpg"):
                shutil.copy(image, folder)
        filmed(folder, "left*.jpg", "-framerate", "1", "-pattern_type", "glob", to=folder / "board.mp4")
    (folder / "tracks.csv").write_text(tracks()[1])
    flat, text = tracks(flat=True)
    (folder / "left.csv").write_text(text)
    (folder / "board.csv").write_text("point,x,y,z\n" + "".join(f"{i},{x},{y},{z}\n" for i, (x, y, z) in enumerate(flat.points)))
    (folder / "problem-49-7776-pre.txt.bz2").write_bytes(bz2.compress(adjust_test.Bal(noise=0.3).text().encode()))
    (folder / "of_basalt.yaml").write_text(camera(320, 240, 280))
    done = run("camera", "convert", folder / "of_basalt.yaml", "--to", "basalt", "--out", folder / "calib.json")
    assert done.returncode == 0, done.stderr
    for name, words in {"a": (640, 480, 520), "b": (640, 480, 900, 330, 231), "c": (800, 600, 600), "d": (512, 384, 350, 260, 189)}.items():
        (folder / f"{name}.yaml").write_text(camera(*words))


def make_clone(folder):
    """What a clone has after scripts/build: the program, and scripts, of which `build` finds all done."""
    (folder / "scripts").mkdir()
    shutil.copytree(ROOT / "scripts/recipes", folder / "scripts/recipes")
    demo = (ROOT / "scripts/demo").read_text()
    shorter = demo.replace("--frames 445 --fps 7.5 --length 70", "--frames 20 --fps 7.5 --length 3.2 --samples 1")
    assert shorter != demo
    for name, text in {"demo": shorter, "build": "#!/bin/sh\nexit 0\n"}.items():
        (folder / "scripts" / name).write_text(text)
        (folder / "scripts" / name).chmod(0o755)
    built = pathlib.Path(program.PROGRAM).resolve()
    (folder / "build").mkdir()
    (folder / "build/raysfm").symlink_to(built)
    (folder / "build/python").symlink_to(built.parent / "python")
    (folder / "build/python3").symlink_to(PYTHON)


# A cluster of Dask on this machine, until its input ends.
DASK = """
import sys
from dask.distributed import LocalCluster
with LocalCluster(n_workers=1, threads_per_worker=2, dashboard_address=None) as cluster:
    print(cluster.scheduler_address, flush=True)
    sys.stdin.read()
"""


def not_run(line):
    return next((reason for begin, reason in NOT_RUN.items() if line.startswith(begin)), None)


def shortened(page, line):
    for of, pattern, becomes in SHORTER:
        if of in ("", page.name):
            line = re.sub(pattern, becomes, line)
    return line.replace("{port}", str(slurm_node.free_port())).replace("{root}", str(ROOT))


def made_by(line):
    """The files and folders that it says it writes. A batch for a cluster only writes the script."""
    script = re.findall(r"--(?:slurm|dask) (\S+)", line)
    return script or re.findall(r"--(?:out|plot|html|save-map) (\S+)", line)


def newest(path):
    """When something in it was written last; 0, where it is not there."""
    return max((p.stat().st_mtime_ns for p in [path, *path.rglob("*")] if p.exists()), default=0)


class Commands(unittest.TestCase):
    FILES = None  # the folder that each page begins with
    KEPT = {}  # results by the command that made them, for pages that begin alike

    @classmethod
    def setUpClass(cls):
        if not shutil.which("ffmpeg"):
            raise unittest.SkipTest("needs ffmpeg")
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.FILES = pathlib.Path(folder.name) / "files"
        cls.FILES.mkdir()
        make_files(cls.FILES)
        make_clone(cls.FILES)
        cls.results = pathlib.Path(folder.name) / "results"

    def setUp(self):
        self.environment = dict(os.environ)

    def folder(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        return pathlib.Path(shutil.copytree(self.FILES, pathlib.Path(folder.name) / "here", symlinks=True))

    def bash(self, folder, line, text=""):
        path = f"{folder / 'build'}:{os.environ['PATH']}"
        return subprocess.Popen(["bash", "-euo", "pipefail", "-c", line], cwd=folder, env=self.environment | {"PATH": path}, text=True,
                                stdin=subprocess.PIPE if text else subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def done(self, folder, line, text=""):
        told, said = (running := self.bash(folder, line, text)).communicate(text or None, timeout=600)
        self.assertEqual(running.returncode, 0, f"{line}\n{told}{said}")
        return told

    def served(self, folder, line):
        """It answers until Ctrl-C."""
        running = self.bash(folder, "exec " + line)
        self.addCleanup(running.communicate)
        self.addCleanup(running.kill)
        where = re.search(r"127\.0\.0\.1:(\d+)", running.stdout.readline())
        self.assertTrue(where, line)
        connection = http.client.HTTPConnection("127.0.0.1", int(where.group(1)), timeout=60)
        connection.request("GET", "/")
        self.assertEqual(connection.getresponse().status, 200, line)
        running.send_signal(signal.SIGINT)
        self.assertEqual(running.wait(60), 0, line)

    def dask_cluster(self):
        """Its address. It lasts as long as the test."""
        cluster = subprocess.Popen([PYTHON, "-c", DASK], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.addCleanup(cluster.communicate)
        return cluster.stdout.readline().strip()

    def carried_out(self, page, folder, line):
        known = (page.name == "first-half-hour.md", OURS.sub("raysfm ", line))
        line = shortened(page, line)
        if known in self.KEPT:
            shutil.copytree(self.KEPT[known], folder / made_by(line)[0], dirs_exist_ok=True)
            return
        if "{dask}" in line:
            line = line.replace("{dask}", self.dask_cluster())
        if line.startswith("sbatch ") and "SLURM_CONF" not in self.environment:
            (folder / "slurm").mkdir()
            self.environment = self.enterContext(slurm_node.SlurmNode(folder / "slurm")).environment
        if re.search(r" view (?!.*--html)", line):
            self.served(folder, line)
            return
        before = {folder / name: newest(folder / name) for name in made_by(line)}
        told = self.done(folder, line)
        for path, time_before in before.items():
            self.assertGreater(newest(path), time_before, f"{line}: {path.name} was not written")
        # A job of Dask tells its errors alone.
        self.assertTrue(told or made_by(line) or re.search(r"python3$|job\.py", line), f"{line} told nothing and made nothing")
        if re.fullmatch("raysfm (track|solve) my_video.mp4 --out out/", known[1]):
            self.KEPT[known] = shutil.copytree(folder / "out", self.results / str(len(self.KEPT)))

    def missing(self, folder, line):
        """What is missing here for a command, or None."""
        if re.search(r"board\.mp4|left\*", line) and not BOARDS.exists():
            return "no shared data"
        if re.search(r" view |--view", line) and not (folder / "out/report.html").exists():
            return "this build has no page"
        if "raysfm" in line and "python3" in line and not list((folder / "build/python/raysfm").glob("*.so")):
            return "this build has no Python package"
        if line.startswith("sbatch ") and (reason := slurm_node.missing()):
            return reason
        if line.startswith("python3 job.py") and subprocess.run([PYTHON, "-c", "import dask.distributed"], capture_output=True).returncode:
            return "no python3-distributed"
        return "no blender" if "blender --python" in line and not shutil.which("blender") else None

    def test_every_page(self):
        for page in PAGES:
            lines = doc_pages.commands(page)
            if not lines:
                continue
            with self.subTest(page=page.name):
                self.go_through(page, lines)

    def go_through(self, page, lines):
        begin, folder = time.monotonic(), self.folder()
        if page.name == "first-half-hour.md" and KITCHEN.exists():
            shutil.copy(KITCHEN, folder / "my_video.mp4")
        elif page.name == "first-half-hour.md":
            print(f"{page.name}: on a rendered film: no shared data")
        for line in itertools.chain(BEFORE.get(page.name, []), lines, doc_pages.whole_mentions(page)):
            if reason := not_run(line) or self.missing(folder, line):
                print(f"{page.name}: not run: {line}: {reason}")
                continue
            self.carried_out(page, folder, line)
        for kind, text in doc_pages.blocks(page):
            if kind == "python" and (reason := self.missing(folder, f"python3: {text}")):
                print(f"{page.name}: not run: Python: {reason}")
            elif kind == "python":
                self.done(folder, "PYTHONPATH=build/python python3 -", PRELUDE + text)
        if page.name == "first-half-hour.md":
            self.hold_promises(folder)
        print(f"{page.name}: {len(lines)} commands, {time.monotonic() - begin:.1f} s")


    def hold_promises(self, folder):
        """Of the first half hour: poses of all frames, and what the next tools need."""
        for name in ("splat/sparse/0/cameras.bin", "out-nerfstudio/transforms.json", "out-blender/scene.py"):
            self.assertGreater((folder / name).stat().st_size, 50, name)
        self.assertGreater(len(list((folder / "splat/images").iterdir())), 5)
        for name in ("out", "again", "by-rays"):
            frames = json.loads((folder / name / "report.json").read_text())["frames"]
            self.assertEqual(frames["posed"], frames["total"], name)


class Pages(unittest.TestCase):
    """Commands stand where they are looked for, and what is mentioned of one is there."""

    def test_every_command_is_found(self):
        self.assertGreater(sum(len(doc_pages.commands(page)) for page in PAGES), 70)
        for page in PAGES:
            self.assertEqual(doc_pages.misplaced(page), [], f"{page.name}: commands stand in blocks of ```sh")
            self.assertLessEqual({kind for kind, _ in doc_pages.blocks(page)} - {""}, {"sh", "yaml", "python", "cpp", "cmake", "csv"},
                                 page.name)

    def test_what_is_not_run_is_there(self):
        lines = [line for page in PAGES for line in doc_pages.commands(page)]
        for begin in NOT_RUN:
            self.assertTrue([line for line in lines if line.startswith(begin)], f"no page has '{begin}' any more")

    def test_commands_and_flags_of_mentions_are_there(self):
        flags_of, checked = {}, 0
        for page, code in ((page, code) for page in [*PAGES, *RESULTS] for code in doc_pages.mentions(page)):
            words = shlex.split(OURS.sub("", re.split(" (?:&&|>) ", code)[0]))
            depth = 2 if words[0] in ("camera", "map") and len(words) > 1 else 1
            command = tuple(word.split("|")[0] for word in words[:depth])
            if words[0].startswith("-"):
                continue
            if command not in flags_of:
                done = run(*command, "--help")
                self.assertEqual(done.returncode, 0, f"{page.name}: {code}: {done.stderr}")
                flags_of[command] = set(re.findall(r"--[a-z][a-z-]*", done.stdout + run("--help").stdout))
            for word in words[depth:]:
                if word.startswith("--"):
                    self.assertIn(word, flags_of[command], f"{page.name}: {code}")
                    checked += 1
        self.assertGreater(checked, 20)

    def test_scripts_and_targets_that_are_named_are_there(self):
        """`scripts/results WHAT` and what else the pages say that something was made by."""
        named = {code for page in [*PAGES, *RESULTS] for code in doc_pages.scripts(page)}
        self.assertGreater(len(named), 25)
        for code in sorted(named):
            words = shlex.split(code)
            with self.subTest(code):
                self.assertTrue(os.access(ROOT / words[0], os.X_OK) or (ROOT / words[0]).suffix == ".py" and (ROOT / words[0]).exists())
                if words[0] == "scripts/results" and len(words) > 1:
                    done = subprocess.run([ROOT / words[0], *words[1:], "--help"], capture_output=True, text=True)
                    self.assertEqual(done.returncode, 0, done.stderr)
        for name in {name for page in RESULTS for name in re.findall(r"\b(\w+_benchmark)\b", page.read_text())}:
            self.assertTrue((ROOT / f"benchmarks/{name}.cpp").exists(), name)

    def test_two_commands(self):
        """README begins with two, and no more."""
        self.assertEqual(len(doc_pages.blocks(PAGES[0])[0][1].splitlines()), 2)


if __name__ == "__main__":
    program.main()
