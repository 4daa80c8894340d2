"""What becomes of a calibration that is off: docs/results/lens.md, made by scripts/results.

Each sequence is run with its calibration as given, and with one number of it wrong on purpose, refined and not.
"""
import json
import os
import pathlib
import re
import subprocess
import tempfile

import true_lens

# Perspective cameras without distortion, of which true poses are known.
TRUE = ["tsukuba-mono", "kitti07-mono"]
# name, input and truth below the data folder, camera file; numbers that are wrong on purpose.
PERSPECTIVE = ["f * 1.02", "f * 0.98", "cx + 5", "k1 + 0.03", "f * 1.3"]
OTHER = ["f * 1.01", "f * 0.99"]
SEQUENCES = [
    dict(name="kitti00-small", input="kitti00-small/video.mp4", wrong=PERSPECTIVE),
    dict(name="kitti07-mono", wrong=PERSPECTIVE),
    dict(name="kitti06-stereo", wrong=OTHER),
    dict(name="tsukuba-mono", wrong=PERSPECTIVE),
    dict(name="redkitchen-handheld", input="redkitchen-handheld/first200.mp4", wrong=PERSPECTIVE),
    dict(name="fr1-rpy", wrong=[]),
    dict(name="rendered/fisheye190", wrong=OTHER),
    dict(name="rendered/mirror", wrong=OTHER),
    dict(name="rendered/tri-rig", wrong=OTHER),
]


def spoiled(text, wrong):
    """A camera file with one number of every camera wrong: "f * 1.02", "cx + 5"."""
    name, operation, amount = wrong.split()

    def spoil(match):
        numbers = {k: float(v) for k, v in re.findall(r"(\w+):\s*([-+.\deE]+)", match.group(1))}
        for key in ["fx", "fy"] if name == "f" else [name]:
            value = numbers.get(key, 0.0)
            numbers[key] = value * float(amount) if operation == "*" else value + float(amount)
        if name == "k1":
            numbers = {"k2": 0.0, "p1": 0.0, "p2": 0.0, **numbers}
        return "intrinsics: {" + ", ".join(f"{k}: {v!r}" for k, v in numbers.items()) + "}"

    text = re.sub(r"intrinsics:\s*\{([^}]*)\}", spoil, text)
    return text.replace("model: pinhole", "model: radtan") if name == "k1" else text


# Name, folder of images below the data folder; parts of them by what is kept of a number of images.
FOUND = [("tsukuba-mono", "images"), ("kitti07-mono", "image_0"), ("redkitchen-handheld", "images")]
PARTS = {"all": lambda i, n: True, "every second": lambda i, n: i % 2 == 0, "the others": lambda i, n: i % 2 == 1,
         "first half": lambda i, n: i < n // 2, "second half": lambda i, n: i >= n // 2}


def found_row(program, data, name, images, part, threads):
    """The focal length that a part of a sequence tells without a camera file, and how far that is from the file's."""
    paths = sorted((data / name / images).iterdir())
    given = float(re.search(r"fx:\s*([-+.\deE]+)", (data / name / "camera.yaml").read_text()).group(1))
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch) / "images"
        folder.mkdir()
        for i, path in enumerate(paths):
            if PARTS[part](i, len(paths)):
                os.symlink(path, folder / path.name)
        done = subprocess.run([str(program), "track", str(folder), "--out", scratch + "/out", "--threads", str(threads), "--quiet"],
                              capture_output=True, text=True)
        if done.returncode:
            return f"| {name} | {part} | {done.stderr.strip().splitlines()[-1].split(': ', 2)[-1].split(';')[0]} | | |"
        report = json.loads((pathlib.Path(scratch) / "out" / "report.json").read_text())
    fx = next(n for n in report["calibration"] if n["name"] == "fx")
    return f"| {name} | {part} | {fx['refined']:.1f} ± {fx['sigma']:.1f} | {given:.1f} | {(fx['refined'] - given) / fx['sigma']:+.1f} |"


def found_rows(program, data, threads):
    for name, images in FOUND:
        if (data / name).exists():
            for part in PARTS:
                yield found_row(program, data, name, images, part, threads)


def run_once(program, data, sequence, camera_text, refine, threads):
    """Report and evaluation of a run, or None."""
    folder = data / sequence["name"]
    with tempfile.TemporaryDirectory() as scratch:
        camera = pathlib.Path(scratch) / "given.yaml"
        camera.write_text(camera_text)
        out = pathlib.Path(scratch) / "out"
        subprocess.run([str(program), "track", str(data / sequence.get("input", sequence["name"])), "--camera",
                        str(camera), "--out", str(out), "--refine-lens", refine, "--threads", str(threads), "--quiet"],
                       capture_output=True)
        if not (out / "report.json").exists():
            return None
        report = json.loads((out / "report.json").read_text())
        done = subprocess.run([str(program), "eval", str(out), str(folder / "truth.txt"), "--align", "sim3",
                               "--json"], capture_output=True, text=True)
        return report, json.loads(done.stdout) if done.returncode == 0 else None


def outcome(result):
    """Frames posed, mean ATE in % of the path and scale of a run, for the table."""
    if result is None or result[1] is None:
        return "no result"
    report, evaluation = result
    percent = 100 * evaluation["ate"]["mean"] / evaluation["length_m"]
    scale = f", scale {evaluation['scale']:.4f}" if report["scale"] == "metric" else ""
    frames = report["frames"]
    lost = f", {frames['posed']} of {frames['total']} posed" if frames["posed"] < frames["total"] else ""
    return f"{percent:.3f}{scale}{lost}"


def changes(result):
    """The numbers that were refined, and those that are not told."""
    if result is None:
        return "-", "-"
    numbers = result[0].get("calibration", [])
    several = len({n["camera"] for n in numbers}) > 1

    def name(n):
        return f"{n['name']} of {n['camera']}" if several else n["name"]

    refined = [f"{name(n)} {n['given']:.6g} to {n['refined']:.6g} ± {n['sigma']:.2g}"
               for n in numbers if abs(n["refined"] - n["given"]) > 1e-3 * n["sigma"]]
    if result[0]["lens_source"] == "footage":
        refined.insert(0, f"own lens of the footage: f {result[0]['lens_focal_px']:.6g}")
    return ", ".join(refined) or "as given", ", ".join(name(n) for n in numbers if not n["told"]) or "none"


def rows(program, data, threads, only):
    """Rows of the table as they are made."""
    for sequence in SEQUENCES:
        folder = data / sequence["name"]
        if only not in sequence["name"] or not folder.exists():
            continue
        given = (folder / "camera.yaml").read_text()
        for wrong in ["nothing", *sequence["wrong"]]:
            text = given if wrong == "nothing" else spoiled(given, wrong)
            kept = run_once(program, data, sequence, text, "off", threads)
            refined = run_once(program, data, sequence, text, "auto", threads)
            yield f"| {sequence['name']} | {wrong} | {outcome(kept)} | {outcome(refined)} | " + \
                " | ".join(changes(refined)) + " |"


def true_rows(program, data, threads):
    """What the lens of a sequence is by its true poses."""
    if true_lens.np is None:
        print("scripts/results: numpy is missing, lenses by true poses are left out")
        return
    for name in TRUE:
        folder = data / name
        if not folder.exists():
            continue
        given = [float(re.search(key + r":\s*([-+.\deE]+)", (folder / "camera.yaml").read_text()).group(1))
                 for key in ["fx", "fy", "cx", "cy"]]
        with tempfile.TemporaryDirectory() as out:
            subprocess.run([str(program), "track", str(folder), "--out", out, "--refine-lens", "off", "--threads",
                            str(threads), "--quiet"], capture_output=True)
            numbers, before, after = true_lens.fit(pathlib.Path(out) / "sparse" / "images.bin", folder / "truth.txt", given)
        cells = [f"{given:.6g} to {true:.6g} ± {sigma:.2g}" for _, given, true, sigma in numbers]
        yield f"| {name} | " + " | ".join(cells) + f" | {before:.3f} to {after:.3f} |"


def by_true_poses(lines):
    """Their section of the table, which is left out where there are none."""
    return lines and [
        "## What the lenses are by the true poses", "",
        "Tracks of a run with the calibration kept, triangulated from the *true* poses of each sequence; focal length, principal "
        "point and k1 are then the least squares of what is left. Errors of a track count as one. The poses of `kitti07-mono` "
        "are those of a GPS and an inertial sensor: how that was mounted goes into the principal point.", "",
        "| sequence | fx | cx | cy | k1 | rms, px |", "|---|---|---|---|---|---|", *lines, ""]


def write_table(path, made_by, lines, true_lines, found_lines):
    path.write_text("\n".join([
        "# Calibrations that are off", "", made_by,
        "Mean ATE in % of the path after alignment by a similarity, with the calibration kept (`--refine-lens off`) and "
        "refined (`auto`); where the scale is metric, the factor to the truth. \"Wrong\" is a number of every camera that was "
        "changed on purpose. \"Not told\" is what the footage says less of than calibrations are known to begin with: it stays "
        "as given.", "",
        "| sequence | wrong | kept: ATE % | refined: ATE % | refined numbers | not told |", "|---|---|---|---|---|---|",
        *lines, "",
        *by_true_poses(true_lines),
        "## How sure found focal lengths are", "",
        "Without a camera file, from all images of a sequence and from parts of them. The last column is the distance from the focal length of the file in "
        "standard deviations. What parts have in common and the file has not is the file's: see above for what the true poses say of it.", "",
        "| sequence | images | f found, px | of the file | standard deviations |", "|---|---|---|---|---|", *found_lines, ""]))
