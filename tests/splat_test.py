"""What splatting tools read, of a real kitchen and of a rendered panorama: splat_test.py PROGRAM [unittest arguments].

`export --format nerfstudio --undistort --images` is read by the definition of transforms.json, and a hundred points of the map that
goes with it are looked up through the written lens: where the map's own camera has them, and in pictures that show there what the
frame shows.
"""
import json
import math
import os
import pathlib
import re
import shutil
import struct
import subprocess
import unittest

import program
from program import ProgramTest, run

SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", pathlib.Path(__file__).resolve().parents[2] / "shared" / "data"))
KITCHEN = SHARED / "redkitchen-handheld"
POINTS = 100
PANORAMA = """raysfm_camera: 1
cameras:
  - {name: ring, model: equirectangular, resolution: [1024, 512]}
"""


class Picture:
    """Grey levels of a file, by ffmpeg."""

    def __init__(self, path):
        gray = "scale=in_range=full:out_range=full,format=gray"
        content = subprocess.run(["ffmpeg", "-loglevel", "error", "-i", path, "-vf", gray, "-f", "image2pipe", "-c:v", "pgm", "-"],
                                 capture_output=True, check=True).stdout
        size, self.grey = re.fullmatch(rb"P5\s(\d+\s\d+)\s255\s(.*)", content, re.DOTALL).groups()
        self.width, self.height = map(int, size.split())

    def at(self, u, v):
        """Between four pixels, whose centres are whole numbers; None beyond them."""
        x, y = math.floor(u), math.floor(v)
        if not (0 <= x < self.width - 1 and 0 <= y < self.height - 1):
            return None
        across, down, first = u - x, v - y, y * self.width + x
        above, below = ((1 - across) * self.grey[k] + across * self.grey[k + 1] for k in (first, first + self.width))
        return (1 - down) * above + down * below


def points_of(path):
    """Positions in a PLY file of 15 bytes a point."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    count = int(re.search(rb"element vertex (\d+)", header).group(1))
    assert len(body) == 15 * count, header
    return [struct.unpack_from("<3f", body, 15 * k) for k in range(count)]


def poses_of(path):
    """[(position, rotation by rows)], world from camera, of a TUM file."""
    poses = []
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        _, *t, x, y, z, w = map(float, line.split())
        poses.append((t, [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                          [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                          [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]))
    return poses


def seen_from(pose, point):
    """In the axes of the camera: those of the rotation's columns."""
    t, rotation = pose
    return [sum(rotation[r][c] * (point[r] - t[r]) for r in range(3)) for c in range(3)]


def intrinsics(path):
    text = path.read_text()
    return {name: float(value) for name, value in re.findall(r"\b(fx|fy|cx|cy|k1|k2|p1|p2): *([-+.\deE]+)", text)}


def radtan(k, direction):
    """Pixel of a direction; the centre of the first is (0, 0)."""
    x, y = direction[0] / direction[2], direction[1] / direction[2]
    r2 = x * x + y * y
    radial = 1 + k["k1"] * r2 + k["k2"] * r2 * r2
    return (k["fx"] * (x * radial + 2 * k["p1"] * x * y + k["p2"] * (r2 + 2 * x * x)) + k["cx"],
            k["fy"] * (y * radial + k["p1"] * (r2 + 2 * y * y) + 2 * k["p2"] * x * y) + k["cy"])


def equirectangular(width, height):
    """Columns are longitudes, rows are latitudes, over the whole sphere."""
    def pixel(direction):
        x, y, z = direction
        return ((width - 1) / 2 + width / (2 * math.pi) * math.atan2(x, z), (height - 1) / 2 + height / math.pi * math.asin(y / math.hypot(x, y, z)))
    return pixel


class Written:
    """A frame of transforms.json."""

    def __init__(self, scene, frame):
        self.path = frame["file_path"]
        self.rows = frame["transform_matrix"]
        number = {**scene, **frame}
        self.focal, self.middle = (number["fl_x"], number["fl_y"]), (number["cx"], number["cy"])
        self.size = (number["w"], number["h"])

    def pixel(self, point):
        """From the corner of the first pixel, through a lens without distortion that looks along -z with y up; None where it sees nothing."""
        x, y, z = (sum(self.rows[r][c] * (point[r] - self.rows[r][3]) for r in range(3)) for c in range(3))
        if z > -1e-9:
            return None
        u, v = self.middle[0] + self.focal[0] * x / -z, self.middle[1] - self.focal[1] * y / -z
        return (u, v) if 0 <= u < self.size[0] and 0 <= v < self.size[1] else None

    def back(self, u, v):
        """The direction that is seen at a pixel, in the axes of the rest of the project: y down, z forward."""
        return ((u - self.middle[0]) / self.focal[0], (v - self.middle[1]) / self.focal[1], 1)


@unittest.skipUnless(shutil.which("ffmpeg"), "needs ffmpeg")
class SplatReady(ProgramTest):
    def exported(self, source, *camera):
        """The result of a sequence, and what is exported of it."""
        out, splat = self.folder / "out", self.folder / "splat"
        for command in (("track", source, "--out", out, "--quiet", *camera),
                        ("export", out, "--format", "nerfstudio", "--undistort", "--images", source, "--out", splat, "--quiet")):
            done = run(*command)
            self.assertEqual(done.returncode, 0, done.stderr)
        return out, splat

    def check(self, out, splat, pixel_of, images):
        """A hundred points, each in the key frame that comes next. `images`: those of the input, in order."""
        scene = json.loads((splat / "transforms.json").read_text())
        points, poses = points_of(splat / scene["ply_file_path"]), poses_of(out / "keyframes.txt")
        applied = scene["applied_transform"]
        self.assertEqual([row[3] for row in applied], [0, 0, 0])
        faces = len(scene["frames"]) // len(poses)
        written = [Written(scene, frame) for frame in scene["frames"]]
        by_frame = {}
        for frame in written:
            by_frame.setdefault(pathlib.PurePath(frame.path).name, []).append(frame)
        self.assertEqual(len(by_frame), len(poses))
        self.assertEqual({len(of_one) for of_one in by_frame.values()}, {faces})
        looked, used, differences = 0, set(), {(0, 0): [], (0.5, 0): [], (-0.5, 0): [], (0, 0.5): [], (0, -0.5): []}
        kept = sorted(by_frame)[:: max(1, len(poses) // 5)]
        pictures = {}
        for k, point in enumerate(points[:: max(1, len(points) // (12 * POINTS))] * 3):
            name = kept[k % len(kept)]
            number = sorted(by_frame).index(name)
            # Of the project's own axes again.
            own = [sum(applied[r][c] * point[r] for r in range(3)) for c in range(3)]
            direction = seen_from(poses[number], own)
            places = [(frame, at) for frame in by_frame[name] if (at := frame.pixel(point))]
            if not places or (faces == 1 and direction[2] <= 0):
                continue
            frame, (u, v) = places[0]
            u_own, v_own = pixel_of(direction)
            if name not in pictures:
                pictures[name] = Picture(images[int(re.search(r"(\d+)\.png$", name).group(1))])
            # The direction of the written pixel is that of the point: by the map's own camera it is at the same pixel.
            turned = frame.back(u, v)
            in_world = [sum(frame.rows[r][c] * s * turned[c] for c, s in enumerate((1, -1, -1))) for r in range(3)]
            back = [sum(applied[r][c] * in_world[r] for r in range(3)) for c in range(3)]
            again = pixel_of(seen_from(([0, 0, 0], poses[number][1]), back))
            self.assertLess(math.dist(again, (u_own, v_own)), 0.01, f"{frame.path}: {point}")
            path = splat / frame.path
            if path not in pictures:
                pictures[path] = Picture(path)
                self.assertEqual((pictures[path].width, pictures[path].height), frame.size)
            shown = [(pictures[path].at(u - 0.5 + du, v - 0.5 + dv), d) for (du, dv), d in differences.items()]
            expected = pictures[name].at(u_own, v_own)
            if expected is None or any(grey is None for grey, _ in shown):
                continue
            for grey, of_shift in shown:
                of_shift.append(abs(grey - expected))
            used.add(pathlib.PurePath(frame.path).parent.name)
            looked += 1
            if looked == POINTS:
                break
        self.assertEqual(looked, POINTS)
        # What is shown there is what the frame shows, and less so half a pixel beside it.
        mean = {shift: sum(of) / len(of) for shift, of in differences.items()}
        for shift, value in mean.items():
            if shift != (0, 0):
                self.assertGreater(value, 1.3 * mean[0, 0], mean)
        return used

    @unittest.skipUnless(KITCHEN.is_dir(), "no shared data")
    def test_a_kitchen(self):
        images = sorted((KITCHEN / "images").iterdir())
        out, splat = self.exported(KITCHEN)
        lens = intrinsics(out / "camera.yaml" if (out / "camera.yaml").exists() else KITCHEN / "camera.yaml")
        self.check(out, splat, lambda d: radtan(lens, d), images)

    def test_a_panorama(self):
        source = self.folder / "panorama"
        done = run("synth", "street", "--camera", self.file("camera.yaml", PANORAMA), "--frames", 20, "--fps", 7.5, "--length", 3,
                   "--samples", 1, "--out", source, "--quiet")
        self.assertEqual(done.returncode, 0, done.stderr)
        images = sorted((source / "images").iterdir())
        out, splat = self.exported(source)
        used = self.check(out, splat, equirectangular(1024, 512), images)
        self.assertGreaterEqual(len(used), 4, used)


if __name__ == "__main__":
    program.main()
