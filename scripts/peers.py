"""COLMAP on the same images, with and without the calibration: docs/results/peers.md, made by scripts/results.

Experiments are kept in demo/papers/peers until their commands, programs or inputs change.
"""
import math
import os
import pathlib
import re
import shutil
import struct

import aligned
import kept
import papers
from places_again import read_trajectory, rotated

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDER = ROOT / "demo" / "papers" / "peers"
# name, sequence of the shared data, its images, frames taken from the beginning.
SEQUENCES = {"kitti07-mono": ("kitti07-mono", "image_0", 100), "tsukuba-mono": ("tsukuba-mono", "images", 100),
             "kitchen-100": ("redkitchen-handheld", "images", 100)}
WORDS = {True: "given", False: "withheld"}  # the calibration
FEATURES = 2000  # of COLMAP: its default of 8192 takes hours to match without a graphics card


def intrinsics(camera_file):
    return {k: float(v) for k, v in re.findall(r"(\w+): ([-+.\de]+)", re.search(r"intrinsics: \{(.*)\}", camera_file).group(1))}


def colmap_camera(camera_file):
    """Flags of feature_extractor for a calibration that is given: COLMAP counts pixels from the corner of the first."""
    n = intrinsics(camera_file)
    numbers = [n["fx"], n["fy"], n["cx"] + 0.5, n["cy"] + 0.5, *(n.get(k, 0.0) for k in ("k1", "k2", "p1", "p2"))]
    return ["--ImageReader.camera_model", "OPENCV", "--ImageReader.camera_params", ",".join(map(repr, numbers))]


def prepare(folder, source, images, count):
    """A sequence of the first images and without a calibration, which lies beside it as `camera.yaml`."""
    if (folder / "camera.yaml").exists():
        return
    (folder / "sequence" / "images").mkdir(parents=True, exist_ok=True)
    for image in sorted((source / images).iterdir())[:count]:
        shutil.copy(image, folder / "sequence" / "images")
    times = (source / "times.txt").read_text().split()[:count]
    (folder / "sequence" / "times.txt").write_text("\n".join(times) + "\n")
    shutil.copy(source / "truth.txt", folder)
    shutil.copy(source / "camera.yaml", folder)


def colmap_centres(path):
    """Places of the cameras of a COLMAP model by the names of the images."""
    data, found = path.read_bytes(), {}
    count, at = struct.unpack_from("<Q", data)[0], 8
    for _ in range(count):
        w, x, y, z, *t = struct.unpack_from("<7d", data, at + 4)
        end = data.index(b"\0", at + 64)
        found[data[at + 64:end].decode()] = [-c for c in rotated((-x, -y, -z, w), t)]
        at = end + 9 + 24 * struct.unpack_from("<Q", data, end + 1)[0]
    return found


def compared(places, truth, total):
    """`places` and `truth` by their times; errors after alignment by a similarity, metres."""
    times = sorted(set(places) & set(truth))
    result = {"coverage_percent": 100 * len(times) / total}
    if len(times) < 3:
        return result
    move = aligned.similarity([places[t] for t in times], [truth[t] for t in times])
    errors = [math.dist(move(places[t]), truth[t]) for t in times]
    return result | {"mean_m": sum(errors) / len(errors), "max_m": max(errors)}


def truth_of(printed):
    lines = [[float(word) for word in line.split()] for line in printed.splitlines() if not line.startswith("#")]
    return {round(1000 * line[0]): line[1:4] for line in lines if line}


def judged_colmap(folder, outputs):
    """The last two commands printed the times of the images and the truth."""
    times = [round(1000 * float(line)) for line in outputs[-2].split()]
    models = [colmap_centres(path) for path in sorted((folder / "model").glob("*/images.bin"))]
    largest = max(models, key=len, default={})
    places = {times[number]: largest[name] for number, name in enumerate(outputs[0].split()) if name in largest}
    seconds = [printed.seconds for printed in outputs[1:-2]]
    return compared(places, truth_of(outputs[-1]), len(times)) | {"seconds": sum(seconds), "steps": seconds,
                                                                  "models": len(models)}


def judged_raysfm(folder, outputs):
    """The last two commands printed the times of the images and the truth."""
    path = folder / "o" / "trajectory.txt"
    places = {time: place for time, (place, _) in read_trajectory(path).items()} if path.exists() else {}
    models = 1 + len(list((folder / "o" / "worlds").glob("*"))) if places else 0
    result = compared(places, truth_of(outputs[-1]), len(outputs[-2].split()))
    return result | {"seconds": outputs[0].seconds, "models": models, "message": outputs[0].error.split("sequence: ")[-1]}


def raysfm_experiment(name, given):
    flags = ["--camera", f"{{{name}}}/camera.yaml"] if given else []
    track = ["{raysfm}", "track", f"{{{name}}}/sequence", "--out", "{out}/o", "--threads", "2", "--quiet", *flags]
    return kept.Experiment(f"raysfm, {name}, {WORDS[given]}", [track, *judge(name)], judged_raysfm, ["raysfm"], [name],
                           may_fail=True)


def colmap_experiment(name, given):
    commands = [["ls", f"{{{name}}}/sequence/images"], *colmap_commands(name, given), *judge(name)]
    return kept.Experiment(f"colmap, {name}, {WORDS[given]}", commands, judged_colmap, ["colmap"], [name], may_fail=True)


def judge(name):
    return [["cat", f"{{{name}}}/sequence/times.txt"], ["cat", f"{{{name}}}/truth.txt"]]


def experiments():
    """Quick ones first."""
    return [make(name, given) for make in (raysfm_experiment, colmap_experiment) for given in (True, False)
            for name in SEQUENCES]


def colmap_commands(name, given):
    path = FOLDER / "sequences" / name / "camera.yaml"
    camera = colmap_camera(path.read_text()) if given and path.exists() else []
    held = [word for what in ("focal_length", "extra_params") for word in (f"--Mapper.ba_refine_{what}", "0")] if given else []
    images = ["--database_path", "{out}/colmap.db", "--image_path", f"{{{name}}}/sequence/images"]
    return [["{colmap}", "feature_extractor", *images, "--ImageReader.single_camera", "1", *camera,
             "--SiftExtraction.use_gpu", "0", "--SiftExtraction.max_num_features", str(FEATURES)],
            ["{colmap}", "sequential_matcher", "--database_path", "{out}/colmap.db", "--SiftMatching.use_gpu", "0"],
            ["mkdir", "{out}/model"], ["{colmap}", "mapper", *images, "--output_path", "{out}/model", *held]]


def cell(result, key, digits):
    return f"{result[key]:.{digits}f}" if key in result else "-"


def table(records):
    for name in SEQUENCES:
        for given in WORDS.values():
            for tool in ("raysfm", "colmap"):
                record = records.get(f"{tool}, {name}, {given}")
                if record is None:
                    yield f"| {name} | {given} | {tool} | not yet run |" + " |" * 5
                    continue
                r = record["result"]
                times = f"{r['seconds']:.1f} | {record.get('processor_seconds', '-')}"
                if not r["models"]:
                    yield f"| {name} | {given} | {tool} | 0 | {r.get('message', '')} | - | 0 | {times} |"
                    continue
                yield (f"| {name} | {given} | {tool} | {r['coverage_percent']:.0f} | {cell(r, 'mean_m', 4)} | {cell(r, 'max_m', 4)} | "
                       f"{r['models']} | {times} |")


def write(path, made_by, records):
    commands = [f"| {name} | " + "<br>".join(f"`{c}`" for c in record["commands"]) + f" | {record['load']} | {record['made']} |"
                for name, record in records.items()]
    text = [
        "# Beside COLMAP", "", f"Made by `scripts/results peers`: {made_by}. Other programs ran at the same time.", "",
        f"COLMAP of Debian without a graphics card: `sequential_matcher` with its defaults, {FEATURES} features an image, `mapper`; "
        "focal length and distortion are held where the calibration is given. `track` of raysfm with its defaults, two threads; it goes "
        "through the frames in their order and never sees later ones, COLMAP adjusts everything again and again. Errors are of all "
        "frames with a pose in the largest model, after alignment by a similarity; the same arithmetic judges both. Frames that "
        "have no pose are not in the error: look at the coverage first. Seconds are wall time from images to poses, and seconds of the processor all that was run.", "",
        "| sequence | calibration | program | coverage % | mean error m | largest error m | models | seconds | of the processor |",
        "|---|---|---|---|---|---|---|---|---|", *table(records), "", "| experiment | commands | load | made |", "|---|---|---|---|", *commands, "",
    ]
    path.write_text("\n".join(text))
    print("written: docs/results/peers.md")


def run(program, data, machine, only=""):
    """Makes what is missing and writes the table. Returns the exit code: 130 where it was interrupted."""
    for name, (source, images, count) in SEQUENCES.items():
        if (data / source).exists():
            prepare(FOLDER / "sequences" / name, data / source, images, count)
    places = {"raysfm": program, "colmap": pathlib.Path(shutil.which("colmap") or "colmap-is-missing")}
    keeper = kept.Kept(FOLDER / "kept", places | {name: FOLDER / "sequences" / name for name in SEQUENCES})
    finished = papers.run_all(keeper, [e for e in experiments() if only in e.name])
    records = {e.name: record for e in experiments() if (record := keeper.get(e))}
    os.makedirs(ROOT / "docs" / "results", exist_ok=True)
    write(ROOT / "docs" / "results" / "peers.md", papers.made_by(program, machine), records)
    return 0 if finished else 130
