"""What is taken from the runs behind the rows of docs/results/papers.md. For scripts/results.

Each function gets the folder in which the commands of an experiment ran and what they printed, and gives a dictionary.
A run leaves its results in the folder `o`.
"""
import csv
import json
import math
import re
import statistics
import struct

import aligned
from places_again import read_trajectory

COMPLETED = 0.95  # part of the frames with a pose in one world, below which a run counts as failed


def parsed(text):
    """What `raysfm eval --json` printed, or None."""
    return json.loads(text) if text.strip().startswith("{") else None


def report_of(folder):
    path = folder / "o" / "report.json"
    return json.loads(path.read_text()) if path.exists() else None


def run_numbers(folder):
    """Of a run of `track`."""
    report = report_of(folder)
    if report is None:
        return {"completed": False, "posed_percent": 0.0}
    frames = report["frames"]
    largest = max((world["frames"] for world in report["worlds"]), default=0)
    timing = report["timing"]
    return {"frames": frames["total"], "posed_percent": 100 * frames["posed"] / frames["total"],
            "completed": largest >= COMPLETED * frames["total"], "key_frames": report["keyframes"],
            "points": report["points"], "observations": report["observations"],
            "adjust_ms": timing.get("adjust", {}).get("mean_ms", math.nan),
            "frames_per_second": 1000 / timing["frame"]["mean_ms"],
            "detect_match_ms": sum(timing[stage]["mean_ms"] * timing[stage]["count"] for stage in ("detect", "match", "align"))
            / frames["total"]}


def error_numbers(found, prefix=""):
    """Of what `eval` printed; nothing where it found nothing."""
    if found is None:
        return {}
    return {prefix + "mean_m": found["ate"]["mean"], prefix + "max_m": found["ate"]["max"],
            prefix + "mean_2d_m": found["ate_xy"]["mean"], prefix + "length_m": found["length_m"],
            prefix + "percent": 100 * found["ate"]["mean"] / found["length_m"]}


def tracked(folder, outputs):
    """`track`, then `eval` of its key frames against the truth and, maybe, of its trajectory against another one."""
    result = run_numbers(folder) | error_numbers(parsed(outputs[1]))
    if len(outputs) > 2:
        result |= error_numbers(parsed(outputs[2]), "global_")
        if "global_percent" in result and "length_m" in result:  # the other one has a unit of its own
            result["global_mean_m"] = result["global_percent"] * result["length_m"] / 100
    if not result["completed"]:
        result["failed"] = f"failed ({result['posed_percent']:.0f} % of the frames posed)"
    return result


def points_of(path):
    """Positions of a binary PLY of `track`: float x, y, z and three bytes of colour."""
    data = path.read_bytes()
    header, body = data.split(b"end_header\n", 1)
    count = int(re.search(rb"element vertex (\d+)", header).group(1))
    assert len(body) == 15 * count, "not as docs say"
    return [struct.unpack_from("<fff", body, 15 * i) for i in range(count)]


def track_lengths(path):
    """How many points of a COLMAP model are seen in how many images: {images: points}."""
    data, lengths = path.read_bytes(), {}
    count, at = struct.unpack_from("<Q", data)[0], 8
    for _ in range(count):
        length = struct.unpack_from("<Q", data, at + 43)[0]
        lengths[length] = lengths.get(length, 0) + 1
        at += 51 + 8 * length
    return lengths


def rounded(points):
    return [[round(c, 2) for c in p] for p in points]


def path_numbers(folder, truth_poses):
    """Key frames, points and the truth in the frame of the truth: x to the right, z forward, y down."""
    truth = {time: place for time, (place, _) in truth_poses.items()}
    found = {time: place for time, (place, _) in read_trajectory(folder / "o" / "keyframes.txt").items() if time in truth}
    times = sorted(found)
    move = aligned.similarity([found[t] for t in times], [truth[t] for t in times])
    places = [move(found[t]) for t in times]
    points = points_of(folder / "o" / "points.ply")
    near = [move(p) for p in points[::max(1, len(points) // 4000)]]
    reach = 30 + max(math.dist(p, truth[times[0]]) for p in truth.values())
    return {"truth": rounded(truth[t] for t in sorted(truth)), "places": rounded(places),
            "map": rounded(p for p in near if math.dist(p, truth[times[0]]) < reach),
            "error_3d": [round(math.dist(p, truth[t]), 4) for p, t in zip(places, times)],
            "error_2d": [round(math.hypot(p[0] - truth[t][0], p[2] - truth[t][2]), 4) for p, t in zip(places, times)]}


def followed(folder, outputs):
    """`track`, `eval`, and all that figures 11 to 14 show; the last command printed the truth."""
    result = tracked(folder, outputs[:-1])
    truth = folder / "truth.txt"
    truth.write_text(outputs[-1])
    if not result["completed"]:
        return result
    result |= path_numbers(folder, read_trajectory(truth))
    result["mean_2d_m"] = statistics.fmean(result["error_2d"])
    model = folder / "o" / "sparse" / "points3D.bin"
    if model.exists():  # COLMAP has no model of a camera before a mirror
        lengths = track_lengths(model)
        result["track_lengths"] = sorted(lengths.items())
        result["mean_track"] = sum(n * p for n, p in lengths.items()) / sum(lengths.values())
    return result


def times_of_frames(folder, outputs):
    """`tracker_benchmark --frames`: LBA09 table 3 and figure 10, seconds."""
    with open(folder / "frames.csv") as file:
        frames = [(float(row["ms"]) / 1000, row["keyframe"] == "1") for row in csv.DictReader(file)]
    result = {"seconds": [round(s, 5) for s, _ in frames], "is_keyframe": [int(k) for _, k in frames]}
    for name, kind in (("other", False), ("key", True)):
        times = [s for s, k in frames if k == kind]
        result |= {f"{name}_max_s": max(times), f"{name}_mean_s": statistics.fmean(times), f"{name}_total_s": sum(times)}
    return result


def gains(folder, outputs):
    """`bundle_growth_benchmark`: LBA09 table 1."""
    rows = re.findall(r"n +(\d+) +N +(\d+) +([\d.]+) ms +gain +([\d.]+)", outputs[0])
    return {f"gain_{n}_{window}": float(gain) for n, window, _, gain in rows}


def kernels(folder, outputs):
    """`pless_benchmark`: LBA09 table 2."""
    rows = re.findall(r"^(\S+) (simple|across) (\d+) (\d+)$", outputs[0], re.MULTILINE)
    return {f"{rig} {matches}": int(low) if low == high else f"{low} to {high}" for rig, matches, low, high in rows}


def markdown_tables(text):
    """Tables of a text: (line before it that is not empty, rows as dictionaries of cells)."""
    tables, title, header = [], "", None
    for line in text.splitlines():
        if not line.startswith("|"):
            title, header = (line.strip() or title), None
            continue
        cells = [c.strip() for c in line.strip().strip("|").split("|")]
        if header is None:
            header = cells
            tables.append((title, []))
        elif not set(line) <= set("|-"):
            tables[-1][1].append(dict(zip(header, cells)))
    return tables


def number_in(cell):
    found = re.match(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", cell)
    return float(found.group()) if found else math.nan


METHODS = {"standard": "standard", "free, moments": "free", "free, least squares": "squares", "polished": "polished"}
QUANTITIES = {"CPU ms": "cpu", "iterations": "iterations", "structure error, mm": "structure", "focal error, %": "focal"}


def lens_figures(folder, outputs):
    """`ifba_benchmark`, figures 5 to 13: of each table the number on the left, and of each method the quantities."""
    result = {}
    for title, rows in markdown_tables(outputs[0]):
        axis = next(iter(rows[0]))
        kind = axis if "object" not in title else ("deforming" if "deforming" in title else "rigid")
        table = {"x": sorted({number_in(row[axis]) for row in rows}), "axis": axis}
        for row in rows:
            for quantity, name in QUANTITIES.items():
                table.setdefault(f"{METHODS[row['method']]} {name}", []).append(number_in(row[quantity]))
        result[kind] = table
    return result


def moment_figures(folder, outputs):
    """`ifba_benchmark --figure 2`: mean and deviation of each entry, in percent."""
    result = {}
    for number, (_, rows) in enumerate(markdown_tables(outputs[0])):
        axis = next(iter(rows[0]))
        table = {"x": [number_in(row[axis]) for row in rows], "axis": axis}
        for name in list(rows[0])[1:]:
            pairs = [re.match(r"([-+][\d.]+) . ([\d.]+)", row[name]).groups() for row in rows]
            table[name] = [[float(mean), float(deviation)] for mean, deviation in pairs]
        result[("Q", "K", "K of points")[number]] = table
    return result


def board_tables(folder, outputs):
    """`lens_boards_benchmark`: IFBA01 tables 1 and 2, medians over images and seeds."""
    result = {}
    for title, rows in markdown_tables(outputs[0]):
        name = next((n for n in ("Table 1", "Table 2") if title.startswith(n)), None)
        if name and "iterations" in rows[0]:
            for row in rows:
                result[f"{name} {row['']}"] = {"focal": number_in(row["focal length, median"]),
                                               "centre": number_in(row["principal point, median"]),
                                               "iterations": number_in(row["iterations"]), "ms": number_in(row["ms"])}
    return result
