"""Footage made harder and harder: docs/results/hard.md, made by scripts/results.

Films with truth, rendered ones and real ones, are degraded by scripts/degrade.py and tracked. Runs are kept in
demo/hard/kept until their commands, programs or inputs change.
"""
import json
import math
import os
import pathlib
import shutil
import subprocess
import sys

import aligned
import kept
import papers
from places_again import read_trajectory

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "hard"
# Rendered ones: world and flags of synth; the shutter is open for 5 ms and the noise is that of daylight.
RENDERED = {
    "room": ["room", "--motion", "handheld", "--frames", "120", "--noise", "2", "--blur", "0.005"],
    "street": ["street", "--frames", "120", "--fps", "10", "--length", "30", "--noise", "2", "--blur", "0.005"],
}
RENDERED_FRAMES = 80  # of them that are used
REAL = {"kitchen": ("redkitchen-handheld", 80), "kitti07": ("kitti07-mono", 60)}  # folder of the data, frames
FILMS = [*RENDERED, *REAL]
# kind: what its strength is, strengths, what it does. A strength of None is the film as it is.
KINDS = {
    "walkers": ("% of the image", [10, 20, 40, 60],
                "six figures of the image's height walk across, each its own way at 0.4 to 1.2 % of the width a frame; they are "
                "painted with the film's own first image upside down, so that they have as many corners as the rest"),
    "posters": ("% of the image", [10, 20, 40, 60],
                "the same, painted with squares of all sizes: nearly all corners of an image are on them"),
    "vehicle": ("% of the image", [10, 20, 40, 60],
                "one wall, painted with the first image upside down, comes in from the right and stays, moving to and fro, growing and shrinking by a tenth"),
    "blur": ("% of the width", [1, 4, 8], "every frame moves so far while it is exposed"),
    "blur-bursts": ("% of the width", [2, 8, 16], "8 frames of 30 do"),
    "darkness": ("times less light", [16, 64, 128],
                 "electrons are counted (4000 for white), read with a noise of 8, and quantised to 8 bits"),
    "exposure": ("times", [2, 4, 8], "the gain jumps by that factor, up or down every ten frames"),
    "textureless": ("% of the frames", [5, 20], "in one stretch contrast is a 50th of what it was"),
    "dropped": ("frames to one kept", [3, 10], "with the times of those kept"),
    "noise": ("grey levels", [10, 40, 80], "Gaussian, in every pixel"),
    "rain": ("streaks", [300, 1000, 3000], "bright ones, at other places in every frame"),
    "jpeg": ("quality", [20, 10, 5], "as libjpeg counts it"),
}
OVERLAYS = ("walkers", "posters", "vehicle")  # on all films; the others on FEWER
FEWER = ["room", "kitchen", "kitti07"]
ELLIPSOID_999 = 16.27  # squared semi-axis in standard deviations, three dimensions, 99.9 %
# A path is wrong beyond these three together.
WRONG_RATIO, WRONG_PERCENT, WRONG_BEYOND = 3, 1, 50
BROKEN_PLACED = 50  # %: what is placed less has broken, with or without an error


def solved(c, e):
    """e' inv(C) e of a symmetric 3x3 matrix, by cofactors; infinite where it is singular."""
    (a, b, d), (_, f, g), (_, _, h) = c
    det = a * (f * h - g * g) - b * (b * h - g * d) + d * (b * g - f * d)
    if not det > 0:
        return math.inf
    inverse = [[f * h - g * g, d * g - b * h, b * g - d * f], [d * g - b * h, a * h - d * d, b * d - a * g],
               [b * g - d * f, b * d - a * g, a * f - b * b]]
    return sum(e[i] * inverse[i][j] * e[j] for i in range(3) for j in range(3)) / det


def position_covariances(path):
    """By time in milliseconds, from covariance.csv."""
    found = {}
    for line in path.read_text().splitlines():
        words = line.split(",")
        if line.startswith("#") or words[0] == "timestamp":
            continue
        xx, xy, xz, yy, yz, zz = (float(words[1 + k]) for k in (0, 1, 2, 6, 7, 11))
        found[round(1000 * float(words[0]))] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return found


def path_error(estimate, truth, covariances):
    """Of positions by their time: rmse in % of the true path after alignment by a similarity, and how many % of them
    lie beyond the 99.9 % ellipsoid that is stated for them."""
    times = sorted(set(estimate) & set(truth))
    if len(times) < 5:
        return {}
    found, true = [estimate[t] for t in times], [truth[t] for t in times]
    length = sum(math.dist(a, b) for a, b in zip(true, true[1:]))
    spread = max(math.dist(p, found[0]) for p in found)
    if not length > 0 or not spread > 0:
        return {}
    move = aligned.similarity(found, true)
    errors = [math.dist(move(p), q) for p, q in zip(found, true)]
    back = aligned.similarity(true, found)  # covariances are in the frame of the estimate
    beyond = 0
    for t, p, q in zip(times, found, true):
        error = [a - b for a, b in zip(back(q), p)]
        beyond += not solved(covariances[t], error) < ELLIPSOID_999
    rmse = math.sqrt(sum(e * e for e in errors) / len(errors))
    return {"ate_percent": 100 * rmse / length, "beyond_percent": 100 * beyond / len(times)}


def words_said(errors):
    """Warnings of a run but those of waiting for a start, which say nothing of a path."""
    lines = [line.strip() for line in errors.splitlines()]
    return [line.removeprefix("warning: ") for line in lines if line.startswith("warning: ") and "no start yet" not in line]


def tracked(folder, outputs):
    """The last command was track."""
    report_file = folder / "o" / "report.json"
    said = words_said(outputs[-1].errors)
    if not report_file.exists():
        return {"exit": outputs[-1].code, "posed_percent": 0, "worlds": 0, "said": [outputs[-1].error]}
    report = json.loads(report_file.read_text())
    frames = report["frames"]
    without = [f["index"] for f in frames["without_pose"]]
    first = next((i for i in range(frames["total"]) if i not in set(without)), 0)
    lost = sum(index > first for index in without)
    held = sum(run["last"] - run["first"] + 1 for run in frames["place_held"])
    if lost:
        said.append(f"{lost} frames without a pose")
    if len(report["worlds"]) > 1:
        said.append(f"{len(report['worlds'])} worlds")
    if held:
        said.append(f"{held} frames without a place")
    estimate = {t: place for t, (place, _) in read_trajectory(folder / "o" / "trajectory.txt").items()}
    truth = {t: place for t, (place, _) in read_trajectory(folder / "film" / "truth.txt").items()}
    result = {"exit": outputs[-1].code, "posed_percent": 100 * (frames["posed"] - held) / frames["total"],
              "worlds": len(report["worlds"]), "said": said}
    return result | path_error(estimate, truth, position_covariances(folder / "o" / "covariance.csv"))


def name_of(film, kind, strength):
    return f"{film}, {kind} {strength:g}" if kind != "none" else f"{film}, as it is"


def frames_of(film):
    return str(REAL[film][1] if film in REAL else RENDERED_FRAMES)


def experiment(film, kind, strength, frames=""):
    degrade = ["{python}", "{degrade}", f"{{{film}}}", "{out}/film", "--kind", kind, "--strength", f"{strength:g}",
               "--frames", frames or frames_of(film)]
    track = ["{raysfm}", "track", "{out}/film", "--out", "{out}/o", "--threads", "1"]
    return kept.Experiment(name_of(film, kind, strength), [degrade, track], tracked, ["raysfm"], ["degrade", film],
                           scale=f"{frames} frames" if frames else "", may_fail=True)


def films_of(kind):
    return FILMS if kind in OVERLAYS else FEWER


def experiments():
    """The films as they are first, then kind by kind."""
    return [experiment(film, "none", 0) for film in FILMS] + [
        experiment(film, kind, strength) for kind, (_, strengths, _) in KINDS.items() for strength in strengths
        for film in films_of(kind)]


def is_wrong(result, plain):
    """`plain`: of the film as it is."""
    if "ate_percent" not in result or "ate_percent" not in plain:
        return False
    return (result["ate_percent"] > max(WRONG_RATIO * plain["ate_percent"], WRONG_PERCENT) and
            result["beyond_percent"] > WRONG_BEYOND)


def verdict(result, plain):
    if is_wrong(result, plain):
        return "wrong, said" if result["said"] else "**wrong, silent**"
    if result["posed_percent"] < BROKEN_PLACED:
        return "lost, said" if result["said"] else "lost, its frames say why"
    return "holds"


def shown_words(said):
    text = "; ".join(word[:90] + ("..." if len(word) > 90 else "") for word in said[:2])
    return text.replace("|", "/") + (f"; and {len(said) - 2} more" if len(said) > 2 else "")


def number(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def row(kind, strength, film, results):
    result, plain = results.get(name_of(film, kind, strength)), results.get(name_of(film, "none", 0))
    start = f"| {strength:g} | {film} | "
    if result is None or plain is None:
        return start + "not yet run |" + " |" * 6
    ate = result.get("ate_percent")
    ratio = ate / plain["ate_percent"] if ate is not None and plain.get("ate_percent") else None
    return start + " | ".join([number(result["posed_percent"], 0), str(result["worlds"]), number(ate, 2),
                               number(ratio, 1), number(result.get("beyond_percent"), 0), verdict(result, plain),
                               shown_words(result["said"])]) + " |"


def summary_cell(kind, film, results):
    """The greatest strength up to which every run holds, and what comes then."""
    if film not in films_of(kind):
        return "-"
    plain, last = results.get(name_of(film, "none", 0)), None
    for strength in KINDS[kind][1]:
        result = results.get(name_of(film, kind, strength))
        if result is None or plain is None:
            return "not yet run"
        what = verdict(result, plain)
        if what != "holds":
            return (f"to {last:g}, " if last is not None else "") + f"at {strength:g} {what}"
        last = strength
    return f"holds to {last:g}"


def silent(results):
    """Names of runs whose path is wrong without a word."""
    found = []
    for kind, (_, strengths, _) in KINDS.items():
        for film in films_of(kind):
            plain = results.get(name_of(film, "none", 0), {})
            found += [name_of(film, kind, s) for s in strengths
                      if is_wrong(r := results.get(name_of(film, kind, s), {}), plain) and not r["said"]]
    return found


LOOKED_AT = [
    "Walkers, posters, vehicle: what is tracked is whatever covers most of the image that one motion explains. Figures that go sideways at several "
    "speeds are, to a camera, points at several distances; a wall that fills most of the image is a world. Residuals are small and "
    "ellipsoids narrow, rightly so for what was followed. What tells is the rest of the image (docs/architecture.md, what moves by itself).",
    "`room, blur-bursts 8`: frames drawn out by 41 px are 19 to 88 mm off, along what is told least, with standard deviations of 5 to 19 mm; those "
    "between them are within 0.5 mm, but all are aligned together.",
    "The truth of the kitchen is good to 3 to 5 cm only, on a path of 80 frames: its errors of 1 to 3 % of the path are those of the truth.",
]
HEAD = "| strength | film | placed % | worlds | ATE % of path | to the film as it is | beyond 99.9 % | verdict | said |"


def page(made_by, results):
    wrong = silent(results)
    yield from [
        "# Hard footage", "", f"Made by `scripts/results hard`: {made_by}.", "",
        "Two rendered films and two real ones, made harder by `scripts/degrade.py` until tracking breaks. `track` runs with its "
        "defaults and knows nothing of it. ATE is the rmse of the main world's positions after alignment by a similarity, in % of "
        "its true path; `beyond` is the part of its frames whose aligned position is farther off than the 99.9 % ellipsoid of "
        "`covariance.csv` says. That covariance holds the map for true: drift alone puts frames beyond it, so the films as they are have such "
        "frames too.", "",
        f"A path is *wrong* where its ATE is more than {WRONG_RATIO} times that of the film as it is, more than {WRONG_PERCENT} % of the path, and more than "
        f"{WRONG_BEYOND} % of its frames are beyond their ellipsoids. Something was *said* where the program warned on stderr (a start that is "
        "still waited for does not count), left out frames after the first one posed, gave several worlds, marked frames whose "
        f"place is not known, or ended with an error. A run is *lost* where the places of less than {BROKEN_PLACED} % of its frames are known; each of the "
        "others has its reason in `report.json`, or is one that only turned.", "",
        f"Wrong and silent: {len(wrong)} of {len(experiments()) - len(FILMS)} runs"
        + (f" ({'; '.join(wrong)})." if wrong else "."), "",
        "| kind | strength in | " + " | ".join(FILMS) + " |", "|---|---|" + "---|" * len(FILMS)]
    for kind, (unit, _, _) in KINDS.items():
        yield f"| {kind} | {unit} | " + " | ".join(summary_cell(kind, film, results) for film in FILMS) + " |"
    yield from ["", *(f"- {line}" for line in LOOKED_AT)]
    yield from ["", "## The films as they are", "", "| film | placed % | worlds | ATE % of path | beyond 99.9 % | said |",
                "|---|---|---|---|---|---|"]
    for film in FILMS:
        r = results.get(name_of(film, "none", 0))
        yield f"| {film} | " + (f"{r['posed_percent']:.0f} | {r['worlds']} | {number(r.get('ate_percent'), 2)} | "
                                f"{number(r.get('beyond_percent'), 0)} | {shown_words(r['said'])} |" if r else "not yet run | | | | |")
    for kind, (unit, strengths, what) in KINDS.items():
        yield from ["", f"## {kind[0].upper()}{kind[1:]}", "", f"Strength in {unit}: {what}.", "", HEAD, "|---|" + "---|" * 8]
        yield from (row(kind, strength, film, results) for strength in strengths for film in films_of(kind))
    shown = "; ".join(f"`{c}`" for c in kept.Kept.shown(experiment("FILM", "KIND", 0)))
    yield from ["", f"Each run: {shown}. The rendered films: " +
                "; ".join(f"{name}: `raysfm synth {' '.join(flags)}`" for name, flags in RENDERED.items()) +
                f", of which {RENDERED_FRAMES} frames are used. The real ones: " + ", ".join(f"{name}: the first {count} frames of `{folder}`"
                                                for name, (folder, count) in REAL.items()) + ".", ""]


def python_with_numpy():
    """This Python, or the one of Debian: whichever has numpy and Pillow."""
    for program in (sys.executable, "/usr/bin/python3"):
        if subprocess.run([program, "-c", "import numpy, PIL"], capture_output=True).returncode == 0:
            return pathlib.Path(program)
    return ROOT / "numpy-and-pillow-are-missing"


def without_python():
    """What is missing to degrade films, by name."""
    return set() if python_with_numpy().exists() else {"numpy or Pillow"}


def paths(program, data):
    films = {name: FOLDER / "films" / name for name in RENDERED} | {name: data / folder for name, (folder, _) in REAL.items()}
    return films | {"raysfm": program, "python": python_with_numpy(), "degrade": ROOT / "scripts" / "degrade.py"}


def render(program):
    """The films that are not there yet."""
    for name, flags in RENDERED.items():
        folder = FOLDER / "films" / name
        if (folder / "truth.txt").exists():
            continue
        papers.tell(f"rendering {name}")
        fresh = folder.with_name(f"{name}.new")
        shutil.rmtree(fresh, ignore_errors=True)
        done = subprocess.run([str(program), "synth", *flags, "--out", str(fresh), "--quiet"], capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"scripts/results: synth failed: {done.stderr.strip()}")
        os.replace(fresh, folder)


def keeper(program, data):
    (FOLDER / "films").mkdir(parents=True, exist_ok=True)
    render(program)
    return kept.Kept(FOLDER / "kept", paths(program, data))


def run(program, data, machine, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    if missing := without_python():
        sys.exit(f"scripts/results: {', '.join(missing)} is missing")
    keep = keeper(program, data)
    finished = papers.run_all(keep, [e for e in experiments() if only in e.name])
    results = {e.name: record["result"] for e in experiments() if (record := keep.get(e))}
    (ROOT / "docs" / "results").mkdir(parents=True, exist_ok=True)
    (ROOT / "docs" / "results" / "hard.md").write_text("\n".join(page(papers.made_by(program, machine), results)))
    print(f"written: docs/results/hard.md, {len(results)} of {len(experiments())} runs, {len(silent(results))} wrong and silent")
    return 0 if finished else 130


# Of --check: kind, strength, and whether the path must hold or a wrong one must be told.
CHECKED = [("noise", 10, "holds"), ("walkers", 40, "told")]


def misses(results):
    """What of the checked runs is not as it must be, as texts."""
    plain = results[name_of("kitti07", "none", 0)]
    missed = []
    for kind, strength, must in CHECKED:
        result = results[name_of("kitti07", kind, strength)]
        what = verdict(result, plain)
        if (what != "holds") if must == "holds" else (is_wrong(result, plain) and not result["said"]):
            missed.append(f"{name_of('kitti07', kind, strength)}: {what}, ATE {number(result.get('ate_percent'), 2)} % of the path, "
                          f"{must} wanted")
    return missed


def check(program, data):
    """The quick subset, 3 runs of 60 frames; returns how many are not as they must be."""
    keep = kept.Kept(FOLDER / "kept", paths(program, data))
    wanted = [experiment("kitti07", kind, strength) for kind, strength, _ in [("none", 0, ""), *CHECKED]]
    if missing := {name for e in wanted for name in keep.missing(e)} | without_python():
        print(f"hard: skipped, {', '.join(sorted(missing))} is missing")
        return 0
    papers.run_all(keep, wanted)
    results = {e.name: record["result"] for e in wanted if (record := keep.get(e))}
    missed = misses(results) if len(results) == len(wanted) else ["a run failed"]
    print(f"hard: {len(results)} of {len(wanted)} runs, {len(missed)} not as they must be")
    for line in missed:
        print(f"  {line}", flush=True)
    return len(missed)
