"""The page of a result, `raysfm view` and report.html: page_test.py PROGRAM VIEWER [unittest arguments]. VIEWER: where the
build has put playwright-core."""
import base64
import json
import math
import pathlib
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

import program
from program import ProgramTest, run

VIEWER = pathlib.Path(sys.argv.pop(2))
CHROMIUM = shutil.which("chromium")
NAME = "a <b>bold & \"quoted\" \u00e4"
BLACK = range(20, 24)  # frames of the sequence that show nothing
FROM, TO = 5, 35
OUT = None


def setUpModule():
    global OUT
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    street, OUT = pathlib.Path(folder.name) / NAME, pathlib.Path(folder.name) / "out"
    done = run("synth", "street", "--frames", 40, "--fps", 7.5, "--length", 6, "--samples", 1, "--out", street, "--quiet")
    assert done.returncode == 0, done.stderr
    for i in BLACK:
        (street / f"images/{i:06}.png").write_bytes(b"P5 512 384 255\n" + bytes(512 * 384))
    done = run("track", street, "--out", OUT, "--quiet")
    assert done.returncode == 0, done.stderr


def has_page():
    return (OUT / "report.html").exists()


class Page(ProgramTest):
    def setUp(self):
        super().setUp()
        if not has_page():
            self.skipTest("this build has no page: npm was not there when it was made")

    def test_every_result_has_one(self):
        html = (OUT / "report.html").read_text()
        title = re.search("<title>(.*?)</title>", html).group(1)
        self.assertEqual(title, "a &lt;b&gt;bold &amp; &quot;quoted&quot; \u00e4")
        self.assertIn("report.html", json.loads((OUT / "report.json").read_text())["files"])
        self.assertLess(len(html), 2 << 20)
        self.assertIsNone(re.search(r"(src|href)=\"?https?:|@import|url\(\s*['\"]?http", html))

    def test_view_writes_the_same_data(self):
        page = self.folder / "page.html"
        self.assertEqual(run("view", OUT, "--html", page).returncode, 0)
        found = [json.loads(re.search(r'id="data">(.*?)</script>', path.read_text()).group(1))
                 for path in (page, OUT / "report.html")]
        self.assertEqual(found[0]["title"], "out")
        index = [struct.unpack(f"<{w['frames']['count']}I", base64.b64decode(w["frames"]["index"]))
                 for f in found for w in f["worlds"][:1]]
        self.assertEqual(index[0], index[1])
        self.assertEqual([found[0][key] for key in ("posed", "missing")], [found[1][key] for key in ("posed", "missing")])
        self.assertEqual(found[0]["worlds"][0]["keyframes"]["frame"], found[1]["worlds"][0]["keyframes"]["frame"])

    def test_refused(self):
        self.refused("view", self.folder, "--html", self.folder / "page.html", says=["report.json", "no such file"])
        self.refused("view", OUT, "--html", OUT / "report.json", says=["--html", "report.json"])
        self.refused("view", OUT, "--html", self.folder / "no/page.html", says=["no/page.html"])

    @unittest.skipUnless(CHROMIUM and shutil.which("node") and (VIEWER / "node_modules/playwright-core").exists(),
                         "needs chromium, node and playwright-core")
    def test_in_a_browser(self):
        command = ["node", pathlib.Path(__file__).parent / "page_check.mjs", VIEWER, CHROMIUM, OUT / "report.html",
                   BLACK[0], FROM, TO]
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=120, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        seen = json.loads(done.stdout)
        self.assertEqual(seen["errors"], [])
        self.assertEqual(seen["requests"], [(OUT / "report.html").as_uri()])
        self.assertEqual((seen["title"], seen["heading"], seen["bold"]), (NAME, NAME, 0))
        self.assertGreater(seen["start"]["part"], 0.02)
        self.assertGreater(seen["start"]["colours"], 100)
        self.assertEqual((seen["plots"], seen["plotPixels"]), (4, [True] * 4))

        self.assertTrue(seen["scrubbed"]["now"].startswith(f"frame {FROM} · {FROM / 7.5:.3f} s"), seen["scrubbed"])
        self.assertTrue(seen["further"]["now"].startswith(f"frame {TO} "), seen["further"])
        self.assertNotEqual(seen["scrubbed"]["sum"], seen["further"]["sum"])
        reason = json.loads((OUT / "report.json").read_text())["frames"]["without_pose"][0]["reason"]
        self.assertEqual(seen["missing"]["now"], f"frame {BLACK[0]} · no pose: {reason}")
        self.assertIn(f"{BLACK[0]}", seen["missing"]["list"])
        self.assertTrue(seen["stepped"].startswith(f"frame {BLACK[0] + 1} "), seen["stepped"])
        self.assertTrue(seen["first"].startswith("frame 0 "), seen["first"])

        self.assertLess(seen["noPoints"]["colours"], seen["start"]["colours"] / 2)
        self.assertNotEqual(seen["ellipsoids"]["sum"], seen["noPoints"]["sum"])
        self.assertGreater(seen["noPoints"]["background"] >> 16, 0xe0)
        self.assertLess(seen["dark"]["background"] >> 16, 0x20)
        self.assertGreater(seen["follow"]["part"], 0.001)

        poses = {round(float(line.split()[0]) * 7.5): [float(w) for w in line.split()[1:4]]
                 for line in (OUT / "trajectory.txt").read_text().splitlines() if line[0] != "#"}
        self.assertAlmostEqual(float(seen["distance"].split()[0]) / math.dist(poses[FROM], poses[TO]), 1, places=3)


class WithoutThePage(ProgramTest):
    def test_said_in_one_line(self):
        if has_page():
            self.skipTest("this build has the page")
        self.refused("view", OUT, "--html", self.folder / "page.html", says=["this build has no page"])


if __name__ == "__main__":
    program.main()
