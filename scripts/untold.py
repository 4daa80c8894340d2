"""Footage of which nothing is told, beside the same with its calibration: docs/results/untold.md, made by scripts/results.

Runs are kept in demo/untold/kept until their commands, programs or inputs change.
"""
import dataclasses
import json
import pathlib
import re
import statistics

import kept
import papers
from footage import write_camera
from photos import number, table

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "untold"
GLOBAL, READOUTS, SEEDS = 0, (15, 33), (1, 2, 3)  # ms

# Cameras that films are rendered with: model, size, intrinsics.
CAMERAS = {
    "pinhole": ("pinhole", (640, 480), dict(fx=520, fy=520, cx=319.5, cy=239.5)),
    "narrow": ("pinhole", (640, 480), dict(fx=900, fy=900, cx=330, cy=231)),
    "large": ("pinhole", (800, 600), dict(fx=600, fy=600, cx=399.5, cy=299.5)),
    "small": ("pinhole", (512, 384), dict(fx=350, fy=350, cx=260, cy=189)),
    "radtan": ("radtan", (640, 480), dict(fx=520, fy=520, cx=325, cy=236, k1=-0.2, k2=0.05, p1=0, p2=0)),
    "fisheye-120": ("kannala-brandt", (640, 480), dict(fx=311.28, fy=311.28, cx=319.5, cy=239.5, k1=-0.02)),
    "fisheye-140": ("kannala-brandt", (640, 480), dict(fx=261.92, fy=261.92, cx=319.5, cy=239.5)),
    "fisheye-140-k": ("kannala-brandt", (640, 480), dict(fx=249.95, fy=249.95, cx=319.5, cy=239.5, k1=0.05, k2=-0.012)),
    "fisheye-170": ("kannala-brandt", (640, 360), dict(fx=215.7, fy=215.7, cx=319.5, cy=179.5)),
    "fisheye-circle": ("kannala-brandt", (640, 480), dict(fx=137.39, fy=137.39, cx=319.5, cy=239.5)),
}


@dataclasses.dataclass(frozen=True)
class Film:
    """Footage of the shared data (`source`: its parts that make a sequence without a camera file, below its folder), or
    one that is rendered (`synth`: words of that command; `camera`: one of CAMERAS)."""
    name: str
    source: str = ""
    parts: tuple = ()
    synth: str = ""
    camera: str = ""

    def commands(self):
        """They leave the footage, and where its camera and its truth are."""
        if self.synth:
            film = ["{raysfm}", "synth", *self.synth.split(), "--camera", f"{{{self.camera}}}", "--out", "{out}/film",
                    "--quiet"]
            # A readout is not told either.
            told = [["mv", "{out}/film/camera.yaml", "{out}/camera.yaml"], ["sed", "-i", "/rolling_shutter/d", "{out}/camera.yaml"]]
            return [film, *told]
        links = [["ln", "-s", f"{{{self.source}}}/{part}", "{out}/film/" + name] for name, part in self.parts]
        return [["mkdir", "{out}/film"], *links]

    @property
    def footage(self):
        return "{out}/film" + ("/video.mp4" if self.parts and self.parts[0][0] == "video.mp4" else "")

    @property
    def folder(self):
        """Of truth.txt and lens.csv."""
        return "{out}/film" if self.synth else f"{{{self.source}}}"

    @property
    def camera_file(self):
        return "{out}/camera.yaml" if self.synth else f"{{{self.source}}}/camera.yaml"

    @property
    def inputs(self):
        return [self.camera if self.synth else self.source]


def images(source, folder="images"):
    return Film(source, source, (("images", folder), ("times.txt", "times.txt")))


def video(source, file="video.mp4", name=""):
    return Film(name or source, source, (("video.mp4", file),))


SEQUENCES = [images("tsukuba-mono"), images("kitti07-mono", "image_0"), images("redkitchen-handheld"),
             video("redkitchen-handheld", "first200.mp4", "redkitchen-handheld, first 200"), video("kitti00-small"),
             video("phone-batmobile"), Film("fr1-rpy", "fr1-rpy", (("rgb", "rgb"), ("rgb.txt", "rgb.txt")))]

SOFT = "--noise 2 --blur 0.005 --samples 1"
FISHEYES = [Film(f"{camera}: {words.split(' --frames')[0].replace(' --motion', ',')}", synth=f"{words} {SOFT}", camera=camera)
            for camera, words in [
                ("fisheye-120", "room --motion handheld --frames 120"), ("fisheye-120", "street --motion drive --frames 120"),
                ("fisheye-120", "corridor --motion walk --frames 150"),
                ("fisheye-120", "street --motion walk --frames 150 --readout 20"),
                ("fisheye-140", "room --motion orbit --frames 100"), ("fisheye-140", "street --motion drive --frames 120"),
                ("fisheye-140-k", "room --motion walk --frames 150"),
                ("fisheye-140-k", "room --motion handheld --frames 120 --readout 20"),
                ("fisheye-170", "street --motion walk --frames 150"), ("fisheye-circle", "room --motion handheld --frames 120"),
                ("fisheye-circle", "street --motion drive --frames 120")]]

MOTIONS = {"hand": "room --motion handheld --frames 150 --fps 30", "walk": "room --motion walk --frames 200 --fps 30 --length 8",
           "drive": "town --motion drive --frames 200 --fps 10 --length 100"}


def scanned(motion, readout, seed):
    flag = f" --readout {readout}" if readout else ""
    return Film(f"{motion}, {readout} ms, seed {seed}", synth=f"{MOTIONS[motion]}{flag} {SOFT} --seed {seed}", camera="radtan")


SCANNED = [scanned(motion, readout, seed) for motion in MOTIONS for readout in (GLOBAL, *READOUTS) for seed in SEEDS]

SOLVED = [Film("zoom-tsukuba", "zoom-tsukuba", (("images", "images"), ("times.txt", "times.txt"))),
          Film("rendered, zoom", "rendered/zoom", (("images", "images"), ("times.txt", "times.txt"))),
          images("tsukuba-mono"), images("kitti07-mono", "image_0"), images("redkitchen-handheld"),
          Film("hand, zoom 1.6", synth="room --motion handheld --zoom 1.6 --frames 150", camera="pinhole"),
          Film("walk, zoom 2", synth="room --motion walk --zoom 2 --frames 200 --length 7", camera="small"),
          Film("drive, zoom 1.5", synth="street --motion drive --zoom 1.5 --frames 120 --length 40", camera="large"),
          Film("walk", synth="room --motion walk --frames 240 --length 8", camera="small"),
          Film("orbit", synth="room --motion orbit --frames 120", camera="narrow"),
          Film("fr1-rpy", "fr1-rpy", (("rgb", "rgb"), ("rgb.txt", "rgb.txt"))),
          Film("turn", synth="room --motion rotate --frames 100", camera="pinhole"),
          Film("straight", synth="corridor --motion straight --frames 80 --length 8", camera="pinhole")]


def evaluated(printed):
    """Error in % of the path, and metres of both."""
    if printed.code:
        return {}
    found = json.loads(printed)
    return {"mean_m": found["ate"]["mean"], "length_m": found["length_m"]}


def tracked(folder, printed, evaluation):
    """What a run of `track` left in `folder`."""
    path = folder / "report.json"
    if not path.exists():
        return {"message": printed.error}
    report = json.loads(path.read_text())
    numbers = {n["name"]: n for n in report["calibration"]}
    result = {"frames": report["frames"]["total"], "posed": report["frames"]["posed"], "worlds": len(report["worlds"]),
              "model": report["lens_model"], "seconds": printed.seconds, **evaluated(evaluation)}
    if "fx" in numbers:
        result |= {"fx": numbers["fx"]["refined"], "sigma": numbers["fx"]["sigma"], "given": numbers["fx"]["given"]}
    readouts = [1000 * numbers[k]["refined"] for k in ("readout_down", "readout_right") if k in numbers]
    return result | {"readout_ms": max(readouts, key=abs, default=0)}


def judged_twice(folder, outputs):
    """Without and with the calibration: the last four commands were both runs, and both evaluations."""
    return {name: tracked(folder / name, outputs[-4 + i], outputs[-2 + i]) for i, name in enumerate(("without", "with"))}


def track_experiment(film):
    track = ["{raysfm}", "track", film.footage, "--threads", "2", "--quiet", "--out"]
    evaluate = [["{raysfm}", "eval", "{out}/" + name, film.folder + "/truth.txt", "--align", "sim3", "--json"]
                for name in ("without", "with")]
    commands = [*film.commands(), [*track, "{out}/without"], [*track, "{out}/with", "--camera", film.camera_file], *evaluate]
    return kept.Experiment(f"track, {film.name}", commands, judged_twice, ["raysfm"], film.inputs, may_fail=True)


def true_lenses(text):
    """fx by time: of a lens.csv; by None: of a camera file."""
    if text.startswith("timestamp"):
        rows = [line.split(",") for line in text.split()[1:]]
        return {round(1000 * float(row[0])): float(row[1]) for row in rows}
    return {None: float(re.search(r"fx:\s*([-+.\de]+)", text).group(1))}


def judged_solve(folder, outputs):
    """The last three commands were solve, the true lens and the evaluation."""
    report = folder / "o" / "report.json"
    if not report.exists():
        return {"message": outputs[-3].error}
    report, true = json.loads(report.read_text()), true_lenses(outputs[-2])
    rows = [[float(word) for word in line.split(",")] for line in (folder / "o" / "lens.csv").read_text().split()[1:]]
    found = [(row[1], row[6], true.get(None) or true[round(1000 * row[0])]) for row in rows]
    errors = [100 * abs(fx / t - 1) for fx, _, t in found]
    return {"frames": report["frames"]["total"], "posed": report["frames"]["posed"], "lens": report["lens"],
            "error": statistics.mean(errors), "largest": max(errors),
            "sigma": statistics.median(100 * s / fx for fx, s, _ in found),
            "within": statistics.mean(abs(fx - t) < 2 * s for fx, s, t in found), "seconds": outputs[-3].seconds,
            **evaluated(outputs[-1])}


def solve_experiment(film):
    zooms = "zoom" in film.name
    commands = [*film.commands(),
                ["{raysfm}", "solve", film.footage, "--threads", "2", "--quiet", "--out", "{out}/o"],
                ["cat", film.folder + "/lens.csv" if zooms else film.camera_file],
                ["{raysfm}", "eval", "{out}/o", film.folder + "/truth.txt", "--align", "sim3", "--json"]]
    return kept.Experiment(f"solve, {film.name}", commands, judged_solve, ["raysfm"], film.inputs, may_fail=True)


def experiments():
    return [*map(track_experiment, [*SEQUENCES, *FISHEYES, *SCANNED]), *map(solve_experiment, SOLVED)]


def percent(run):
    return 100 * run["mean_m"] / run["length_m"] if "mean_m" in run else None


def mean_percent(runs):
    """None where one of them has no error."""
    errors = [percent(run) for run in runs]
    return None if None in errors else statistics.mean(errors)


def ratio(a, b):
    return a / b if a is not None and b else None


def lens_text(run):
    return f"{run['fx']:.1f} ± {run['sigma']:.1f}" if "fx" in run else "-"


def track_row(film, results):
    result = results.get(f"track, {film.name}")
    if result is None:
        return f"| {film.name} | not yet run |" + " |" * 8
    without, told = result["without"], result["with"]
    if "message" in without:
        return f"| {film.name} | {without['message'].split(': ', 2)[-1].split(';')[0]} |" + " |" * 8
    a, b = percent(without), percent(told)
    return f"| {film.name} | " + " | ".join([
        f"{without['posed']} of {without['frames']}", str(told.get("posed", "-")), str(without["worlds"]), without["model"],
        lens_text(without), number(told.get("given"), 1), number(a, 3), number(b, 3), number(ratio(a, b)),
        f"{without['seconds']:.1f}, {number(told.get('seconds'), 1)}"]) + " |"


def scan_row(motion, readout, results):
    """Means over the seeds."""
    runs, twins = ([results.get(f"track, {scanned(motion, ms, seed).name}") for seed in SEEDS] for ms in (readout, GLOBAL))
    if None in [*runs, *twins]:
        return f"| {motion} | {readout} | not yet run |" + " |" * 5
    cells = []
    for name in ("without", "with"):
        failed = [run[name] for run in runs if "message" in run[name]]
        if failed:
            cells += [failed[0]["message"].split(": ", 2)[-1].split(";")[0], "", ""]
            continue
        a, b = (mean_percent(run[name] for run in of) for of in (runs, twins))
        found = [run[name]["readout_ms"] for run in runs]
        cells += [f"{min(found):.1f} to {max(found):.1f}", number(a, 3), number(ratio(a, b))]
    return f"| {motion} | {readout} | " + " | ".join(cells) + " |"


def solve_row(film, results):
    result = results.get(f"solve, {film.name}")
    if result is None:
        return f"| {film.name} | not yet run |" + " |" * 8
    if "message" in result:
        return f"| {film.name} | {result['message'].split(': ', 2)[-1].split(':')[0]} |" + " |" * 8
    a = percent(result)
    return f"| {film.name} | " + " | ".join([
        f"{result['posed']} of {result['frames']}", result["lens"], *(number(result[k]) for k in ("error", "largest", "sigma", "within")),
        number(a, 3), number(1000 * result["mean_m"], 1) if a is not None else "-", f"{result['seconds']:.1f}"]) + " |"


TRACK_HEAD = ["footage", "posed", "with its calibration", "worlds", "model", "fx found, px", "of the file", "error, %",
              "with its calibration, %", "ratio", "seconds, with"]
ABOUT = (
    "`raysfm track` on footage without a camera file, and on the same with it (`--camera`). Errors are the mean over the frames "
    "with a pose in the main world, after alignment by a similarity, in % of the path. fx with the standard deviation that is "
    "stated. Seconds of wall time, two threads. A row with a sentence in place of figures ended with exit code 3 and that "
    "sentence.")
ABOUT_FISHEYES = f"Rendered, `{SOFT}`; the lens is told by nothing but the film, nor that it is a fisheye."
ABOUT_SCANS = (
    "Rendered with a readout that nobody told, with and without a camera file (radtan, which has no readout), beside the twin "
    f"with a global shutter: the readouts that were found, ms, means of the errors of {len(SEEDS)} seeds, and the ratio of these.")
ABOUT_SOLVE = (
    "`raysfm solve`: error of fx in %, mean and largest over the frames; the stated standard deviation, the median in % of fx; part "
    "of the frames whose error is below two of these; error of the path, in % of it and in mm.")


def page(made_by, results, records):
    yield from ["# Nothing told", "", f"Made by `scripts/results untold`: {made_by}. Other programs ran at the same time.", ""]
    yield from [ABOUT, ""]
    yield from table(TRACK_HEAD, [track_row(film, results) for film in SEQUENCES])
    yield from ["## Fisheyes", "", ABOUT_FISHEYES, ""]
    yield from table(TRACK_HEAD, [track_row(film, results) for film in FISHEYES])
    yield from ["## Rolling shutters", "", ABOUT_SCANS, ""]
    yield from table(["motion", "readout", "found, no camera file", "error, %", "to the twin", "found, camera file", "error, %",
                      "to the twin"], [scan_row(motion, readout, results) for motion in MOTIONS for readout in READOUTS])
    yield from table(TRACK_HEAD, [track_row(film, results) for film in SCANNED])
    yield from ["## Solve", "", ABOUT_SOLVE, ""]
    yield from table(["footage", "posed", "lens", "error of fx", "largest", "sigma", "within 2 sigma", "path, %", "mm", "seconds"],
                     [solve_row(film, results) for film in SOLVED])
    yield from ["## Commands", ""]
    yield from table(["run", "commands", "made"], [
        f"| {name} | " + "<br>".join(f"`{c}`" for c in record["commands"]) + f" | {record['made']} |"
        for name, record in records.items()])


def run(program, data, machine, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    (FOLDER / "cameras").mkdir(parents=True, exist_ok=True)
    for name, (model, size, numbers) in CAMERAS.items():
        write_camera(FOLDER / "cameras" / f"{name}.yaml", model, *size, numbers)
    places = {"raysfm": program, **{name: FOLDER / "cameras" / f"{name}.yaml" for name in CAMERAS}}
    places |= {film.source: data / film.source for film in [*SEQUENCES, *SOLVED] if film.source}
    keep = kept.Kept(FOLDER / "kept", places)
    finished = papers.run_all(keep, [e for e in experiments() if only in e.name])
    records = {e.name: record for e in experiments() if (record := keep.get(e))}
    lines = page(papers.made_by(program, machine), {name: record["result"] for name, record in records.items()}, records)
    (ROOT / "docs" / "results" / "untold.md").write_text("\n".join(lines))
    print(f"written: docs/results/untold.md, {len(records)} of {len(experiments())} runs")
    return 0 if finished else 130
