"""Tests of `raysfm synth` with rigs, masks and the recipes, from outside."""
import pathlib
import struct

import program
from program import ProgramTest, run

RECIPES = pathlib.Path(__file__).resolve().parent.parent / "scripts" / "recipes"

COMPOSITE = """raysfm_camera: 1
cameras:
  - {{name: a, model: pinhole, resolution: [64, 48], intrinsics: {{fx: 60, fy: 60, cx: 31.5, cy: 23.5}}, roi: [0, 0, 64, 48]}}
  - {{name: b, model: pinhole, resolution: [64, 48], intrinsics: {{fx: 60, fy: 60, cx: 31.5, cy: 23.5}}{roi}}}
"""


def png_size(path):
    return struct.unpack(">II", path.read_bytes()[16:24])


def rows(path):
    return [line.split(",") for line in path.read_text().splitlines()[1:]]


class Recipes(ProgramTest):
    def render(self, name, frames=1, *options):
        out = self.folder / name
        done = run("synth", "--config", RECIPES / f"{name}.yaml", "--frames", frames, "--samples", 1, "--quiet", "--out", out,
                   *options)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""), name)
        return out

    def test_every_recipe_is_rendered(self):
        streams = {"dual-fisheye": 2, "fisheye-ring": 4, "tri-rig-look": 3, "tri-rig-straight": 3, "rig-scale-dual": 2,
                   "rig-scale-ring": 4, "rig-scale-stereo": 2, "rig-scale-tri": 3, "town-stereo": 2, "town-tri": 3}
        masks = {"dual-fisheye": 2, "fisheye-ring": 4, "lba09-2-mirror": 1, "rig-scale-dual": 2, "town-fisheye": 1, "town-mirror": 1}
        sizes = {"lba09-1-pinhole": (512, 384), "lba09-2-mirror": (464, 464), "lba09-3-stereo": (1280, 480)}
        recipes = sorted(path.stem for path in RECIPES.glob("*.yaml"))
        self.assertGreaterEqual(len(recipes), 10)
        for name in recipes:
            out = self.render(name)
            folders = [out / f"cam{i}" for i in range(streams[name])] if name in streams else [out / "images"]
            for folder in folders:
                self.assertEqual([p.name for p in folder.iterdir()], ["000000.png"], name)
            self.assertFalse((out / f"cam{len(folders)}").exists(), name)
            if name in sizes:
                self.assertEqual(png_size(folders[0] / "000000.png"), sizes[name])
            found = sorted(path.name for path in out.glob("mask*.png"))
            if masks.get(name, 0) == 1:
                self.assertEqual(found, ["mask.png"])
            else:
                self.assertEqual(found, [f"mask{i}.png" for i in range(masks.get(name, 0))], name)
            if found:
                text = (out / "camera.yaml").read_text()
                self.assertTrue(all(mask in text for mask in found), name)

    def test_the_zoom_goes_from_750_to_2000(self):
        out = self.render("board-zoom", 3)
        focal = [float(row[1]) for row in rows(out / "lens.csv")]
        self.assertEqual(len(focal), 3)
        self.assertAlmostEqual(focal[0], 750)
        self.assertAlmostEqual(focal[2], 2000, places=3)
        self.assertFalse((out / "camera.yaml").exists(), "it would be wrong for all frames but one")
        corners = [[float(x) for x in row] for row in rows(out / "landmarks.csv")]
        self.assertEqual([int(row[0]) for row in corners], list(range(96)))
        for first in range(0, 96, 8):  # rows of 8 inner corners, 0.1 m apart
            for a, b in zip(corners[first:first + 7], corners[first + 1:first + 8]):
                self.assertAlmostEqual(sum((p - q) ** 2 for p, q in zip(a[1:], b[1:])) ** 0.5, 0.1, places=6)

    def test_flags_win_and_the_effective_configuration_renders_the_same(self):
        first = self.render("lba09-3-stereo", 2, "--noise", 3, "--readout", 20)
        config = (first / "synth.yaml").read_text()
        self.assertIn("frames: 2", config)
        self.assertIn("noise: 3", config)
        self.assertIn("length: 20", config)
        again = self.folder / "again"
        done = run("synth", "--config", first / "synth.yaml", "--out", again, "--quiet")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        image = "images/000001.png"
        self.assertEqual((first / image).read_bytes(), (again / image).read_bytes())


class Rigs(ProgramTest):
    def test_a_composite_image_needs_every_roi(self):
        good = self.file("good.yaml", COMPOSITE.format(roi=", roi: [64, 10, 64, 48]"))
        bad = self.file("bad.yaml", COMPOSITE.format(roi=""))
        options = ["room", "--frames", 1, "--samples", 1, "--quiet", "--camera"]
        done = run("synth", *options, good, "--out", self.folder / "good")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertEqual(png_size(self.folder / "good" / "images" / "000000.png"), (128, 58))
        self.refused("synth", *options, bad, "--out", self.folder / "bad", says=["camera b", "roi"])

    def test_bad_numbers(self):
        for option, value in [("--readout", -1), ("--frames", -2), ("--fps", -1), ("--samples", 3), ("--zoom", 100), ("--rounds", 0)]:
            self.refused("synth", "room", option, value, "--out", self.folder / "out", says=[option.strip("-"), value])
        self.refused("synth", "room", "--motion", "straight", "--length", 9, "--out", self.folder / "out", says=["length", "3.2"])


if __name__ == "__main__":
    program.main()
