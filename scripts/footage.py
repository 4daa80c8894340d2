"""Footage as people have it, for scripts/results: enlarged and blurred videos, a phone, photos, long and still videos,
large panoramas. What is made is kept in demo/footage; a folder without the file `done` is made again.
"""
import pathlib
import shutil
import subprocess
import sys

KITCHEN = "redkitchen-handheld"
WIDTHS, BLURS = (640, 1280, 1920, 3840), (0, 1, 2, 3)
STILL_FRAMES, PART = 10000, 500

# name, how it is made or where it is found; "truth" below the shared data.
FOOTAGE = [dict(name=f"kitchen-{w}-blur{b}", kind="kitchen", width=w, blur=b, truth=KITCHEN)
           for w in WIDTHS for b in BLURS] + [
    dict(name="phone-batmobile", kind="phone"),
    dict(name="bonsai-photos", kind="found"),
    dict(name="kitti00-small", kind="found", truth="kitti00-small"),
    dict(name="kitti00-small forth and back, ten times", kind="repeated", base="kitti00-small"),
    dict(name="kitchen-1920, still for 10,000 frames", kind="still", base="kitchen-1920-blur0"),
    dict(name="panorama-7680", kind="panorama"),
]
for _entry in FOOTAGE:
    _entry["statistic"] = "rmse"


def command(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"scripts/results: {arguments[0]} failed: {done.stderr.strip()}")


def ffmpeg(*arguments):
    command("ffmpeg", "-v", "error", "-y", "-threads", "2", *arguments)


def encode(source, filters, out, *more):
    ffmpeg(*more, "-i", source, "-vf", filters, "-c:v", "libx264", "-preset", "ultrafast", "-crf", "12", "-pix_fmt",
           "yuv420p", "-g", "30", "-an", out)


def concatenate(parts, out):
    listing = out.parent / "parts.txt"
    listing.write_text("".join(f"file '{part.resolve()}'\n" for part in parts))
    ffmpeg("-f", "concat", "-safe", "0", "-i", listing, "-c", "copy", out)


def write_camera(path, model, width, height, intrinsics):
    values = ", ".join(f"{name}: {value}" for name, value in intrinsics.items())
    path.write_text(f"raysfm_camera: 1\ncameras:\n  - name: camera\n    model: {model}\n"
                    f"    resolution: [{width}, {height}]\n    intrinsics: {{{values}}}\n")


def make_kitchen(folder, data, width, blur):
    scale = width / 640
    center = lambda c: (c + 0.5) * scale - 0.5
    filters = f"scale={width}:-2:flags=bicubic" + (f",gblur=sigma={blur}" if blur else "")
    encode(data / KITCHEN / "first200.mp4", filters, folder / "video.mp4")
    write_camera(folder / "camera.yaml", "radtan", width, width * 3 // 4,
                 dict(fx=526.238 * scale, fy=526.238 * scale, cx=center(319.5), cy=center(239.5), k1=-0.0274262, k2=0,
                      p1=0, p2=0))


def make_repeated(folder, source):
    """Forth and back, so that the view never jumps."""
    encode(source / "video.mp4", "null", folder / "forth.mp4")
    encode(source / "video.mp4", "reverse", folder / "back.mp4")
    concatenate([folder / "forth.mp4", folder / "back.mp4"] * 5, folder / "video.mp4")
    shutil.copy(source / "camera.yaml", folder)


def make_still(folder, moving):
    """The first frame of a video with noise, for long, and then the video."""
    filters = f"trim=end_frame=1,loop={PART - 1}:1:0,setpts=N/30/TB,noise=alls=6:allf=t"
    encode(moving / "video.mp4", filters, folder / "still.mp4")
    concatenate([folder / "still.mp4"] * (STILL_FRAMES // PART) + [moving / "video.mp4"], folder / "video.mp4")
    shutil.copy(moving / "camera.yaml", folder)


def make_panorama(folder, program):
    write_camera(folder / "large.yaml", "equirectangular", 7680, 3840, {})
    command(program, "synth", "street", "--camera", folder / "large.yaml", "--motion", "walk", "--frames", 40, "--fps",
            15, "--length", 2.7, "--samples", 1, "--out", folder / "frames", "--quiet")


def folder_of(name, root):
    return root / "demo" / "footage" / name.split(",")[0].replace(" ", "-")


def make(entry, root, data, program):
    folder = folder_of(entry["name"], root) if entry["kind"] != "still" else folder_of("still", root)
    if (folder / "done").exists():
        return folder
    print(f"making {entry['name']}", file=sys.stderr)
    folder.mkdir(parents=True, exist_ok=True)
    if entry["kind"] == "kitchen":
        make_kitchen(folder, data, entry["width"], entry["blur"])
    elif entry["kind"] == "phone":
        write_camera(folder / "camera.yaml", "pinhole", 720, 1280, dict(fx=1300, fy=1300, cx=359.5, cy=639.5))
    elif entry["kind"] == "repeated":
        make_repeated(folder, data / entry["base"])
    elif entry["kind"] == "still":
        make_still(folder, make(next(f for f in FOOTAGE if f["name"] == entry["base"]), root, data, program))
    elif entry["kind"] == "panorama":
        make_panorama(folder, program)
    (folder / "done").touch()
    return folder


def places(entry, root, data, program):
    """Input, folder of the truth (or None) and camera flags; None where the data is missing."""
    needed = {"phone": "phone-batmobile", "panorama": "", "kitchen": f"{KITCHEN}/first200.mp4",
              "still": f"{KITCHEN}/first200.mp4"}.get(entry["kind"], entry.get("base", entry["name"]))
    if not (data / needed).exists():
        return None
    truth = data / entry["truth"] if "truth" in entry else None
    if entry["kind"] == "found":
        found = data / entry["name"]
        if (found / "video.mp4").exists():
            return found / "video.mp4", truth, ["--camera", found / "camera.yaml"]
        return found, truth, []
    folder = make(entry, root, data, program)
    if entry["kind"] == "panorama":
        return folder / "frames", folder / "frames", []
    video = data / "phone-batmobile" / "video.mp4" if entry["kind"] == "phone" else folder / "video.mp4"
    return video, truth, ["--camera", folder / "camera.yaml"]


def longest_stretch(without_pose):
    longest = length = 0
    last = None
    for index in (frame["index"] for frame in without_pose):
        length = length + 1 if last is not None and index == last + 1 else 1
        longest, last = max(longest, length), index
    return longest


def make_rows():
    """A function from an entry and its results to its row; it remembers the rows that others are compared with."""
    seen = {}

    def row(entry, results):
        result = results[0]
        if "report" not in result:
            return f"| {entry['name']} | {result['message'] or 'no result'} |" + " |" * 10
        report = result["report"]
        seen[entry["name"]] = result
        frames, timing = report["frames"], report["timing"]
        ate = f"{result['eval']['ate']['rmse']:.4f}" if result.get("eval") else "-"
        ratio, growth = "-", "-"
        small = seen.get(f"kitchen-640-blur{entry['blur']}") if "blur" in entry else None
        if small:
            ratio = f"{timing['frame']['mean_ms'] / small['report']['timing']['frame']['mean_ms']:.2f}"
        base = seen.get(entry.get("base"))
        if base:
            more = (frames["total"] - base["report"]["frames"]["total"]) / 1000
            growth = f"{(result['peak_mib'] - base['peak_mib']) / more:.1f}"
        cells = [entry["name"], str(frames["total"]), str(frames["posed"]), str(len(report["segments"])),
                 str(longest_stretch(frames["without_pose"])), ate, f"{report['rms_reprojection_px']:.3f}",
                 f"{timing['frame']['median_ms']:.2f}", f"{timing['frame']['mean_ms']:.2f}", ratio,
                 f"{result['peak_mib']:.0f}", growth]
        return "| " + " | ".join(cells) + " |"

    return row


def write_table(path, made_by, rows):
    text = [
        "# Footage", "",
        f"Made by `scripts/results footage`: {made_by}.",
        "Videos as people have them. `kitchen-W-blurB` is the first 200 frames of `redkitchen-handheld` enlarged to a "
        "width of W pixels, then blurred by a Gaussian of B pixels: the same pictures in more pixels, so accuracy "
        "and time should not change. The longest stretch is of frames without a pose. ATE is the rmse after alignment "
        "by a similarity, in metres. `to 640` is the mean time of a frame over that of the same blur at 640. The "
        "peak of memory is that of the whole run with its writing, and the last column what each 1000 frames add to that "
        "of the same video being shorter: less than 10 MiB. The phone's focal length is a "
        "guess; so it is not judged by accuracy.", "",
        "| footage | frames | posed | segments | longest stretch | ATE m | rms px | median ms | mean ms | to 640 | "
        "peak MiB | MiB per 1000 |", "|---|" + "---|" * 11, *rows, "",
    ]
    pathlib.Path(path).write_text("\n".join(text))
