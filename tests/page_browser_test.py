"""How the page of a result opens, moves and can be used: page_browser_test.py PROGRAM VIEWER [unittest arguments]. VIEWER: where the
build has put playwright-core."""
import array
import base64
import json
import math
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import program
from program import ProgramTest, run

VIEWER = pathlib.Path(sys.argv.pop(2)).resolve()
CHROMIUM = shutil.which("chromium")
POINTS, POSES, FEW = 300000, 5000, 40
FEW_POINTS = 100  # of the world of FEW frames
FIRST = 30000  # points that come with the page, of both worlds together
BLACK = 12  # a frame that shows nothing
DATA, REST = (re.compile(rf'(<script type="application/json" id="{name}">)(.*?)(</script>)', re.DOTALL) for name in ("data", "rest"))
OUT = None


def setUpModule():
    global OUT
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    street, OUT = pathlib.Path(folder.name) / "street", pathlib.Path(folder.name) / "out"
    done = run("synth", "street", "--frames", 20, "--fps", 7.5, "--length", 3, "--samples", 1, "--out", street, "--quiet")
    assert done.returncode == 0, done.stderr
    (street / f"images/{BLACK:06}.png").write_bytes(b"P5 512 384 255\n" + bytes(512 * 384))
    done = run("track", street, "--out", OUT, "--quiet")
    assert done.returncode == 0, done.stderr


def packed(kind, numbers):
    return base64.b64encode(array.array(kind, numbers).tobytes()).decode()


def world_of(first, turns, points):
    """A world of frames from `first` on, one for each of `turns` about a block, and points beside its way."""
    pose = [x for a in turns for x in (200 * math.sin(a), 0, 120 * math.cos(a), 0, math.sin(a / 2 + math.pi / 4), 0, math.cos(a / 2 + math.pi / 4))]
    xyz = []
    for _ in range(points):
        a, far = random.choice(turns), random.choice((0.92, 1.08)) + random.gauss(0, 0.01)
        xyz += [int(32767 + 15000 * far * math.sin(a)), random.randrange(20000, 35000), int(32767 + 15000 * far * math.cos(a))]
    count, key = len(turns), range(0, len(turns), 2)
    index = range(first, first + count)
    return {
        "metric": True, "scale_sigma": 0.01,
        "frames": {"count": count, "index": packed("I", index), "time": packed("d", [i / 10 for i in index]), "pose": packed("f", pose),
                   "covariance": packed("f", [1e-4, 0, 0, 1e-4, 0, 1e-4] * count), "turn": packed("f", [0.01] * count), "lens": packed("i", [-1] * count)},
        "keyframes": {"count": len(key), "frame": packed("I", key), "seen": packed("I", [300] * len(key)), "error": packed("f", [0.4] * len(key))},
        "points": {"count": points, "all": points, "far": 0, "low": [-440, -20, -264], "high": [440, 20, 264], "xyz": xyz,
                   "rgb": [random.randrange(60, 220) for _ in range(3 * points)]},
    }


def take_rest(worlds):
    """Takes out of the worlds' points, which are in no order, what comes after the page."""
    part, rest = FIRST / sum(world["points"]["count"] for world in worlds), []
    for points in (world["points"] for world in worlds):
        first, kinds = 3 * int(part * points["count"]), {"xyz": "H", "rgb": "B"}
        rest.append({name: packed(kind, points[name][first:]) for name, kind in kinds.items()})
        points.update({name: packed(kind, points[name][:first]) for name, kind in kinds.items()})
    return rest


def replaced(pattern, data, html):
    return pattern.sub(lambda found: found.group(1) + json.dumps(data).replace("<", "\\u003c") + found.group(3), html)


def large_page(html):
    """The page of `html` with a made-up drive of POSES poses around a block, POINTS points beside it, and a second world of FEW frames."""
    random.seed(1)
    turns = [2 * math.pi * i / POSES for i in range(POSES)]
    data = json.loads(DATA.search(html).group(2))
    data |= {"title": "drive", "total": POSES + FEW, "posed": POSES + FEW, "missing": [],
             "worlds": [world_of(0, turns, POINTS), world_of(POSES, turns[:FEW], FEW_POINTS)]}
    rest = take_rest(data["worlds"])
    return replaced(REST, rest, replaced(DATA, data, html))


@unittest.skipUnless(CHROMIUM and shutil.which("node") and (VIEWER / "node_modules/playwright-core").exists(),
                     "needs chromium, node and playwright-core")
class InABrowser(ProgramTest):
    def setUp(self):
        super().setUp()
        if not (OUT / "report.html").exists():
            self.skipTest("this build has no page: npm was not there when it was made")

    def look(self, what, page):
        script = pathlib.Path(__file__).parent / "page_browser_check.mjs"
        done = subprocess.run([str(a) for a in ["node", script, VIEWER, CHROMIUM, what, page]], capture_output=True, text=True, timeout=240, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        seen = json.loads(done.stdout)
        self.assertEqual(seen["errors"], [])
        return seen

    def test_a_large_map(self):
        page = self.file("large.html", large_page((OUT / "report.html").read_text()))
        seen = self.look("large", page)
        # The map comes first, a part of it and then all; then charts, which leave the graphics card alone.
        first, later = seen["draws"][0], seen["draws"][1:]
        self.assertEqual(first["charts"], 0)
        self.assertLessEqual(first["points"], FIRST)
        self.assertGreater(first["points"], 0.9 * FIRST)
        self.assertEqual(later[-1]["points"], POINTS)
        self.assertEqual(seen["said"], f"{POINTS:,}")
        self.assertGreater(seen["partOfAll"], 0.05)
        self.assertEqual(seen["plain"], [True] * 4)
        self.assertEqual(seen["plotPixels"], [True] * 4)
        # Processor time of the page's own thread.
        self.assertLess(seen["seconds"], 2.5)

        # The slower the machine, the less is drawn while the view moves, in steps that nobody sees.
        self.assertAlmostEqual(seen["slow"][-1], 8000, delta=1)
        self.assertEqual(seen["fast"][-1], POINTS)
        self.assertLess(seen["resting"][0], POINTS / 4)
        self.assertEqual(seen["resting"][1], POINTS)
        for before, after in zip(seen["slow"] + seen["fast"], (seen["slow"] + seen["fast"])[1:]):
            self.assertLess(abs(after - before), 0.08 * max(before, after), (before, after))
        # Between 32 and 40 pictures a second nothing changes.
        self.assertEqual(len(set(seen["steady"])), 1)
        # A screen that shows no more than 30 is no slow machine.
        self.assertEqual(seen["screen"], POINTS)
        # All of it when it stands still: the same picture as before anybody moved it.
        self.assertEqual(seen["still"], POINTS)
        self.assertNotEqual(seen["movingSum"], seen["stillSum"])
        self.assertEqual(seen["againSum"], seen["stillSum"])
        # Another world: its own frames in the charts, and what was on or had the focus still is and has it.
        self.assertEqual(seen["ranges"], [[0, POSES - 1], [POSES, POSES + FEW - 1]])
        self.assertEqual((seen["followed"], seen["focused"]), (True, "world"))

    def test_what_comes_first_can_be_used(self):
        seen = self.look("late", self.file("large.html", large_page((OUT / "report.html").read_text())))
        first, few = (int(FIRST * of / (POINTS + FEW_POINTS)) for of in (POINTS, FEW_POINTS))
        before, other, after, other_after = seen["before"], seen["other"], seen["after"], seen["otherAfter"]
        self.assertEqual((before["points"], before["coloured"], other["points"]), (first, first, few))
        self.assertEqual((after["points"], after["coloured"], other_after["points"]), (POINTS, POINTS, FEW_POINTS))
        self.assertEqual((before["frame"], before["byHeight"]), (POSES + FEW - 1, True))
        for same in ("frame", "byHeight", "heights", "legend", "eye"):
            self.assertEqual(after[same], before[same], same)
        self.assertNotEqual(after["sum"], before["sum"])
        # The place that is picked is that of a point which has come later.
        self.assertEqual(seen["picked"], seen["last"])

    @unittest.skipUnless(os.environ.get("RAYSFM_TEST_SPEED"), "takes a machine with nothing else to do: RAYSFM_TEST_SPEED=1 asks for it")
    def test_a_large_map_is_fast(self):
        seen = self.look("speed", self.file("large.html", large_page((OUT / "report.html").read_text())))
        print(f"first picture after {seen['seconds']:.2f} s, then {seen['rate']:.1f} a second")
        self.assertLess(seen["seconds"], 2)
        self.assertGreater(seen["rate"], 15)

    def test_without_a_mouse(self):
        seen = self.look("keys", OUT / "report.html")
        for name in ("slider", "play", "canvas", "follow", "measure", "show-points", "heights"):
            self.assertIn(name, seen["tabbed"])
        self.assertTrue(all(seen["outlined"].values()), seen["outlined"])
        # Space presses the button that has the focus, and plays only elsewhere.
        self.assertTrue(seen["follow"])
        self.assertFalse(seen["played"])
        self.assertTrue(seen["playedElsewhere"])
        self.assertEqual(seen["missing"], f"frame {BLACK}")
        self.assertAlmostEqual(seen["turned"]["angle"], 0.12, places=3)
        self.assertAlmostEqual(seen["turned"]["distance"], 1, places=5)
        self.assertAlmostEqual(seen["raised"], 0.12, places=3)
        self.assertAlmostEqual(seen["nearer"], 1 / 1.15, places=5)

    def test_on_a_telephone(self):
        seen = self.look("narrow", OUT / "report.html")
        self.assertLessEqual(seen["width"], 390)
        self.assertGreater(seen["canvas"]["height"], 400)
        self.assertGreater(seen["part"], 0.02)
        self.assertEqual(seen["cut"], [])
        # Further down are the charts, each as it comes into view.
        self.assertLess(seen["chartsBefore"], seen["charts"])
        self.assertEqual(seen["plotPixels"], [True] * seen["charts"])
        self.assertTrue(seen["barInView"])

    def test_words_and_colours(self):
        warnings = ["the lens is another one than that of <b>a & b</b>", "60 % of what frames 3 to 9 show does not stand still"]
        html = (OUT / "report.html").read_text()
        html = replaced(DATA, json.loads(DATA.search(html).group(2)) | {"warnings": warnings}, html)
        seen = self.look("words", self.file("warned.html", html))
        self.assertEqual((seen["warnings"], seen["warningsAbove"]), (warnings, True))
        for theme in ("light", "dark"):
            for place, contrast in seen[theme].items():
                self.assertGreaterEqual(contrast, 4.5, (theme, place))
        # What there is none of has no switch; the grid and the colours of heights tell their lengths.
        self.assertEqual(seen["switches"], ["points", "path", "key frames", "90 % ellipsoids", "rays of the camera", seen["grid"], "colour by height"])
        self.assertRegex(seen["grid"], r"^grid of (0\.0*)?[125]0* units?$")
        heights = [float(x) for x in seen["heights"]]
        self.assertRegex(seen["legend"], r"^height 0[0-9.]+ units$")
        self.assertAlmostEqual(float(re.sub("^height 0| units$", "", seen["legend"])) / (heights[1] - heights[0]), 1, delta=0.06)
        self.assertTrue(seen["legendHidden"])
        report = json.loads((OUT / "report.json").read_text())["timing"]
        stage = report["detect"]
        self.assertAlmostEqual(seen["detect"] / (stage["mean_ms"] * stage["count"]), 1, delta=0.01)


if __name__ == "__main__":
    program.main()
