"""The page of a result, `raysfm view` and report.html: page_test.py PROGRAM VIEWER [unittest arguments]. VIEWER: where the
build has put playwright-core."""
import base64
import http.client
import json
import math
import pathlib
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import program
from program import ProgramTest, run

VIEWER = pathlib.Path(sys.argv.pop(2)).resolve()
DRIVE = pathlib.Path(__file__).resolve().parents[2] / "shared/data/kitti00-small"  # long enough to be watched
CHROMIUM = shutil.which("chromium")
NAME = "a <b>bold & \"quoted\" \u00e4"
BLACK = range(20, 24)  # frames of the sequence that show nothing
FROM, TO = 5, 35
STREET = OUT = None
NEEDS_BROWSER = unittest.skipUnless(CHROMIUM and shutil.which("node") and (VIEWER / "node_modules/playwright-core").exists(),
                                    "needs chromium, node and playwright-core")


def setUpModule():
    global STREET, OUT
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    street, OUT = pathlib.Path(folder.name) / NAME, pathlib.Path(folder.name) / "out"
    STREET = street
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
        found, rest = [[json.loads(re.search(rf'id="{name}">(.*?)</script>', path.read_text()).group(1))
                        for path in (page, OUT / "report.html")] for name in ("data", "rest")]
        self.assertEqual(rest[0], rest[1])
        self.assertEqual([data["title"] for data in found], [f"{NAME} \u00b7 out", NAME])
        index = [struct.unpack(f"<{w['frames']['count']}I", base64.b64decode(w["frames"]["index"]))
                 for f in found for w in f["worlds"][:1]]
        self.assertEqual(index[0], index[1])
        self.assertEqual([found[0][key] for key in ("posed", "missing")], [found[1][key] for key in ("posed", "missing")])
        self.assertEqual(found[0]["worlds"][0]["keyframes"]["frame"], found[1]["worlds"][0]["keyframes"]["frame"])

    def test_refused(self):
        self.refused("view", self.folder, "--html", self.folder / "page.html", says=["report.json", "no such file"])
        self.refused("view", OUT, "--html", OUT / "report.json", says=["--html", "report.json"])
        self.refused("view", OUT, "--html", self.folder / "no/page.html", says=["no/page.html"])
        for port in ("0", "65536", "street.mp4", ":80", "1.2.3:"):
            self.refused("view", OUT, "--port", port, says=["--port", port, "1 to 65535"])
            self.refused("track", STREET, "--out", self.folder / "out", f"--view={port}", says=["--view", port, "1 to 65535"])
        self.assertFalse((self.folder / "out").exists())

    @NEEDS_BROWSER
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
        self.assertNotIn("", seen["between"]["texts"])
        self.assertEqual(seen["between"]["texts"][2], str(seen["between"]["points"]))
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

        self.assertTrue(seen["r"], "the rays of the camera")
        self.assertTrue(seen["heights"], "points coloured by height")
        self.assertGreater(seen["stages"], 5)

        poses = {round(float(line.split()[0]) * 7.5): [float(w) for w in line.split()[1:4]]
                 for line in (OUT / "trajectory.txt").read_text().splitlines() if line[0] != "#"}
        self.assertAlmostEqual(float(seen["distance"].split()[0]) / math.dist(poses[FROM], poses[TO]), 1, places=3)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def ask(port, path, **headers):
    """Status, type and content of the answer; the path goes out as it is."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.putrequest(headers.pop("method", "GET"), path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer.status, answer.getheader("Content-Type"), content


class Served(ProgramTest):
    """`raysfm view DIR` without --html, and `--view`."""

    def setUp(self):
        super().setUp()
        if not has_page():
            self.skipTest("this build has no page: npm was not there when it was made")

    def start(self, *arguments):
        running = subprocess.Popen([program.PROGRAM, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(running.stderr.close)
        self.addCleanup(running.stdout.close)
        self.addCleanup(running.wait)
        self.addCleanup(running.kill)
        return running

    def serve(self, *arguments):
        port = free_port()
        running = self.start("view", OUT, "--port", port, *arguments)
        self.assertEqual(running.stdout.readline(), f"served at http://127.0.0.1:{port}/ until Ctrl-C\n")
        return running, port

    def browser(self, *arguments):
        script = pathlib.Path(__file__).parent / "served_check.mjs"
        return subprocess.Popen([str(a) for a in ["node", script, VIEWER, CHROMIUM, *arguments]], stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)

    def test_answers(self):
        running, port = self.serve()
        status, kind, page = ask(port, "/")
        self.assertEqual((status, kind), (200, "text/html; charset=utf-8"))
        self.assertIn(b"connect-src 'self'", page)
        status, kind, picture = ask(port, f"/picture?frame={FROM}&camera=0")
        self.assertEqual((status, kind, picture[:3]), (200, "image/jpeg", b"\xff\xd8\xff"))
        features = json.loads(ask(port, f"/features?frame={FROM}&camera=0")[2])
        self.assertEqual(features["size"], [512, 384])
        self.assertGreater(len(features["tracks"]), 50)
        self.assertEqual(json.loads(ask(port, f"/features?frame={BLACK[0]}&camera=0")[2])["tracks"], [])
        running.send_signal(signal.SIGINT)
        self.assertEqual(running.wait(10), 0)
        with self.assertRaises(OSError):
            ask(port, "/")

    def test_answers_nothing_else(self):
        _, port = self.serve()
        for path in ("/../../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/report.json", "/data", "/events",
                     "/picture/../../report.json", f"/{OUT}/report.json"):
            status, _, content = ask(port, path)
            self.assertEqual(status, 404, path)
            self.assertEqual(content, b"", path)
        for query, status in (("frame=-1&camera=0", 400), ("frame=x&camera=0", 400), ("camera=0", 400), ("frame=99999999999999999999&camera=0", 400),
                              ("frame=40&camera=0", 404), ("frame=0&camera=1", 404)):
            self.assertEqual(ask(port, "/picture?" + query)[0], status, query)
        self.assertEqual(ask(port, "/", Host="evil.example")[0], 403)
        self.assertEqual(ask(port, "/", Host=f"localhost:{port}")[0], 200)
        self.assertEqual(ask(port, "/", method="POST")[0], 403)

    def test_only_this_machine_can_ask(self):
        _, port = self.serve()
        sockets = pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]
        listening = [line.split()[1] for line in sockets if line.split()[3] == "0A" and line.split()[1].endswith(f":{port:04X}")]
        self.assertEqual(listening, [f"0100007F:{port:04X}"])

    def test_a_port_that_is_taken(self):
        _, port = self.serve()
        self.refused("view", OUT, "--port", port, says=[str(port), "taken"])
        self.refused("track", STREET, "--out", self.folder / "out", "--view", port, says=["--view", str(port), "taken"])
        self.assertFalse((self.folder / "out").exists())

    def test_frames_that_have_gone(self):
        moved = STREET.with_name("moved")
        STREET.rename(moved)
        try:
            running, port = self.serve()
            self.assertEqual(ask(port, "/picture?frame=0&camera=0")[0], 404)
            self.assertEqual(ask(port, "/")[0], 200)
            running.send_signal(signal.SIGTERM)
            running.wait(10)
            self.assertIn("no pictures of frames", running.stderr.read())
            _, port = self.serve("--images", moved)
            self.assertEqual(ask(port, "/picture?frame=0&camera=0")[0], 200)
        finally:
            moved.rename(STREET)

    @NEEDS_BROWSER
    def test_pictures_in_a_browser(self):
        _, port = self.serve()
        browser = self.browser("pictures", f"http://127.0.0.1:{port}/", FROM)
        told, said = browser.communicate(timeout=120)
        self.assertEqual(browser.returncode, 0, said)
        seen = json.loads(told)
        self.assertEqual(seen["errors"], [])
        self.assertTrue(all(r.startswith(f"http://127.0.0.1:{port}/") for r in seen["requests"]), seen["requests"])
        self.assertEqual(seen["size"], [512, 384])
        self.assertGreater(seen["drawn"], 50)
        self.assertGreater(seen["green"] + seen["blue"], 200)
        self.assertRegex(seen["note"], rf"^frame {FROM}: \d+ points")

    def test_a_watched_run_has_the_same_bytes(self):
        """Somebody listens, and somebody else asks for a page and never takes it."""
        port, out = free_port(), self.folder / "out"
        running = self.start("track", STREET, "--out", out, "--view", port)
        heard = threading.Thread(target=self.listen, args=(port,))
        heard.start()
        self.assertEqual(running.wait(120), 0)
        heard.join(30)
        self.assertTrue(self.news, "nothing was heard")
        self.assertTrue(self.news[-1]["over"])
        posed = [pose[0] for news in self.news for pose in news["frames"]]
        self.assertEqual(posed, sorted(set(posed)))
        for name in ("trajectory.txt", "keyframes.txt", "points.ply", "covariance.csv", "config.yaml", "sparse/images.bin"):
            self.assertEqual((out / name).read_bytes(), (OUT / name).read_bytes(), name)

    def listen(self, port):
        self.news = []
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                idle = socket.create_connection(("127.0.0.1", port), timeout=30)
                break
            except OSError:
                time.sleep(0.01)
        idle.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
        connection.request("GET", "/events")
        for line in connection.getresponse():
            if line.startswith(b"data: "):
                self.news.append(json.loads(line[6:]))
        connection.close()
        idle.close()

    @NEEDS_BROWSER
    @unittest.skipUnless(DRIVE.exists(), "the shared data are missing")
    def test_a_run_in_a_browser(self):
        port = free_port()
        browser = self.browser("live", f"http://127.0.0.1:{port}/", 0)
        browser.stdout.readline()  # it is there
        running = self.start("track", DRIVE / "video.mp4", "--camera", DRIVE / "camera.yaml", "--out", self.folder / "out", "--features", 2500,
                             "--threads", 1, "--view", port)
        # The run is held back until a browser that draws without a graphics card has shown a picture of it.
        while running.poll() is None and not select.select([browser.stdout], [], [], 0.15)[0]:
            running.send_signal(signal.SIGCONT)
            time.sleep(0.05)
            running.send_signal(signal.SIGSTOP)
        running.send_signal(signal.SIGCONT)
        told, said = browser.communicate(timeout=180)
        self.assertEqual(browser.returncode, 0, said)
        self.assertEqual(running.wait(60), 0)
        seen = json.loads(told.splitlines()[-1])
        # The run waits three seconds for a browser, and then no longer.
        self.assertEqual([e for e in seen["errors"] if not e.startswith("Failed to load resource")], [])
        self.assertTrue(seen["over"])
        self.assertEqual(seen["state"], "the run has ended")
        self.assertGreater(seen["total"], 100)
        self.assertGreater(seen["part"], 0.01)
        self.assertTrue(any("live" in now for now in seen["now"]), seen["now"])
        # Its newest frame with what was matched in it; none once the run has ended.
        frames = [int(found.group(1)) for p in seen["pictures"] if (found := re.match(r"frame (\d+): \d+ points", p["note"]))]
        self.assertTrue(frames, seen["pictures"])
        self.assertEqual(frames, sorted(frames))
        self.assertGreater(max(p["green"] for p in seen["pictures"]), 100)
        self.assertEqual({tuple(p["size"]) for p in seen["pictures"]}, {(416, 128)})
        self.assertFalse(seen["pictureLeft"])


class WithoutThePage(ProgramTest):
    def test_said_in_one_line(self):
        if has_page():
            self.skipTest("this build has the page")
        self.refused("view", OUT, "--html", self.folder / "page.html", says=["this build has no page"])


if __name__ == "__main__":
    program.main()
