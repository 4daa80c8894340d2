"""Photos whose lens nobody tells, sets and halves, beside COLMAP: docs/results/photos.md, made by scripts/results.

Runs are kept in demo/photos/kept until their commands, programs or inputs change.
"""
import dataclasses
import itertools
import json
import math
import pathlib
import random
import re
import shutil
import statistics
import struct
import subprocess

import kept
import papers
from aligned import similarity
from places_again import rotated

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "photos"
SEEDS = range(10)  # of the halves


@dataclasses.dataclass(frozen=True)
class Set:
    """Photos of the shared data."""
    name: str
    truth: str = "camera.yaml"  # where the lens is; lens.csv has one for each photo
    beside: bool = True  # halves of it are run, and COLMAP


SETS = [Set("temple-ring"), Set("fountain-p11"), Set("herzjesu-p8"), Set("zoom-herzjesu-p25", truth="lens.csv"),
        Set("bonsai-photos", beside=False)]
HALVED = [s for s in SETS if s.beside]
LISTED = ["find", "{out}/half", "-type", "l", "-fprintf", "{out}/half.txt", "%f\\n"]  # the names of a half
TOOLS = {"raysfm": "`raysfm`", "colmap": "COLMAP"}
STEPS = ("features", "matching", "mapper")  # of COLMAP


def half(names, seed):
    """A random half of the photos, in their order."""
    chosen = random.Random(1000 + seed).sample(range(len(names)), len(names) // 2)
    return [names[i] for i in sorted(chosen)]


def true_lens(text, count):
    """fx of each photo, and k1 and k2 where the truth has them: of a lens.csv or of a camera file."""
    if text.startswith("timestamp"):
        return [float(line.split(",")[1]) for line in text.split()[1:]], {}
    found = {k: float(v) for k, v in re.findall(r"(\w+): ([-+.\de]+)", re.search(r"intrinsics: \{(.*)\}", text).group(1))}
    return [found["fx"]] * count, {k: found[k] for k in ("k1", "k2") if k in found}


def true_places(text):
    """Of each photo, from a truth.txt in their order."""
    return [[float(word) for word in line.split()[1:4]] for line in text.splitlines() if line and line[0] != "#"]


def focal_lengths(data):
    """By the numbers of the cameras of a cameras.bin of COLMAP."""
    found, at = {}, 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        camera, model = struct.unpack_from("<ii", data, at)
        found[camera] = struct.unpack_from("<d", data, at + 24)[0]
        at += 24 + 8 * {0: 3, 1: 4, 2: 4, 3: 5, 4: 8}[model]
    return found


def posed_photos(folder):
    """Focal length and place of each photo of a model in COLMAP's binary files; none where there is no model."""
    if not (folder / "images.bin").exists():
        return {}
    data, focal = (folder / "images.bin").read_bytes(), focal_lengths((folder / "cameras.bin").read_bytes())
    found, at = {}, 8
    for _ in range(struct.unpack_from("<Q", data)[0]):
        w, x, y, z, *t = struct.unpack_from("<7d", data, at + 4)
        end = data.index(b"\0", at + 64)
        place = [-c for c in rotated((-x, -y, -z, w), t)]
        found[data[at + 64:end].decode()] = focal[struct.unpack_from("<i", data, at + 60)[0]], place
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
    return found


def place_error(found, true, extent):
    """The largest after alignment by a similarity, in % of `extent`."""
    move = similarity(found, true)
    return 100 * max(math.dist(move(p), q) for p, q in zip(found, true)) / extent


def judged(photos, outputs):
    """`photos` of posed_photos. The first command printed the names of the set, the last three those of the photos that
    were run, the true lens and the true places."""
    names, chosen = sorted(outputs[0].split()), sorted(outputs[-3].split())
    fx, distortion = true_lens(outputs[-2], len(names))
    result = {"posed": len(photos), "of": len(chosen), "out": [name for name in chosen if name not in photos],
              "truth": distortion}
    if not photos:
        return result
    index = {name: i for i, name in enumerate(names)}
    errors = [100 * abs(f / fx[index[name]] - 1) for name, (f, _) in photos.items()]
    result |= {"error_percent": statistics.mean(errors), "largest_percent": max(errors)}
    places = true_places(outputs[-1])
    if len(places) == len(names) and len(photos) > 3:
        extent = max(math.dist(p, q) for p in places for q in places)
        result["place_percent"] = place_error([p for _, p in photos.values()], [places[index[n]] for n in photos], extent)
    return result


def stated_sigma(report):
    """The median over the posed photos, in % of their focal lengths."""
    out = {frame["index"] for frame in report["frames"]["without_pose"]}
    parts = [100 * lens["sigma"][0] / lens["value"][0] for lens in report["lenses"] for first, last in lens["frames"]
             for i in range(first, last + 1) if i not in out]
    return statistics.median(parts)


def judged_raysfm(folder, outputs):
    """The last command but three was solve."""
    result = judged(posed_photos(folder / "o" / "sparse"), outputs) | {"seconds": outputs[-4].processor_seconds}
    path = folder / "o" / "report.json"
    if not path.exists():
        return result | {"message": outputs[-4].error}
    report = json.loads(path.read_text())
    timing = report["timing"]
    compare = sum(timing[stage]["mean_ms"] * timing[stage]["count"] / 1000
                  for stage in ("match", "compare", "compare again") if stage in timing)
    reasons = {f["image"]: f["reason"] for f in report["frames"]["without_pose"]}
    for world in report["worlds"][1:]:
        reasons |= {name: f"in {world['folder']}" for name in posed_photos(folder / "o" / world["folder"] / "sparse")}
    return result | {"sigma_percent": stated_sigma(report), "lens": report["lens"], "distortion": report["distortion"],
                     "reasons": reasons,
                     "compare_percent": 100 * compare / timing["wall_s"]}


def judged_colmap(folder, outputs):
    """The largest model. The last command but three was mapper."""
    models = [posed_photos(path) for path in sorted((folder / "model").iterdir())]
    return judged(max(models, key=len, default={}), outputs) | {"seconds": outputs[-4].processor_seconds,
                                                                "models": len(models)}


def matched(folder, outputs):
    """COLMAP's features and matches of a set."""
    return {"features": outputs[0].processor_seconds, "matching": outputs[1].processor_seconds}


def photos_of(name):
    return f"{{{name}}}/images"


def linked(name, photos):
    """Commands that make a folder of links to some photos of a set."""
    return [["mkdir", "{out}/half"], ["ln", "-s", *(f"{photos_of(name)}/{photo}" for photo in photos), "{out}/half"]]


def judge(photos, source):
    return [["ls", photos], ["cat", f"{{{source.name}}}/{source.truth}"], ["cat", f"{{{source.name}}}/truth.txt"]]


def name_of(tool, source, seed=None):
    return f"{tool}, {source.name}" + ("" if seed is None else f", seed {seed}")


def raysfm_experiment(source, seed=None, photos=None):
    """Of the whole set, or of some photos."""
    folder = "{out}/half" if photos else photos_of(source.name)
    solve = ["{raysfm}", "solve", folder, "--images", "photos", "--threads", "1", "--quiet", "--out", "{out}/o"]
    commands = [["ls", photos_of(source.name)], *(linked(source.name, photos) if photos else []), solve,
                *judge(folder, source)]
    return kept.Experiment(name_of("raysfm", source, seed), commands, judged_raysfm, ["raysfm"], [source.name],
                           may_fail=True)


def matches_of(source):
    return f"{source.name}-matches"


def matches_experiment(source):
    camera = "single_camera" if source.truth == "camera.yaml" else "single_camera_per_image"
    database = ["--database_path", "{out}/matches.db"]
    commands = [["{colmap}", "feature_extractor", *database, "--image_path", photos_of(source.name),
                 "--ImageReader.camera_model", "SIMPLE_RADIAL", f"--ImageReader.{camera}", "1",
                 "--SiftExtraction.use_gpu", "0", "--SiftExtraction.num_threads", "1"],
                ["{colmap}", "exhaustive_matcher", *database, "--SiftMatching.use_gpu", "0",
                 "--SiftMatching.num_threads", "1"]]
    return kept.Experiment(name_of("colmap", source) + ", matches", commands, matched, ["colmap"], [source.name],
                           leaves={matches_of(source): "matches.db"})


def colmap_experiment(source, seed=None, photos=None):
    """Of the whole set, or of some photos. The mapper gets a copy of the matches, as it writes into it."""
    half_of = [*linked(source.name, photos), LISTED] if photos else []
    mapper = ["{colmap}", "mapper", "--database_path", "{out}/colmap.db", "--image_path", photos_of(source.name),
              *(["--image_list_path", "{out}/half.txt"] if photos else []), "--output_path", "{out}/model",
              "--Mapper.min_model_size", "3", "--Mapper.num_threads", "1"]
    commands = [["ls", photos_of(source.name)], *half_of, ["cp", f"{{{matches_of(source)}}}", "{out}/colmap.db"],
                ["mkdir", "{out}/model"], mapper, *judge("{out}/half" if photos else photos_of(source.name), source)]
    return kept.Experiment(name_of("colmap", source, seed), commands, judged_colmap, ["colmap"],
                           [source.name, matches_of(source)], may_fail=True)


def names_of_photos(source, data):
    folder = data / source.name / "images"
    return sorted(path.name for path in folder.iterdir()) if folder.exists() else []


def experiments(data):
    """Quick ones first. Sets that are missing have no halves."""
    names = {source: names_of_photos(source, data) for source in SETS}
    halves = [(source, seed, half(names[source], seed)) for source in HALVED if names[source] for seed in SEEDS]
    return [*(raysfm_experiment(source) for source in HALVED), *(raysfm_experiment(*h) for h in halves),
            *(make(source) for source in HALVED for make in (matches_experiment, colmap_experiment)),
            *(colmap_experiment(*h) for h in halves), *(raysfm_experiment(s) for s in SETS if not s.beside)]


def with_matches(keep):
    """For papers.run_all: makes the matches that an experiment needs."""
    def prepare(experiment, title):
        for source in HALVED:
            made = matches_experiment(source)
            if matches_of(source) in experiment.inputs and (keep.missing(experiment) or not keep.get(made)):
                papers.tell(f"{title}: {made.name}")
                keep.run(made)
    return prepare


def number(value, digits=2):
    return "-" if value is None else f"{value:.{digits}f}"


def percent(result, key, digits=2):
    return number(result.get(key), digits) + (" %" if key in result else "")


def posed(result):
    return f"{result['posed']} of {result['of']}"


def lens_found(result):
    if "lens" not in result:
        return result["message"]
    return ", ".join([result["lens"], *(f"{k} {v:.{d}f}" for k, v, d in distortion_of(result))])


def distortion_of(result):
    """Name, value and digits of each coefficient that was kept."""
    found = result["distortion"] or {}
    return [(k, found[k], digits) for k, digits in (("k1", 4), ("k2", 3)) if k in found]


def raysfm_row(source, results):
    result = results.get(name_of("raysfm", source))
    if result is None:
        return f"| `{source.name}` | not yet run |" + " |" * 7
    return f"| `{source.name}` | " + " | ".join([
        posed(result), *(percent(result, k) for k in ("error_percent", "largest_percent", "sigma_percent")),
        lens_found(result), percent(result, "place_percent"), number(result["seconds"], 1),
        percent(result, "compare_percent", 0)]) + " |"


def colmap_row(source, results):
    result, matches = results.get(name_of("colmap", source)), results.get(name_of("colmap", source) + ", matches")
    ours = results.get(name_of("raysfm", source))
    if None in (result, matches, ours):
        return f"| `{source.name}` | not yet run |" + " |" * 8
    seconds = [matches["features"], matches["matching"], result["seconds"]]
    return f"| `{source.name}` | " + " | ".join([
        posed(result), *(percent(result, k) for k in ("error_percent", "largest_percent", "place_percent")),
        *(number(s, 1) for s in seconds), number(sum(seconds), 1), number(ours["seconds"], 1)]) + " |"


def half_cells(result, keys):
    if result is None:
        return ["not yet run", *("" for _ in keys)]
    return [posed(result), *(percent(result, key) for key in keys)]


def half_row(source, seed, results):
    ours, theirs = (results.get(name_of(tool, source, seed)) for tool in TOOLS)
    cells = [*half_cells(ours, ("error_percent", "sigma_percent", "place_percent")),
             *half_cells(theirs, ("error_percent", "place_percent"))]
    return f"| `{source.name}` | {seed} | " + " | ".join(cells) + " |"


def summary_row(source, tool, results):
    """Of the halves of a set that were run."""
    found = [results[name] for seed in SEEDS if (name := name_of(tool, source, seed)) in results]
    whole = sum(r["posed"] == r["of"] for r in found)
    errors = [r["error_percent"] for r in found if "error_percent" in r]
    places = [r["place_percent"] for r in found if "place_percent" in r]
    middle, most = (number(f(errors)) + " %" if errors else "-" for f in (statistics.median, max))
    return (f"| `{source.name}` | {TOOLS[tool]} | {whole} of {len(found)} | {sum(r['posed'] for r in found)} of "
            f"{sum(r['of'] for r in found)} | {middle} | {most} | " + (f"{max(places):.2f} % |" if places else "- |"))


def pairs(results):
    """What is said of a half, and the results of both programs, where both were run."""
    for source, seed in itertools.product(HALVED, SEEDS):
        ours, theirs = (results.get(name_of(tool, source, seed)) for tool in TOOLS)
        if ours and theirs:
            yield f"`{source.name}`, seed {seed}", ours, theirs


def left_out(results):
    """A line for each half of which raysfm leaves photos out."""
    for name, ours, theirs in pairs(results):
        if ours["posed"] < ours["of"]:
            of_both = sorted(set(ours["out"]) & set(theirs["out"]))
            reasons = ours.get("reasons", {})
            photos = "; ".join(f"{photo}: {reasons.get(photo, ours.get('message'))}" for photo in ours["out"])
            yield (f"- {name}: `raysfm` poses {posed(ours)} ({photos}), COLMAP {posed(theirs)}"
                   + (f" (of these photos it leaves out {', '.join(of_both)} too)." if of_both else "."))


def of_colmap_less(results):
    """A line for each half of which COLMAP poses fewer photos than raysfm."""
    return [f"- {name}: {posed(theirs)}, where `raysfm` poses {posed(ours)}." for name, ours, theirs in pairs(results)
            if theirs["posed"] < ours["posed"]]


def about_bonsai(results):
    result = results.get(name_of("raysfm", Set("bonsai-photos")))
    if result and result["truth"]:
        told = ", ".join(f"{k} {v:.4f}" for k, v in result["truth"].items())
        yield (f"Of `bonsai-photos` the calibration that is compared with is COLMAP's: {told} and tangential terms, "
               "which `solve` does not have. The truth of its places is not known.")
        yield ""


def table(head, rows):
    return [f"| {' | '.join(head)} |", "|" + "---|" * len(head), *rows, ""]


ABOUT_SETS = (
    "`raysfm solve PHOTOS --images photos`, nothing told. The error of fx against the truth is the mean over the "
    "photos that are posed, beside it the largest; sigma is the standard deviation that is stated of fx, the median "
    "over these photos, as a part of fx. The places of the cameras are aligned with the truth by a similarity; their "
    "largest error is given as a part of the greatest distance between two cameras of the set. Seconds of processor "
    "time, one thread, from photos to all files of the result, and which part of the run compared pairs of photos.")
ABOUT_TEMPLE = (
    "The errors of the matches of `temple-ring` have long tails. Least squares follow them, with Huber's loss or "
    "without, and its focal length would come out too long. This is not for want of distortion, nor by the principal "
    "point, which lies off the middle and of which its photos say next to nothing. Weighed as tracks of a video are, "
    "these errors do little.")
ABOUT_COLMAP = (
    "no graphics card: SIFT, all pairs compared, with its defaults but for one thread. Nothing is told of the lens: "
    "the camera model is SIMPLE_RADIAL, one camera for all photos of a set, or one for each photo where each has its "
    "own focal length, which `raysfm` is not told. The focal length that it begins with is 1.2 times the larger side. "
    "Counted is the largest model, and a model may be as small as three photos. Seconds of processor time from photos "
    "to poses; those of `raysfm` have the writing of its files in them too.")
ABOUT_HALVES = (
    "`random.Random(1000 + seed).sample(range(n), n // 2)` of Python says which of the n photos, counted in the order "
    f"of their names, are a half; seeds {SEEDS[0]} to {SEEDS[-1]}. Both programs see the same photos; COLMAP's "
    "features and matches are those of the whole sets. Counted is the main world, as COLMAP's largest model. Medians and largest errors are over the halves.")


def whole_sets(results):
    yield from [ABOUT_SETS, ""]
    yield from table(["photos", "posed", "error", "largest", "sigma", "lens", "largest error of place", "seconds",
                      "comparing pairs"], [raysfm_row(source, results) for source in SETS])
    yield from about_bonsai(results)
    yield from [ABOUT_TEMPLE, ""]


def beside_colmap(results, colmap):
    yield from ["## Beside COLMAP", "", f"{colmap}, {ABOUT_COLMAP}", ""]
    yield from table(["photos", "posed", "error", "largest", "largest error of place", *STEPS, "all", "`raysfm`"],
                     [colmap_row(source, results) for source in HALVED])


def halves_of_sets(results):
    yield from ["## Random halves", "", ABOUT_HALVES, ""]
    yield from table(["photos", "program", "halves posed whole", "photos posed", "median error", "largest error",
                      "largest error of place"],
                     [summary_row(source, tool, results) for source in HALVED for tool in TOOLS])
    yield from table(["photos", "seed", "posed", "error", "sigma", "largest error of place", "posed by COLMAP",
                      "its error", "its largest error of place"],
                     [half_row(source, seed, results) for source in HALVED for seed in SEEDS])
    yield from ["Halves of which `raysfm` leaves photos out, and why:", "", *(list(left_out(results)) or ["- none"])]
    yield from ["", "Halves of which COLMAP poses fewer photos than `raysfm`:", ""]
    yield from [*(of_colmap_less(results) or ["- none"]), ""]


def commands():
    zoom, fixed = Set("PHOTOS", truth="lens.csv"), Set("PHOTOS")
    shown = [raysfm_experiment(fixed), raysfm_experiment(fixed, 0, ["CHOSEN"]), matches_experiment(fixed),
             matches_experiment(zoom), colmap_experiment(fixed), colmap_experiment(fixed, 0, ["CHOSEN"])]
    what = ["a set, `raysfm`", "a half of it", "COLMAP's matches of a set", "of one with a camera for each photo",
            "a set, COLMAP", "a half of it"]
    rows = [f"| {words} | " + "<br>".join(f"`{c}`" for c in kept.Kept.shown(e)) + " |" for words, e in zip(what, shown)]
    yield from ["## Commands", "", "Those of each row. Results are compared with what `cat` prints.", ""]
    yield from table(["of", "commands"], rows)


def page(made_by, colmap, results):
    made = f"Made by `scripts/results photos`: {made_by}. Other programs ran at the same time."
    yield from ["# Photos", "", made, ""]
    yield from whole_sets(results)
    yield from beside_colmap(results, colmap)
    yield from halves_of_sets(results)
    yield from commands()


def colmap_version(path):
    if not path.exists():
        return "COLMAP (missing)"
    return subprocess.run([str(path), "help"], capture_output=True, text=True).stdout.partition(" -- ")[0].strip()


def paths(program, data):
    found = {"raysfm": program, "colmap": pathlib.Path(shutil.which("colmap") or "colmap-is-missing")}
    return found | {source.name: data / source.name for source in SETS} | \
        {matches_of(source): FOLDER / "kept" / f"{source.name}.db" for source in HALVED}


def run(program, data, machine, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    places = paths(program, data)
    keep = kept.Kept(FOLDER / "kept", places)
    finished = papers.run_all(keep, [e for e in experiments(data) if only in e.name], with_matches(keep))
    results = {e.name: record["result"] for e in experiments(data) if (record := keep.get(e))}
    lines = page(papers.made_by(program, machine), colmap_version(places["colmap"]), results)
    (ROOT / "docs" / "results" / "photos.md").write_text("\n".join(lines))
    print(f"written: docs/results/photos.md, {len(results)} of {len(experiments(data))} runs")
    return 0 if finished else 130
