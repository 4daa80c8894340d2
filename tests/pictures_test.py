"""The pictures of the documentation: pictures_test.py PROGRAM VIEWER [unittest arguments]. VIEWER: where the build has put playwright-core.

Those of real and rendered footage that lies ready are made anew, by scripts/pictures, and must show what those in docs/images show.
What has to be rendered for minutes before (the demo, the ring of fisheyes, the room) is made by hand.
"""
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import unittest

import program
from program import ProgramTest

VIEWER = pathlib.Path(sys.argv.pop(2)).resolve()
ROOT = pathlib.Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs/images"
SHARED = pathlib.Path(os.environ.get("RAYSFM_SHARED_DATA", ROOT.parent / "shared" / "data"))
WIDTH, HEIGHT = 60, 32  # in which pictures are compared: a map is the same, its points need not be
MADE = {"kitchen": "redkitchen-handheld", "mirror": "rendered/mirror", "zoom": "zoom-tsukuba", "drive": "kitti00-small"}


def small(path):
    """Grey levels of a picture."""
    return subprocess.run(["ffmpeg", "-loglevel", "error", "-i", path, "-vf", f"scale={WIDTH}:{HEIGHT}:flags=area,format=gray", "-f", "rawvideo", "-"],
                          capture_output=True, check=True).stdout


class Pictures(ProgramTest):
    @unittest.skipUnless(shutil.which("chromium") and shutil.which("node") and shutil.which("ffmpeg") and (VIEWER / "node_modules/playwright-core").exists(),
                         "needs chromium, node, playwright-core and ffmpeg")
    def test_they_show_what_comes_out(self):
        there = [name for name, of in MADE.items() if (SHARED / of).is_dir()]
        if not there:
            self.skipTest("no shared data")
        done = subprocess.run([ROOT / "scripts/pictures", program.PROGRAM, VIEWER, *there], capture_output=True, text=True, timeout=600,
                              env=os.environ | {"RAYSFM_PICTURES": str(self.folder), "RAYSFM_SHARED_DATA": str(SHARED)})
        self.assertEqual(done.returncode, 0, done.stderr)
        kept = {name: small(IMAGES / f"map-{name}.jpg") for name in there}
        for name in there:
            made = small(self.folder / f"map-{name}.jpg")
            self.assertEqual(len(made), WIDTH * HEIGHT)
            alike = {other: statistics.correlation(made, picture) for other, picture in kept.items()}
            self.assertGreater(alike[name], 0.8, name)
            for other in there:
                self.assertTrue(other == name or alike[other] < 0.6, f"{name} is like {other}: {alike}")

    def test_every_picture_of_a_result_is_made_by_the_script(self):
        script = (ROOT / "scripts/pictures").read_text()
        names = set(re.search(r"names=\((\w.*)\)", script).group(1).split())
        pictures = {path.stem for path in IMAGES.glob("*.jpg")}
        self.assertEqual(pictures, {f"mesh-{name.removesuffix('-mesh')}" if name.endswith("-mesh") else f"map-{name}" for name in names})
        pages = "".join(path.read_text() for path in [ROOT / "README.md", *ROOT.glob("docs/*.md")])
        for picture in sorted(pictures):
            self.assertIn(f"images/{picture}.jpg", pages)


if __name__ == "__main__":
    program.main()
