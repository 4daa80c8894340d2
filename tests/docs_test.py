"""Every command of docs/first-half-hour.md does what it says, those of other pages are known: docs_test.py PROGRAM [unittest arguments]."""
import json
import pathlib
import re
import shlex
import shutil
import unittest

import program
from program import ProgramTest, run

DOCS = pathlib.Path(__file__).resolve().parent.parent / "docs"
VIDEO = DOCS.parent.parent / "shared/data/redkitchen-handheld/first200.mp4"
PROGRAM = "build/raysfm"


def commands(page):
    """The lines of its blocks for the shell, without the program's name."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    lines = [line.split(" #")[0].strip() for block in blocks for line in block.splitlines()]
    return [line.removeprefix(PROGRAM + " ") for line in lines]


class FirstHalfHour(ProgramTest):
    def test_it_is_of_commands_of_the_program(self):
        lines = commands(DOCS / "first-half-hour.md")
        self.assertGreater(len(lines), 8)
        known = set(re.findall(r"^  (\w+) ", run("--help").stdout, re.MULTILINE))
        for line in lines:
            self.assertIn(line.split()[0], known, line)

    @unittest.skipUnless(VIDEO.exists(), "the shared data are missing")
    def test_every_command(self):
        shutil.copy(VIDEO, self.folder / "my_video.mp4")
        page = True
        for line in commands(DOCS / "first-half-hour.md"):
            words = shlex.split(line)
            if words[0] == "view" and not ((self.folder / "out/report.html").exists() and "--html" in words):
                page &= "--html" not in words
                continue  # it serves until somebody ends it, which page_test.py does; or this build has no page
            done = run(*words, cwd=self.folder)
            self.assertEqual(done.returncode, 0, f"{line}: {done.stderr}")
        made = ["splat/sparse/0/cameras.bin", "out-nerfstudio/transforms.json", "out-blender/scene.py"] + ["page.html"] * page
        for name in made:
            self.assertTrue((self.folder / name).stat().st_size > 50, name)
        self.assertGreater(len(list((self.folder / "splat/images").iterdir())), 5)
        for name in ("out", "again", "by-rays"):
            frames = json.loads((self.folder / name / "report.json").read_text())["frames"]
            self.assertEqual(frames["posed"], frames["total"], name)


def code_of(page):
    """The lines of its blocks, fenced or indented."""
    fenced = False
    for line in page.read_text().replace("\\\n", " ").splitlines():
        if line.startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            yield line.strip()


def lines_of(page):
    """The commands of the program that a page tells a reader to type, as words."""
    for line in code_of(page):
        if re.match(rf"({PROGRAM}|raysfm) ", line):
            yield shlex.split(line, comments=True)[1:]


class EveryPage(unittest.TestCase):
    """What any page tells a reader to type is understood: the command is there, and it has those flags."""

    def test_commands_and_flags_are_there(self):
        flags_of, checked = {}, 0
        root = DOCS.parent
        for page in [root / "README.md", *sorted(DOCS.glob("*.md"))]:
            for words in lines_of(page):
                depth = 2 if words[0] in ("camera", "map") else 1
                command = tuple(words[:depth])
                if words[0].startswith("-"):
                    continue
                if command not in flags_of:
                    done = run(*command, "--help")
                    self.assertEqual(done.returncode, 0, f"{page.name}: {' '.join(words)}: {done.stderr}")
                    flags_of[command] = set(re.findall(r"--[a-z][a-z-]*", done.stdout + run("--help").stdout))
                for word in words[depth:]:
                    if word.startswith("--") and len(word) > 2:
                        self.assertIn(word.split("=")[0], flags_of[command], f"{page.name}: {' '.join(words)}")
                        checked += 1
        self.assertGreater(checked, 100)


class Reasons(unittest.TestCase):
    """The reasons that the page explains are those of the sources."""

    def test_they_are_there(self):
        sources = "".join(p.read_text() for folder in ("odometry", "views", "projective", "api")
                          for p in (DOCS.parent / "src/raysfm" / folder).glob("*.cpp"))
        table = re.search(r"\| it says.*?\n\n", (DOCS / "first-half-hour.md").read_text(), re.DOTALL).group()
        reasons = [r for row in table.strip().splitlines()[2:] for r in re.findall(r"`([^`]*)`", row.split("|")[1])]
        self.assertGreater(len(reasons), 10)
        for reason in reasons:
            # What the program fills in stands in place of dots and numbers.
            for part in (p.strip(" ;:,") for p in re.split(r"\.\.\.|\d+", reason)):
                self.assertTrue(len(part) < 4 or part in sources, f"{reason}: '{part}' is in no source")


if __name__ == "__main__":
    program.main()
