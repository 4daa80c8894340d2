"""`raysfm batch` of all shared sequences in five ways, whose results must be the same: docs/results/batch.md, made by scripts/results.

One job at a time; two; two and killed again and again; through Slurm on this machine; through Dask. Every file of every result is
compared with that of the first way, byte by byte. What tells times is left out: `timing` of report.json, report.html, which is
made of it, and the column `seconds` of the table.
"""
import csv
import json
import os
import pathlib
import random
import re
import signal
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

import slurm_node

FOLDER = ROOT / "demo" / "batch"
SYSTEM_PYTHON = "/usr/bin/python3"  # that of Debian, which has its Dask
KILLS = 12
# Lines of the list; {d} is the folder of the shared data. The last three can have no result.
LIST = """{d}/kitti07-mono
{d}/kitti06-stereo
{d}/tsukuba-mono
{d}/redkitchen-handheld
{d}/redkitchen-handheld/first200.mp4 --camera {d}/redkitchen-handheld/camera.yaml --name redkitchen-video
{d}/fr1-rpy
{d}/rendered/fisheye190
{d}/rendered/mirror
{d}/rendered/tri-rig
{d}/kitti00-small/video.mp4 --camera {d}/kitti00-small/camera.yaml --name kitti00-small
{d}/kitti00-small/video.mp4 --camera {d}/kitti00-small/camera.yaml --name kitti00-small-in-four --pieces 4
{d}/phone-batmobile/video.mp4 --name phone-batmobile
solve {d}/fountain-p11
solve {d}/herzjesu-p8
solve {d}/temple-ring
solve {d}/zoom-tsukuba
solve {d}/zoom-herzjesu-p25
solve {d}/rendered/zoom --name rendered-zoom
solve {d}/bonsai-photos --camera {d}/bonsai-photos/camera.yaml
solve '{d}/boards/fisheye-stereo/left*.jpg' --name board-fisheye-stereo
solve {d}/boards/fisheye-vehicle --name board-fisheye-vehicle
solve {d}/boards/ocam-fish1 --name board-ocam-fish1
solve '{d}/boards/pinhole-stereo/left*.jpg' --name board-pinhole
{d}/rigs/omnimvs-4-fisheye/cam1 {d}/rigs/omnimvs-4-fisheye/cam2 {d}/rigs/omnimvs-4-fisheye/cam3 {d}/rigs/omnimvs-4-fisheye/cam4 \
--camera {d}/rigs/omnimvs-4-fisheye/config.yaml --name omnimvs-4-fisheye
{d}/no-such-video.mp4
"""


class Way:
    """One way to run the list, into a folder of its own."""

    def __init__(self, program, name, videos):
        self.name, self.out = name, FOLDER / name
        self.command = [str(program), "batch", str(videos), "--out", str(self.out)]

    def batch(self, *arguments):
        """Its exit code: that of the first video without a result, where there is one."""
        done = subprocess.run([*self.command, *map(str, arguments)], capture_output=True, text=True)
        if done.returncode not in (0, 2, 3):
            sys.exit(f"scripts/results: {self.name}: exit {done.returncode}: {done.stderr}")
        return done.returncode

    def table(self):
        with open(self.out / "batch.csv", newline="") as file:
            return list(csv.DictReader(file))


def alone(way):
    way.batch("--jobs", 1)
    return "`batch --jobs 1`"


def two(way):
    way.batch("--jobs", 2)
    return "`batch --jobs 2`"


def jobs_of(batch):
    """The processes that a batch has started."""
    return [int(p) for p in pathlib.Path(f"/proc/{batch}/task/{batch}/children").read_text().split()]


def killed(way):
    """SIGKILL of the batch and of one of its jobs in turn; the batch is started again at once where it is gone."""
    numbers, kills = random.Random(0), {"batch": 0, "job": 0}
    while kills["batch"] < KILLS // 2:
        running = subprocess.Popen([*way.command, "--jobs", "2"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for what in ("job", "batch"):
            try:
                running.wait(numbers.uniform(0.1, 6))
                break
            except subprocess.TimeoutExpired:
                jobs = jobs_of(running.pid)
                if what == "batch":
                    running.kill()
                elif jobs:
                    os.kill(jobs[0], signal.SIGKILL)
                kills[what] += what == "batch" or bool(jobs)
        running.wait()
        if running.returncode >= 0:
            break
    way.batch("--jobs", 2)
    return f"`batch --jobs 2`, {kills['batch']} times killed by SIGKILL and started again at once, {kills['job']} times one of its jobs"


def slurm(way):
    if reason := slurm_node.missing():
        return reason, None
    folder = FOLDER / "slurm-node"
    folder.mkdir()
    with slurm_node.SlurmNode(folder) as node:
        way.batch("--slurm", folder / "job.sh")
        subprocess.run(["sbatch", "--wait", folder / "job.sh"], env=node.environment, cwd=folder, capture_output=True)
    way.batch("--summary")
    version = subprocess.run(["slurmd", "-V"], capture_output=True, text=True).stdout.strip()
    return f"`sbatch --wait job.sh`, {version} on this machine"


def dask(way):
    done = subprocess.run([SYSTEM_PYTHON, "-c", "import dask; print(dask.__version__)"], capture_output=True, text=True)
    if done.returncode != 0:
        return "no python3-distributed", None
    script = FOLDER / "job.py"
    way.batch("--dask", script)
    subprocess.run([SYSTEM_PYTHON, script], cwd=FOLDER, capture_output=True)
    way.batch("--summary")
    return f"`python3 job.py`, dask {done.stdout.strip()} on this machine"


def files_of(way):
    """All but the records of the batch, and what a job that was killed was writing, which goes when its folder is next written."""
    names = (path.relative_to(way.out) for path in way.out.rglob("*") if path.is_file())
    return sorted(name for name in names if name.parts[0] != "batch" and not name.parts[0].startswith("."))


def content(path, way):
    """What of a file must be the same: all, but for times, and for the name of the folder that this way writes to."""
    if path.name == "report.html":
        return b""
    data = path.read_bytes()
    if path.name in ("report.json", "failed.json"):
        report = json.loads(data)
        report.pop("timing", None)
        data = json.dumps(report).encode()
    if path.name == "batch.csv":
        data = "\n".join(str({k: v for k, v in row.items() if k != "seconds"}) for row in way.table()).encode()
    return re.sub(rb"(?<![\w.-])" + re.escape(os.fsencode(way.out)) + rb"(?![\w.-])", b"OUT", data)


def differences(way, first):
    """How many files were compared, and which differ."""
    names = sorted({*files_of(way), *files_of(first)})
    same = [(way.out / n).exists() and (first.out / n).exists() and content(way.out / n, way) == content(first.out / n, first)
            for n in names]
    return len(names), [str(name) for name, is_same in zip(names, same) if not is_same]


def run(program, data, machine):
    if FOLDER.exists():
        sys.exit(f"scripts/results: {FOLDER} is in the way")
    FOLDER.mkdir(parents=True)
    videos = FOLDER / "list.txt"
    videos.write_text(LIST.format(d=data))
    version = subprocess.run([program, "--version"], capture_output=True, text=True).stdout.split()[0]
    rows, first, failures = [], None, 0
    for make in (alone, two, killed, slurm, dask):
        way, begin = Way(program, make.__name__, videos), time.monotonic()
        how = make(way)
        if isinstance(how, tuple):
            print(f"skipped: {make.__name__}: {how[0]}")
            continue
        first = first or way
        count, differing = differences(way, first)
        failures += len(differing)
        same = "" if way is first else f"{count - len(differing)} of {count}"
        rows.append(f"| {how} | {time.monotonic() - begin:.0f} | {same} |")
        print(rows[-1], *differing, sep="\n  ", flush=True)
    write_table(f"raysfm {version}, {machine}", rows, first.table())
    return 1 if failures else 0


def write_table(made_by, ways, videos):
    text = [
        "# Batches", "",
        f"Made by `scripts/results batch`: {made_by}. All shared sequences in one list (`scripts/batch_ways.py`), none made shorter, in "
        "five ways. Every file of every result was compared with that of the first way, byte by byte. Left out is what tells times: `timing` of "
        "`report.json`, `report.html`, and `seconds` of the table.", "",
        "| way | seconds | files like those of the first |", "|---|---|---|", *ways, "",
        "The table of the first way. The last three cannot have a result, and say why:", "",
        "| name | frames | posed | worlds | seconds | exit | reason |", "|---|---|---|---|---|---|---|",
    ]
    for row in videos:
        cells = [row[k] for k in ("name", "frames", "posed", "worlds", "seconds", "exit")]
        reason = re.sub(r"\S*/shared/data/", "", row["reason"]).replace("|", "\\|")
        text.append("| " + " | ".join([*cells, reason]) + " |")
    path = ROOT / "docs" / "results" / "batch.md"
    path.write_text("\n".join([*text, ""]))
    print(f"written: {path.relative_to(ROOT)}")
