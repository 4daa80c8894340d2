"""What a run costs: docs/results/cost.md, made by scripts/results.

Runs over sizes of images, features, windows, cameras and lengths are measured, a model of a few terms is fitted to them
by least squares, and three further runs check it. Films and runs are kept in demo/cost until they change.
"""
import dataclasses
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys

import kept
import papers
from least_squares import fit_not_below_zero

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "cost"
FEATURES, WINDOW = 1500, 10  # defaults of track
RENDERED_WIDTH = 960
REPEATS = 3  # of the run that times are relative to


@dataclasses.dataclass(frozen=True)
class Film:
    """Pinholes of 4:3 with 64 degrees, evenly over the horizon, on a drive along a street. Above RENDERED_WIDTH it is
    enlarged."""
    width: int
    cameras: int = 1
    frames: int = 60
    metres: float = 15

    @property
    def name(self):
        return f"{self.cameras}x{self.width}-{self.frames}"

    @property
    def height(self):
        return self.width * 3 // 4


@dataclasses.dataclass(frozen=True)
class Run:
    film: Film
    features: int = FEATURES
    window: int = WINDOW
    number: int = 0
    flags: tuple = ()

    @property
    def name(self):
        again = f", again {self.number}" if self.number else ""
        return f"{self.film.name}, {self.features} features, window {self.window}{''.join(f' {f}' for f in self.flags)}{again}"


REFERENCE = Film(640)
FITTED = [
    *(Run(REFERENCE, number=n) for n in range(REPEATS)),
    *(Run(Film(w)) for w in (320, 960, 1280, 1920)), Run(Film(3840)),
    *(Run(REFERENCE, features=f) for f in (500, 1000, 2000, 3000)), Run(Film(1920), features=3000),
    *(Run(REFERENCE, window=w) for w in (5, 20, 30)),
    *(Run(Film(320, cameras=c, frames=40, metres=10)) for c in (2, 4, 8)),
    Run(Film(320, frames=400, metres=100)), Run(Film(320, frames=1200, metres=300), features=750),
]
HELD_OUT = [Run(Film(1600), features=2500, window=15), Run(Film(480, cameras=3, frames=50, metres=12), features=800),
            Run(Film(320, frames=800, metres=200), features=1000)]
# Seen, but beyond what the model is fitted to: whether anything grows that should not.
BEYOND = [Run(Film(160, cameras=16, frames=30, metres=7.5)),
          Run(Film(160, cameras=16, frames=30, metres=7.5), flags=("--refine-lens", "off")),
          Run(Film(160, cameras=64, frames=20, metres=5), flags=("--refine-lens", "off"))]


def write_camera(path, film):
    lines = ["raysfm_camera: 1", "cameras:"]
    focal = 0.8 * film.width
    for c in range(film.cameras):
        half = math.pi * c / film.cameras
        at = 0.15 * math.sin(2 * half), 0.15 * math.cos(2 * half)
        lines += [f"  - name: camera{c}", "    model: pinhole", f"    resolution: [{film.width}, {film.height}]",
                  f"    intrinsics: {{fx: {focal}, fy: {focal}, cx: {(film.width - 1) / 2}, cy: {(film.height - 1) / 2}}}",
                  f"    rig_from_cam: {{rotation: [0, {math.sin(half):.9f}, 0, {math.cos(half):.9f}], "
                  f"translation: [{at[0]:.6f}, 0, {at[1]:.6f}]}}"]
    path.write_text("\n".join(lines) + "\n")


def enlarge(folder, source, film):
    """The same film in more pixels, with noise as fine as they are."""
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("images"))
    write_camera(folder / "camera.yaml", film)
    (folder / "images").mkdir()
    return ["ffmpeg", "-v", "error", "-i", source / "images" / "%06d.png", "-vf",
            f"scale={film.width}:{film.height}:flags=bicubic,noise=alls=4:allf=t", "-pred", "none", "-compression_level", "1",
            "-start_number", 0, folder / "images" / "%06d.png"]


def synth(program, folder, film):
    camera = folder.with_suffix(".yaml")
    write_camera(camera, film)
    return [program, "synth", "street", "--camera", camera, "--frames", film.frames, "--fps", 10, "--length", film.metres,
            "--noise", 2, "--samples", 1, "--out", folder, "--quiet"]


def render(program, film):
    folder = FOLDER / "films" / film.name
    if (folder / "truth.txt").exists():
        return
    source = dataclasses.replace(film, width=RENDERED_WIDTH)
    if film.width > RENDERED_WIDTH:
        render(program, source)
    papers.tell(f"rendering {film.name}")
    fresh = folder.with_name(f"{film.name}.new")
    folder.parent.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(fresh, ignore_errors=True)
    command = (enlarge(fresh, FOLDER / "films" / source.name, film) if film.width > RENDERED_WIDTH
               else synth(program, fresh, film))
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"scripts/results: {command[0]} failed: {done.stderr.strip()[-300:]}")
    os.replace(fresh, folder)


# Stages of report.json that go together.
STAGES = {"read": ["decode"], "views": ["detect"], "start": ["start"], "poses": ["match", "pose", "align"],
          "map": ["keyframe", "adjust"], "calibration": ["calibrate"]}


def measured(folder, outputs):
    """Processor milliseconds a frame by stage, and peak memory. Stages are measured by the clock: what the run took of the
    processor is divided as they are."""
    report = json.loads((folder / "o" / "report.json").read_text())
    timing, frames = report["timing"], report["frames"]["total"]
    spent = {name: timing[name]["mean_ms"] * timing[name]["count"] / frames for name in timing if isinstance(timing[name], dict)}
    stages = {group: sum(spent.get(name, 0) for name in names) for group, names in STAGES.items()}
    whole = 1000 * outputs[0].processor_seconds / frames
    stages["rest"] = max(0.0, spent["frame"] - sum(v for k, v in stages.items() if k != "read"))
    clock = 1000 * timing["wall_s"] / frames
    stages["end"] = max(0.0, clock - spent["frame"] - stages["read"])
    share = whole / sum(stages.values())
    return {"ms": whole, "stages": {k: v * share for k, v in stages.items()}, "frames": frames,
            "posed": report["frames"]["posed"], "worlds": len(report["worlds"]), "keyframes": report["keyframes"],
            "points": report["points"], "peak_mib": timing["peak_rss_mib"]}


def experiment(run):
    command = ["{raysfm}", "track", f"{{{run.film.name}}}", "--out", "{out}/o", "--threads", "1", "--quiet", "--features",
               str(run.features), "--window", str(run.window), *run.flags]
    return kept.Experiment(run.name, [command], measured, ["raysfm"], [run.film.name])


@dataclasses.dataclass(frozen=True)
class Setting:
    """What the model knows of a run: C cameras of P megapixels, F thousand corners a camera, windows of W key frames, T
    frames of which the part k are key frames."""
    C: float
    P: float
    F: float
    W: float
    T: float
    k: float
    R: float = 1.0  # 1 where the calibration is refined, else 0

    @property
    def K(self):
        return self.k * self.T


def corners_of(features, cameras):
    """Thousand corners that a camera is asked for: rigs share them out."""
    return 2 * features / (cameras + 1) / 1000


def setting_of(run, result):
    film = run.film
    return Setting(film.cameras, film.width * film.height / 1e6, corners_of(run.features, film.cameras), run.window,
                   result["frames"], result["keyframes"] / result["frames"], float("off" not in run.flags))


# Terms by stage, milliseconds a frame: formula, what it stands for, value.
TIME = {
    "read": [("C P", "PNG to grey", lambda s: s.C * s.P), ("C", "a file", lambda s: s.C)],
    "views": [("C P", "octaves", lambda s: s.C * s.P), ("k C P", "corners of a key frame", lambda s: s.k * s.C * s.P),
              ("C", "an image", lambda s: s.C)],
    "start": [("C P / T", "corners of the frames before the first map", lambda s: s.C * s.P / s.T),
              ("C F / T", "matches, tries", lambda s: s.C * s.F / s.T)],
    "poses": [("C F", "points looked for", lambda s: s.C * s.F), ("C C F", "every camera is asked for every point", lambda s: s.C * s.C * s.F)],
    "map": [("k C F", "tracks followed, points made", lambda s: s.k * s.C * s.F),
            ("k C F, C > 1", "of a rig: points of other cameras, the scale", lambda s: s.k * s.C * s.F * (s.C > 1)),
            ("k C F W", "adjustment of the window", lambda s: s.k * s.C * s.F * s.W)],
    "calibration": [("k C F", "evidence of the newest key frames", lambda s: s.k * s.C * s.F),
                    ("k C C C R", "numbers of all cameras: which are told, and their scatter", lambda s: s.k * s.C ** 3 * s.R)],
    "rest": [("k C F", "places described, points chosen", lambda s: s.k * s.C * s.F),
             ("k K / 1000", "places compared with", lambda s: s.k * s.K / 1000)],
    "end": [("k C F", "whole map at the end", lambda s: s.C * s.F * s.k),
            ("C C C R / T", "the same at the end", lambda s: s.C ** 3 * s.R / s.T), ("1 / T", "start and end of the program", lambda s: 1 / s.T),
            ("1", "a frame written", lambda s: 1.0)],
}
ROUNDS = 10
KEPT_VIEWS = 60  # key frames whose images are kept
MEMORY = [("1", "the program", lambda s: 1.0), ("C P", "images on their way", lambda s: s.C * s.P),
          ("C P min(K, 60)", "images of the newest key frames", lambda s: s.C * s.P * min(s.K, KEPT_VIEWS)),
          ("C F min(K, 60)", "their patches", lambda s: s.C * s.F * min(s.K, KEPT_VIEWS)),
          ("1, C > 1", "of a rig: views that wait for the start", lambda s: float(s.C > 1)),
          ("C F K / 1000", "the map", lambda s: s.C * s.F * s.K / 1000), ("T / 1000", "poses of frames", lambda s: s.T / 1000)]


class Model:
    """Terms with their coefficients and standard errors: times by stage, and memory."""

    def __init__(self, runs):
        """`runs`: pairs of a setting and its result. Errors are relative, but no smaller than those of a tenth of the
        median."""
        self.time = {stage: self._fitted(terms, runs, lambda r, stage=stage: r["stages"][stage]) for stage, terms in TIME.items()}
        self.memory = self._fitted(MEMORY, runs, lambda r: r["peak_mib"])

    @staticmethod
    def _fitted(terms, runs, value):
        values = [value(result) for _, result in runs]
        least = 0.1 * sorted(values)[len(values) // 2] or 1e-6
        rows = [[term(setting) for _, _, term in terms] for setting, _ in runs]
        sizes = values
        for _ in range(ROUNDS):  # errors relative to what is predicted: relative to what was measured, small values weigh more
            found, errors = fit_not_below_zero(rows, values, [1 / max(v, least) ** 2 for v in sizes])
            sizes = [sum(f * x for f, x in zip(found, row)) for row in rows]
        return found, errors

    def ms(self, setting):
        """Of the processor, a frame."""
        return sum(c * term(setting) for stage, terms in TIME.items() for c, (_, _, term) in zip(self.time[stage][0], terms))

    def reading_ms(self, setting):
        return sum(c * term(setting) for c, (_, _, term) in zip(self.time["read"][0], TIME["read"]))

    def mib(self, setting):
        return sum(c * term(setting) for c, (_, _, term) in zip(self.memory[0], MEMORY))


# Rows of the prediction: what, setting, whether it lies within what was measured.
K = 0.12  # key frames a frame: a walk, or a car in a town, at 10 to 30 frames a second
DAY = 24 * 3600 * 30


def expected(cameras, megapixels, frames, refined=1):
    return Setting(cameras, megapixels, corners_of(FEATURES, cameras), WINDOW, frames, K, refined)


PREDICTED = [
    ("640 x 480, 10 s", expected(1, 0.31, 300), True),
    ("1280 x 720, 1 min", expected(1, 0.92, 1800), True),
    ("1920 x 1080, 10 min", expected(1, 2.07, 18000), False),
    ("3840 x 2160, 10 min", expected(1, 8.29, 18000), False),
    ("stereo 1280 x 720, 10 min", expected(2, 0.92, 18000), False),
    ("8 cameras of 1280 x 720, 10 min", expected(8, 0.92, 18000), False),
    ("640 x 480, a day", expected(1, 0.31, DAY), False),
    ("1920 x 1080, a day", expected(1, 2.07, DAY), False),
    ("256 cameras of 320 x 240, `--refine-lens off`, an hour", expected(256, 0.077, 108000, 0), False),
    ("1,000 cameras of 320 x 240, `--refine-lens off`, an hour (refused today)", expected(1000, 0.077, 108000, 0), False),
    ("1,000 cameras of 320 x 240, `--refine-lens off`, a day (refused today)", expected(1000, 0.077, DAY, 0), False),
]


def coefficient_rows(terms, found, unit, reference):
    values, errors = found
    for (formula, what, _), value, error in zip(terms, values, errors):
        if math.isinf(error):
            yield f"| {formula} | {what} | 0 | not told apart | | {unit} |"
        else:
            relative = f"{value / reference:.3g}" if reference else "-"
            yield f"| {formula} | {what} | {value:.3g} | {error:.1g} | {relative} | {unit} |"


def shown_time(seconds):
    for unit, size in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds > 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"


def shown_memory(mib):
    return f"{mib / 1024:.1f} GiB" if mib > 2048 else f"{mib:.0f} MiB"


def compared(runs, model, results):
    for run in runs:
        result = results.get(run.name)
        if result is None:
            yield f"| {run.name} | not yet run |" + " |" * 9
            continue
        s = setting_of(run, result)
        ms, mib = model.ms(s), model.mib(s)
        yield (f"| {run.name} | {result['frames']} | {result['keyframes']} | {100 * result['posed'] / result['frames']:.0f} | "
               f"{ms:.2f} | {result['ms']:.2f} | {ms / result['ms']:.2f} | {mib:.0f} | {result['peak_mib']:.0f} | "
               f"{mib / result['peak_mib']:.2f} |")


RUN_HEAD = ["| run | frames | key frames | posed % | predicted ms | measured ms | ratio | predicted MiB | measured MiB | ratio |",
            "|---|" + "---|" * 9]


def page(made_by, results):
    done = [(setting_of(run, results[run.name]), results[run.name]) for run in FITTED if run.name in results]
    references = sorted(results[r.name]["ms"] for r in FITTED[:REPEATS] if r.name in results)
    yield from ["# What a run costs", "", f"Made by `scripts/results cost`: {made_by}. Other programs ran at the same time.", ""]
    if len(done) < len(FITTED) or not references:
        yield f"Not enough runs yet: {len(done)} of {len(FITTED)}."
        return
    model, reference = Model(done), references[len(references) // 2]
    yield from [
        f"Times are of the processor, per frame, `track` with one thread for views and its defaults but for what is named. The *reference* is "
        f"`{FITTED[0].name}`: {reference:.2f} ms a frame here (of {len(references)} runs: {references[0]:.2f} to {references[-1]:.2f}). Machines "
        "differ by a factor of three: run it on yours and multiply.", "",
        "C cameras of P megapixels; F thousand corners a camera, which are 2 `--features` / (C + 1): rigs share them out; windows of W key frames; T frames, of which the part k becomes key frames, "
        "K = k T in all; R is 1 where the calibration is refined. k says how fast the camera moves for its distance to things: 0.05 to 0.3. Coefficients are by least squares over the "
        f"{len(done)} runs below, none below its standard error; these are from what is left over.", "",
        "## What to expect", "",
        f"Predicted with k = {K:g}. *Extrapolated* rows lie beyond every run that was measured: they say what the terms would give, not what was "
        "seen. Frames per second are of one core. Reading is that of PNG images, which takes most of the time and can be on another core "
        "(`--threads`); videos are read faster.", "",
        "| input | ms a frame | of these reading | of the reference | frames/s | processor time | memory | |", "|---|---|---|---|---|---|---|---|"]
    for what, s, seen in PREDICTED:
        ms = model.ms(s)
        yield (f"| {what} | {ms:.1f} | {model.reading_ms(s):.1f} | {ms / reference:.2f} | {1000 / ms:.3g} | {shown_time(ms * s.T / 1000)} | {shown_memory(model.mib(s))} | "
               f"{'' if seen else 'extrapolated'} |")
    yield from ["", "## Points that were not used to fit it", "",
                "The key frames of a run are given to the model, which does not know how fast its camera moves. What a rig adds, and errors that are "
                "relative to what is predicted, came into it after a first fit had been compared with these three runs.", "", *RUN_HEAD, *compared(HELD_OUT, model, results), "",
                "Far beyond what it was fitted to. Which numbers of a calibration are told is asked with one less each time, which takes the fourth "
                "power of their number, 11 for each camera: rigs of many cameras want `--refine-lens off`. More than 256 cameras are refused.", "",
                *RUN_HEAD, *compared(BEYOND, model, results), "", "## The model", "",
                "| term | stands for | coefficient | standard error | in references | unit |", "|---|---|---|---|---|---|"]
    for stage, terms in TIME.items():
        yield f"| **{stage}** | | | | | |"
        yield from coefficient_rows(terms, model.time[stage], "ms a frame", reference)
    yield "| **memory** | | | | | |"
    yield from coefficient_rows(MEMORY, model.memory, "MiB", 0)
    yield from ["", "## The runs", "", *RUN_HEAD, *compared(FITTED, model, results), ""]


def run(program, machine, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    runs = [run for run in FITTED + HELD_OUT + BEYOND if only in run.name]
    for film in dict.fromkeys(run.film for run in runs):
        render(program, film)
    keeper = kept.Kept(FOLDER / "kept", {"raysfm": program} | {r.film.name: FOLDER / "films" / r.film.name
                                                               for r in FITTED + HELD_OUT + BEYOND})
    finished = papers.run_all(keeper, [experiment(run) for run in runs])
    results = {run.name: record["result"] for run in FITTED + HELD_OUT + BEYOND if (record := keeper.get(experiment(run)))}
    (ROOT / "docs" / "results").mkdir(parents=True, exist_ok=True)
    (ROOT / "docs" / "results" / "cost.md").write_text("\n".join(page(papers.made_by(program, machine), results)))
    print(f"written: docs/results/cost.md, {len(results)} of {len(FITTED + HELD_OUT + BEYOND)} runs")
    return 0 if finished else 130
