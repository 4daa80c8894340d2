"""The subcommand `map`: map_test.py PROGRAM [unittest arguments].

The maps are written here by docs/saved_map.md alone.
"""
import sqlite3
import struct
import subprocess
import zlib

import program
from program import ProgramTest, run

CAMERAS = """raysfm_camera: 1
cameras:
  - name: front
    model: pinhole
    resolution: [640, 480]
    intrinsics: {fx: 500, fy: 500, cx: 319.5, cy: 239.5}
"""
TABLES = [
    "CREATE TABLE keyframe(world INTEGER NOT NULL, keyframe INTEGER NOT NULL, frame INTEGER NOT NULL, "
    "timestamp REAL NOT NULL, image TEXT NOT NULL, rig_from_world BLOB NOT NULL, features INTEGER NOT NULL, "
    "cameras BLOB NOT NULL, pixels BLOB NOT NULL, octaves BLOB NOT NULL, tracks BLOB NOT NULL, "
    "inliers BLOB NOT NULL, rays BLOB NOT NULL, described BLOB NOT NULL, descriptors BLOB NOT NULL, "
    "check_sum INTEGER NOT NULL, PRIMARY KEY(world, keyframe)) STRICT, WITHOUT ROWID",
    "CREATE TABLE map(id INTEGER PRIMARY KEY, cameras TEXT NOT NULL, rig_from_cam BLOB NOT NULL, "
    "worlds INTEGER NOT NULL, check_sum INTEGER NOT NULL) STRICT",
    "CREATE TABLE track_block(world INTEGER NOT NULL, block INTEGER NOT NULL, positions BLOB NOT NULL, "
    "flags BLOB NOT NULL, colors BLOB NOT NULL, lengths BLOB NOT NULL, observations BLOB NOT NULL, "
    "check_sum INTEGER NOT NULL, PRIMARY KEY(world, block)) STRICT, WITHOUT ROWID",
    "CREATE TABLE world(world INTEGER PRIMARY KEY, keyframes INTEGER NOT NULL, tracks INTEGER NOT NULL, "
    "scale_sigma REAL NOT NULL, guessed_keyframe INTEGER NOT NULL, guessed_distance REAL NOT NULL, "
    "rescaled REAL NOT NULL, free_tracks BLOB NOT NULL, check_sum INTEGER NOT NULL) STRICT",
]
UNIT_POSE = struct.pack("<7d", 0, 0, 0, 1, 0, 0, 0)


def check_sum(values):
    total = 0
    for value in values:
        if isinstance(value, int):
            value = struct.pack("<q", value)
        elif isinstance(value, float):
            value = struct.pack("<d", value)
        elif isinstance(value, str):
            value = value.encode()
        total = zlib.crc32(value, total)
    return total


def keyframe(number, **changes):
    """Two features, of track 0 and of none; the first has a descriptor."""
    row = {"world": 0, "keyframe": number, "frame": 10 * number, "timestamp": 1.5 + number, "image": f"{number}.png",
           "rig_from_world": UNIT_POSE, "features": 2, "cameras": bytes(2), "pixels": struct.pack("<4f", 10, 20, 30, 40),
           "octaves": bytes([0, 1]), "tracks": struct.pack("<2i", 0, -1), "inliers": bytes([1, 1]), "rays": b"",
           "described": struct.pack("<i", 0), "descriptors": bytes(range(32))}
    return row | changes


def tracks(**changes):
    """Track 0 is seen by both key frames, track 1 is free."""
    row = {"world": 0, "block": 0, "positions": struct.pack("<6d", 1, 2, 3, 0, 0, 0), "flags": bytes([1, 0]),
           "colors": bytes(6), "lengths": struct.pack("<2i", 2, 0), "observations": struct.pack("<4i", 0, 0, 1, 0)}
    return row | changes


class Map(ProgramTest):
    def write(self, first=None, block=None, world=None, cameras=CAMERAS, name="map.raysfm"):
        path = self.folder / name
        path.unlink(missing_ok=True)
        database = sqlite3.connect(path)
        for sql in ["PRAGMA synchronous = OFF"] + TABLES + ["PRAGMA application_id = 1382119757", "PRAGMA user_version = 1"]:
            database.execute(sql)
        header = {"id": 0, "cameras": cameras, "rig_from_cam": UNIT_POSE, "worlds": 1}
        of_world = {"world": 0, "keyframes": 2, "tracks": 2, "scale_sigma": 0.02, "guessed_keyframe": -1,
                    "guessed_distance": 0.0, "rescaled": 1.0, "free_tracks": struct.pack("<i", 1)}
        for table, row in (("map", header), ("world", of_world | (world or {})), ("keyframe", keyframe(0, **(first or {}))),
                           ("keyframe", keyframe(1)), ("track_block", tracks(**(block or {})))):
            values = [*row.values()]
            marks = ", ".join("?" * (len(values) + 1))
            database.execute(f"INSERT INTO {table} VALUES ({marks})", [*values, check_sum(values)])
        database.commit()
        database.close()
        return path

    def test_show(self):
        path = self.write()
        done = run("map", "show", path)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        for text in (f"{path}: saved map, version 1, {path.stat().st_size} bytes", "camera front: pinhole, 640 x 480",
                     "world 0: 2 key frames, 1 points, 2 observations, 2 descriptors, scale known within 2 %",
                     "from 1.500 s to 2.500 s"):
            self.assertIn(text, done.stdout)
        self.assertEqual(run("map", "show", path, "--quiet").stdout, "")

    def test_check(self):
        path = self.write()
        before = path.read_bytes()
        done = run("map", "check", path)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, f"{path}: ok\n", ""))
        self.assertEqual(path.read_bytes(), before)
        self.assertEqual([file.name for file in self.folder.iterdir()], ["map.raysfm"])

    def test_numbers_that_are_not_allowed(self):
        nan, huge = struct.pack("<d", float("nan")), struct.pack("<f", 1e30)
        for changes, says in (
                ({"first": {"frame": -1}}, "frame: -1"),
                ({"first": {"timestamp": float("inf")}}, "timestamp"),
                ({"first": {"rig_from_world": UNIT_POSE[:48] + nan}}, "no pose"),
                ({"first": {"rig_from_world": bytes(56)}}, "no pose"),
                ({"first": {"rig_from_world": UNIT_POSE[:48]}}, "rig_from_world: 48 bytes"),
                ({"first": {"features": 2**31}}, "features: 2147483648"),
                ({"first": {"features": 90000000}}, "cameras: 2 bytes; allowed: 90000000 of 1 bytes each"),
                ({"first": {"cameras": bytes([0, 1])}}, "feature 1: camera 1"),
                ({"first": {"pixels": huge * 4}}, "feature 0: pixel"),
                ({"first": {"octaves": bytes([0, 99])}}, "octave 99"),
                ({"first": {"tracks": struct.pack("<2i", 0, 2)}}, "track 2; allowed: -1 to 1"),
                ({"first": {"tracks": struct.pack("<2i", 0, 0)}}, "1 features name tracks that are not seen there"),
                ({"first": {"inliers": bytes([7, 0])}}, "inlier 7"),
                ({"first": {"rays": bytes(192)}}, "a ray that is none"),
                ({"first": {"rays": bytes(100)}}, "rays: 100 bytes"),
                ({"first": {"described": struct.pack("<i", 2)}}, "descriptor of feature 2"),
                ({"first": {"descriptors": bytes(31)}}, "descriptors: 31 bytes"),
                ({"first": {"image": "x" * 5000}}, "image: 5000 bytes"),
                ({"block": {"positions": nan * 6}}, "track 0: no position"),
                ({"block": {"lengths": struct.pack("<2i", 1, 0)}}, "lengths: 1 elements"),
                ({"block": {"lengths": struct.pack("<2i", 3, -1)}}, "lengths"),
                ({"block": {"observations": struct.pack("<4i", 0, 0, 2, 0)}}, "seen in key frame 2; allowed: 0 to 1"),
                ({"block": {"observations": struct.pack("<4i", 1, 0, 1, 0)}}, "names the track, once"),
                ({"block": {"observations": struct.pack("<4i", 0, 0, 1, 1)}}, "feature 1 of key frame 1"),
                ({"block": {"block": 1}}, "block: 1"),
                ({"world": {"tracks": 3}}, "positions: 48 bytes"),
                ({"world": {"tracks": 10**9}}, "positions: 48 bytes"),
                ({"world": {"keyframes": 3}}, "key frame 2: missing"),
                ({"world": {"keyframes": 1}}, "more rows follow"),
                ({"world": {"scale_sigma": -1.0}}, "scale_sigma -1"),
                ({"world": {"rescaled": 0.0}}, "rescaled 0"),
                ({"world": {"guessed_keyframe": 2}}, "guessed_keyframe 2"),
                ({"world": {"free_tracks": struct.pack("<i", 0)}}, "free track 0"),
                ({"world": {"free_tracks": bytes(5)}}, "free_tracks: 5 bytes"),
                ({"cameras": "1 PINHOLE 640 480 500 500 319.5 239.5\n"}, "cameras"),
                ({"cameras": CAMERAS.replace("500", "-1")}, "cameras[0].intrinsics"),
                ({"cameras": CAMERAS + CAMERAS.split("\n", 2)[2].replace("front", "back")}, "rig_from_cam: 7 numbers"),
        ):
            with self.subTest(says):
                self.refused("map", "check", self.write(**changes), says=["map.raysfm: ", says])

    def test_other_files(self):
        self.refused("map", "check", self.folder / "none", says=["none: no such file"])
        self.refused("map", "show", self.folder, says=["not a file"])
        self.refused("map", "show", self.file("text", "hello"), says=["not a saved map"])
        path = self.write()
        self.refused("map", "check", self.file("cut", path.read_bytes()[:-1]), says=["bytes, of"])
        database = sqlite3.connect(path)
        database.execute("PRAGMA user_version = 2")
        database.close()
        self.refused("map", "check", path, says=["version 2; allowed: version 1"])
        self.refused("map", "check", path, "--config", path, says=["--config"])

    def test_a_reader_waits_for_nobody(self):
        """A pipe of the name is no file; a journal of a stranger's beside it is not looked at."""
        subprocess.run(["mkfifo", self.folder / "pipe"], check=True)
        self.refused("map", "check", self.folder / "pipe", says=["not a file"])
        path = self.write()
        self.file("map.raysfm-journal", b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7" + bytes(5000))
        self.file("map.raysfm-wal", b"\x37\x7f\x06\x82" + bytes(5000))
        self.assertEqual(run("map", "check", path).returncode, 0)


if __name__ == "__main__":
    program.main()
