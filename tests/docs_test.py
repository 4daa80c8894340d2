"""What the pages of the documentation say is so: docs_test.py PROGRAM [unittest arguments]. Their commands have docs_commands_test.py."""
import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

import adjust_test
import doc_pages
import program
import solve_test
from doc_pages import DOCS, PAGES, ROOT
from program import run

SOURCES = ROOT / "src/raysfm"
EIGEN = pathlib.Path("/usr/include/eigen3")
NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e-?\d+)?"
# Numbers in names, which no table has.
NAMES = r"COLMAP 3\.8|Ceres 2\.1|OpenCV 4\.6|ORB-SLAM3|KITTI 07|Ladybug 49|\bk1\b"


def sources(*rooms):
    paths = [path for room in rooms for path in sorted((SOURCES / room).glob("*.cpp"))]
    return {path: re.sub(r'"\s*\n\s*"', "", path.read_text()) for path in paths if not path.name.endswith("_test.cpp")}


def is_told(quoted, line):
    """Whether a line has a number as it is quoted: some number of it, rounded to as many digits."""
    quoted = quoted.replace("−", "-")
    digits = len(quoted.partition(".")[2].partition("e")[0])
    found = [n.replace("−", "-") for n in re.findall(NUMBER, line)]
    return quoted in found or ("e" not in quoted and any(f"{float(n):.{digits}f}" == quoted for n in found))


class Figures(unittest.TestCase):
    """A figure that is a link to a page of results stands there, in a row with the words of the link's title."""

    LINK = re.compile(r'\[([^\]]*\d[^\]]*)\]\(((?:docs/)?results/\w+\.md)(?: "([^"]*)")?\)')

    def test_those_of_the_comparison(self):
        text = (DOCS / "comparison.md").read_text()
        checked = self.hold(DOCS / "comparison.md")
        self.assertGreater(checked, 50)
        rest = re.sub(NAMES + r"|`[^`]*`|\[[^\]]*\]\([^)]*\)", "", text)
        self.assertEqual([line for line in rest.splitlines() if re.search(r"\d", line)], [], "figures without a page that has them")

    def test_those_of_other_pages(self):
        self.assertGreater(sum(self.hold(page) for page in PAGES if page.name != "comparison.md"), 5)

    def hold(self, page):
        checked = 0
        for text, target, title in self.LINK.findall(page.read_text()):
            self.assertTrue(title, f"{page.name}: {text}: of which row?")
            rows = [line for line in (page.parent / target).read_text().splitlines() if all(word in line for word in title.split(", "))]
            self.assertTrue(rows, f"{page.name}: {target} has no row '{title}'")
            for number in re.findall(NUMBER, text):
                self.assertTrue(any(is_told(number, row) for row in rows), f"{page.name}: {number} is not in row '{title}' of {target}")
                checked += 1
        return checked


class Links(unittest.TestCase):
    def test_they_lead_somewhere(self):
        checked = 0
        for page in PAGES + sorted((DOCS / "results").glob("*.md")):
            text = re.sub(r"^```.*?^```|`[^`\n]*`", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
            for target in re.findall(r"\]\(([^)\s]+)", text):
                if "://" in target:
                    continue
                name, _, anchor = target.partition("#")
                path = page.parent / name if name else page
                self.assertTrue(path.exists(), f"{page.name}: {target}")
                if anchor:
                    titles = re.findall(r"^#+ (.*)", path.read_text(), re.MULTILINE)
                    anchors = [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]
                    self.assertIn(anchor, anchors, f"{page.name}: {target}")
                checked += 1
        self.assertGreater(checked, 60)


@unittest.skipUnless(shutil.which("c++") and EIGEN.exists(), "needs a compiler and Eigen")
class Snippets(unittest.TestCase):
    """The C++ of README compiles, in a function that has the names that it takes for granted."""

    FRAME = """#include <string>
int report(const std::string&);
template <class... T> void use(const T&...);
int run([[maybe_unused]] const raysfm::Rig& rig, [[maybe_unused]] const unsigned char* data, [[maybe_unused]] int width,
        [[maybe_unused]] int height, [[maybe_unused]] int stride, [[maybe_unused]] double timestamp) {
%s
return 0; }
"""

    def test_they_compile(self):
        found = [text for kind, text in doc_pages.blocks(ROOT / "README.md") if kind == "cpp"]
        self.assertGreater(len(found), 1)
        for text in found:
            lines = text.splitlines(keepends=True)
            code = "".join(l for l in lines if l.startswith("#")) + self.FRAME % "".join(l for l in lines if not l.startswith("#"))
            done = subprocess.run(["c++", "-std=c++20", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", f"-I{ROOT / 'src'}", f"-I{EIGEN}",
                                   "-xc++", "-"], input=code, text=True, capture_output=True)
            self.assertEqual((done.returncode, done.stderr), (0, ""), text)


def keys(value, name=""):
    """Names of all fields, as docs/report.md writes them."""
    if isinstance(value, dict):
        return {k for key, v in value.items() for k in keys(v, f"{name}.{key}" if name else key)}
    if isinstance(value, list):
        return {k for v in value for k in keys(v, name + "[]")} if value else {name + "[]"}
    return {name}


class Fields(unittest.TestCase):
    """docs/report.md has all fields of report.json and of what `eval --json` prints, and no other."""

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)
        (cls.folder / "tracks.csv").write_text(solve_test.text(solve_test.Scene().rows(lambda j: 500)))
        (cls.folder / "problem.txt").write_text(adjust_test.Bal(noise=0.3).text())
        for words in (["synth", "street", "--frames", 40, "--fps", 7.5, "--length", 6, "--samples", 1, "--out", "street"],
                      ["track", "street", "--to", 4, "--out", "track"], ["solve", "tracks.csv", "--size", "800x600", "--out", "solve"],
                      ["adjust", "problem.txt", "--out", "adjust"]):
            done = run(*words, "--quiet", cwd=cls.folder)
            assert done.returncode == 0, done.stderr
        cls.report, _, cls.evaluation = (DOCS / "report.md").read_text().partition("\n## ")

    def fields(self, text):
        table = re.search(r"\| field \|.*?\n\n", text + "\n\n", re.DOTALL).group()
        return {name: row for row in table.splitlines()[2:] for name in re.findall(r"`([^`]*)`", row.split(" | ")[0])}

    def test_every_field_of_a_report_is_there(self):
        documented = self.fields(self.report)
        stages = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (.*?) \|", self.report.partition("| stage |")[2], re.MULTILINE)))
        for command in ("track", "solve", "adjust"):
            report = json.loads((self.folder / command / "report.json").read_text())
            for stage in [name for name, value in report["timing"].items() if isinstance(value, dict)]:
                self.assertIn(stage, stages)
                report["timing"]["STAGE"] = report["timing"].pop(stage)
            for name in keys(report):
                known = [d for d in documented if d == name or d.startswith((name + ".", name + "[]"))
                         or name.startswith(d) and d.endswith("[]")]
                self.assertTrue(known, f"report.json of {command}: {name}")
                of = documented[known[0]].split(" | ")[1]
                self.assertTrue(of == "all" or command in of, f"{name} is in the report of {command}, and said to be of {of}")

    def test_what_the_sources_write_is_there_and_nothing_else(self):
        """Fields that a run seldom has, too."""
        text = "".join(t for path, t in sources("results").items() if path.name in ("report_file.cpp", "report_cameras.cpp"))
        text = re.sub(r"\n(void|FrameLens) read_.*?\n}\n", "\n", text, flags=re.DOTALL)
        written = set(re.findall(r'(?:\{|\[)"(\w+)"', text))
        self.assertGreater(len(written), 90)
        documented = {part.removesuffix("[]") for name in self.fields(self.report) for part in name.split(".")} - {"STAGE"}
        self.assertEqual(written, documented)

    def test_every_field_of_an_evaluation_is_there(self):
        documented = self.fields(self.evaluation)
        done = run("eval", "track", "street/truth.txt", "--covariance", "track/covariance.csv", "--json", cwd=self.folder)
        self.assertEqual(done.returncode, 0, done.stderr)
        found = {re.sub(r"worlds\[\]\.(?!poses|reason)", "", name) for name in keys(json.loads(done.stdout))}
        self.assertEqual(found - {"covariance[].position", "covariance[].orientation"}, set(documented) - {"worlds[].reason"})


LITERAL = r'"((?:\\.|[^"\\])*)"'


def literals(code):
    """Its strings, but for those of errors that end the program's work."""
    return [text for ends, text in re.findall(r"(internal_error\((?:fmt::format\()?)?" + LITERAL, code) if not ends]


class Reasons(unittest.TestCase):
    """docs/first-half-hour.md explains each reason for which a frame has no pose, and only what the sources say."""

    # What sets the reason of a frame or of a segment.
    SETS = re.compile(r"\b((?:last_|end_)?(?:reason|defect)_?\s+\+?=\s|(?:fail|lose)\()((?:" + LITERAL + r'|[^";])*);')
    ROOMS = ("odometry", "mapping", "views", "streams", "frames", "merging", "exports", "api")
    OF_OTHERS = {"photo_exif.cpp", "find_lens.cpp", "track_output.cpp"}  # reasons, but not of frames
    # Words that were set elsewhere. Of what is new here: where are its words, and are they in WORDS?
    HANDED_ON = {"view->defect", "frame.defect", "defect()", "reason", "f.reason", "*reason", "waiting_reason()", "last_reason_",
                 "std::move(reason)", "active.end_reason", "frames_[view.frame].reason", "blindness(view)) frames_[view.frame].reason = *reason",
                 "piece.segments[of_piece].reason",
                 "std::ranges::find_if(frames, [](const InputFrame& frame) { return !frame.defect.empty()", "image ? odd_size(index, image->gray) : image.error().message",
                 "view, failure)", "defective ? input.defects[j] : reason_without_pose(seen[i], agreeing[i])"}
    # Functions whose words these are: file, name.
    WORDS = [("odometry/odometry.cpp", "waiting_reason"), ("odometry/odometry.cpp", "go_on"), ("views/blindness.cpp", "blindness"), ("api/solve_result.cpp", "reason_without_pose"),
             ("robust/three_view_start.cpp", "describe"), ("frames/video_source.cpp", "defect"), ("frames/image_source.cpp", "odd_size"),
             ("frames/image_file.cpp", "read_image"), ("frames/other_image.cpp", "decode_other"), ("frames/other_image.cpp", "failure"),
             ("frames/png_pixels.cpp", "damaged"), ("frames/decoded_image.cpp", "check_image_size"), ("files/text_file.cpp", "read_text_file")]
    NO_REASON = {"{}: {}", "end of input", "track lost: ", "no start: ", "no start yet: ",
                 "%d of %zu matches agree, median parallax %.2f degrees"}  # the last of a start that came about

    def templates(self):
        found = set()
        for path, text in sources(*self.ROOMS).items():
            for match in self.SETS.finditer(text):
                statement, words = " ".join(match.group(2).split()), literals(match.group(2))
                if path.name not in self.OF_OTHERS and not words and not statement.startswith(("int matches", "ViewPtr view")):
                    self.assertIn(statement, self.HANDED_ON, f"{path.name}: where are the words of this reason?")
                found |= set(words) if path.name not in self.OF_OTHERS else set()
        for name, function in self.WORDS:
            text = re.sub(r'"\s*\n\s*"', "", (SOURCES / name).read_text())
            body = re.search(r"^( *)[\w:<> ]*\b(?:\w+::)?" + function + r"\((?![^{]*;)[^{]*\{.*?^\1\}", text, re.MULTILINE | re.DOTALL)
            self.assertTrue(body and literals(body.group()), f"{name}: {function}() says nothing")
            found |= set(literals(body.group()))
        return {text for text in found if " " in text} - self.NO_REASON

    def documented(self):
        table = re.search(r"\| it says.*?\n\n", (DOCS / "first-half-hour.md").read_text(), re.DOTALL).group()
        return [r for row in table.strip().splitlines()[2:] for r in re.findall(r"`([^`]*)`", row.split(" | ")[0])]

    def test_each_is_explained(self):
        templates, documented = self.templates(), self.documented()
        self.assertGreater(len(templates), 30)
        for template in sorted(templates):
            parts = re.split(r"\{[^}]*\}|%[\d.]*[a-z]+", template)
            pattern = re.compile(".+".join(re.escape(part) for part in parts))
            self.assertTrue(any(pattern.search(reason.replace("...", "7")) for reason in documented), f"not explained: '{template}'")

    def test_motions_that_tell_no_lens(self):
        """docs/solve.md has each, and the first half hour those that end a run."""
        named = {file: re.findall(pattern, (SOURCES / file).read_text()) for file, pattern in
                 (("projective/degeneracy.cpp", r'return "([a-z ]+)"'), ("projective/video_motion.cpp", r'return \{"([a-z ]+)"'),
                  ("uncalibrated/known_structure.cpp", r'degenerate = "([a-z ]+)"'))}
        self.assertTrue(all(named.values()), named)
        for name in sum(named.values(), []):
            self.assertIn(f"`{name}`", (DOCS / "solve.md").read_text())
        for name in named["projective/video_motion.cpp"]:
            self.assertIn(name, self.documented())

    def test_what_is_explained_is_there(self):
        text = "".join("".join(sources(room).values()) for room in (*self.ROOMS, "robust", "projective", "files", "uncalibrated"))
        documented = self.documented()
        self.assertGreater(len(documented), 30)
        for reason in documented:
            # What the program fills in stands in place of dots, numbers and names.
            for part in (p.strip(" ;:,()/") for p in re.split(r"\.\.\.|[\w./]+\.(?:mp4|png)|[\d.]+", reason)):
                self.assertTrue(len(part) < 4 or part in text, f"{reason}: '{part}' is in no source")


if __name__ == "__main__":
    program.main()
