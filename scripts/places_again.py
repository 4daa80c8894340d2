"""Films of worlds that are gone round more than once: what closing the loop does to the drift, and whether any loop
was closed that is none. For scripts/results."""
import json
import math
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

SEEDS = (1, 2, 3)
RECIPES = ["town-pinhole", "town-fisheye", "town-mirror", "town-stereo", "town-tri", "terrace-pinhole"]
FALSE_CLOSURE = 0.01  # part of the path by which the two frames of a closure lie wrongly to each other


def run(command):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True)


def film(program, root, recipe, seed):
    folder = root / "demo" / "places" / f"{recipe}-{seed}"
    if not (folder / "truth.txt").exists():
        print(f"rendering {folder.name}", file=sys.stderr)
        done = run([program, "synth", "--config", root / "scripts" / "recipes" / f"{recipe}.yaml", "--seed", seed,
                    "--out", folder, "--quiet"])
        if done.returncode != 0:
            sys.exit(f"scripts/results: synth failed: {done.stderr.strip()}")
    return folder


def read_trajectory(path):
    """Poses of a file in TUM format by their time in milliseconds: position and quaternion (x, y, z, w)."""
    poses = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            numbers = [float(word) for word in line.split()]
            poses[round(1000 * numbers[0])] = (numbers[1:4], numbers[4:8])
    return poses


def rotated(quaternion, d):
    x, y, z, w = quaternion
    t = [2 * (y * d[2] - z * d[1]), 2 * (z * d[0] - x * d[2]), 2 * (x * d[1] - y * d[0])]
    return [d[0] + w * t[0] + y * t[2] - z * t[1], d[1] + w * t[1] + z * t[0] - x * t[2],
            d[2] + w * t[2] + x * t[1] - y * t[0]]


def seen_from(a, b):
    """Where the pose b is in the frame of the pose a."""
    x, y, z, w = a[1]
    return rotated((-x, -y, -z, w), [q - p for p, q in zip(a[0], b[0])])


def turn_of_camera(folder):
    """The rotation of the only camera in its rig: poses of a single camera are its own. No rotation for a rig of several."""
    text = (folder / "camera.yaml").read_text()
    turns = re.findall(r"rig_from_cam: \{rotation: \[([^\]]*)\]", text)
    if text.count("name:") != 1 or not turns:
        return (0, 0, 0, 1)
    return tuple(float(number) for number in turns[0].split(","))


def in_rig(poses, turn):
    """The same poses with the rotations of the rig."""
    def times(p, q):
        (x, y, z, w), (a, b, c, d) = p, q
        return (w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a, w * c + x * b - y * a + z * d,
                w * d - x * a - y * b - z * c)
    back = (-turn[0], -turn[1], -turn[2], turn[3])
    return {time: (place, times(rotation, back)) for time, (place, rotation) in poses.items()}


def apart(estimate, truth, scale, a, b):
    """Metres by which two frames lie wrongly to each other."""
    found = [scale * c for c in seen_from(estimate[a], estimate[b])]
    return math.dist(found, seen_from(truth[a], truth[b]))


def gap(estimate, truth, scale):
    """Median over the frames of a later round of how wrongly they lie to the nearest frame of an earlier one; NaN
    where there is none."""
    times = sorted(set(estimate) & set(truth))
    errors = []
    for j, b in enumerate(times):
        way, earlier = 0, []
        for i in range(j - 1, -1, -1):
            way += math.dist(truth[times[i]][0], truth[times[i + 1]][0])
            if way > 50:
                earlier.append(times[i])
        same = [a for a in earlier if math.dist(truth[a][0], truth[b][0]) < 1 and
                seen_alike(truth[a][1], truth[b][1])]
        if same:
            a = min(same, key=lambda time: math.dist(truth[time][0], truth[b][0]))
            errors.append(apart(estimate, truth, scale, a, b))
    return statistics.median(errors) if errors else math.nan


def seen_alike(p, q):
    """Whether two rotations are less than 30 degrees from each other."""
    return abs(sum(a * b for a, b in zip(p, q))) > math.cos(math.radians(15))


def track(program, folder, loops):
    with tempfile.TemporaryDirectory() as out:
        done = run([program, "track", folder, "--loops", loops, "--out", out, "--threads", 1, "--quiet"])
        if done.returncode != 0:
            return {"message": done.stderr.strip()}
        return measure(program, folder, pathlib.Path(out))


def measure(program, folder, out):
    """What a result says beside the truth of its film."""
    found = json.loads(run([program, "eval", out, folder / "truth.txt", "--align", "sim3", "--json"]).stdout)
    estimate = in_rig(read_trajectory(out / "trajectory.txt"), turn_of_camera(folder))
    truth = read_trajectory(folder / "truth.txt")
    result = {"report": json.loads((out / "report.json").read_text()), "ate": found["ate"]["rmse"],
              "gap": gap(estimate, truth, found["scale"])}
    times = sorted(truth)
    ends = [(times[c["frame"]], times[c["with_frame"]]) for c in result["report"].get("closures", [])]
    result["closures"] = len(ends)
    result["false"] = sum(apart(estimate, truth, found["scale"], a, b) > FALSE_CLOSURE * found["length_m"]
                          for a, b in ends if a in estimate and b in estimate)
    return result


def row(name, seed, off, on):
    for result in (off, on):
        if "message" in result:
            return f"| {name} | {seed} | {result['message']} |" + " |" * 9
    frames, timing = on["report"]["frames"], on["report"]["timing"]["frame"]
    cells = [name, str(seed), f"{frames['posed']} of {frames['total']}", str(len(on["report"]["segments"])),
             str(on["report"]["keyframes"]), str(on["closures"]), str(on["false"]), f"{off['gap']:.3f}",
             f"{on['gap']:.3f}", f"{off['gap'] / on['gap']:.0f}", f"{off['ate']:.3f}", f"{on['ate']:.3f}"]
    return "| " + " | ".join(cells) + f" | {timing['max_ms']:.0f} |"


def rows(program, root, only):
    for recipe in RECIPES:
        for seed in SEEDS:
            if only in f"{recipe}-{seed}":
                folder = film(program, root, recipe, seed)
                yield row(recipe, seed, track(program, folder, "off"), track(program, folder, "on"))


def write_table(path, made_by, lines):
    text = [
        "# Places seen again", "",
        f"Made by `scripts/results places`: {made_by}.",
        "Recipes of `scripts/recipes`, three seeds each: a world that is gone round once and a part of a second time. "
        "`drift` is how wrongly a frame of the second round lies to the frame of the first that was nearest to it and "
        "looked the same way: the median, metres; `before` with `--loops off`. ATE is the rmse after alignment by a "
        "similarity, metres. A closure is false where its two frames lie wrongly to each other in the end by more than 1 % of the "
        "path; the terrace repeats itself every 10 m. The last column is the longest time of a frame, that of the closing or "
        "of a rig's search for its scale.", "",
        "| film | seed | posed | worlds | key frames | closures | false | drift before | after | ratio | ATE before | "
        "after | longest frame ms |", "|---|" + "---|" * 12, *lines, "",
    ]
    path.write_text("\n".join(text))
    print(f"written: docs/results/{path.name}")
