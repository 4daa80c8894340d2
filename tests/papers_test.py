"""The machinery behind docs/results/papers.md and peers.md: papers_test.py [unittest arguments]."""
import math
import pathlib
import re
import struct
import sys
import tempfile
import unittest
from unittest import mock

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import aligned
import charts
import kept
import papers
import papers_experiments
import papers_measures
import papers_rows
import papers_table
import peers

TEXTS = ROOT.parent / "shared" / "papers"


def words_printed(folder, outputs):
    return {"words": len(outputs[0].split())}


def words_doubled(folder, outputs):
    return {"words": 2 * len(outputs[0].split())}


def stumbles(folder, outputs):
    return {"words": outputs[1]}


def interrupts(folder, outputs):
    raise KeyboardInterrupt


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.paths = {name: self.folder / name for name in ("tool", "other", "input", "left")}
        self.program("tool", "cat $1/a")
        self.program("other", "echo other")
        (self.folder / "input").mkdir()
        (self.folder / "input" / "a").write_text("one two three")
        silent = mock.patch.object(papers, "tell")
        silent.start()
        self.addCleanup(silent.stop)

    def program(self, name, line):
        self.paths[name].write_text(f"#!/bin/sh\n{line}\n")
        self.paths[name].chmod(0o755)

    def experiment(self, name="count", measure=words_printed, command=("{tool}", "{input}"), **more):
        return kept.Experiment(name, [list(command)], measure, ["tool"], ["input"], **more)

    def keeper(self):
        """As a new run has it."""
        return kept.Kept(self.folder / "kept", self.paths)


class Keeping(Folder):
    def setUp(self):
        super().setUp()
        self.assertIsNone(self.keeper().get(self.experiment()))
        self.assertEqual(self.keeper().run(self.experiment())["result"], {"words": 3})

    def test_what_is_the_same_is_kept(self):
        record = self.keeper().get(self.experiment())
        self.assertEqual(record["result"], {"words": 3})
        self.assertEqual(record["commands"], ["tool input"])
        self.program("other", "echo else")  # nothing of it was used
        self.assertIsNotNone(self.keeper().get(self.experiment()))

    def test_another_command_program_module_input_or_measure_is_not(self):
        self.assertIsNone(self.keeper().get(self.experiment(command=("{tool}", "{input}", "more"))))
        self.assertIsNone(self.keeper().get(self.experiment(measure=words_doubled)))
        module = self.folder / "tool-pictures.so"
        module.write_text("module")
        self.assertIsNone(self.keeper().get(self.experiment()))
        module.unlink()
        self.assertIsNotNone(self.keeper().get(self.experiment()))
        (self.folder / "input" / "a").write_text("one two four")
        self.assertIsNone(self.keeper().get(self.experiment()))
        (self.folder / "input" / "a").write_text("one two three")
        self.assertIsNotNone(self.keeper().get(self.experiment()))
        self.program("tool", "cat $1/a; echo; echo four")
        self.assertIsNone(self.keeper().get(self.experiment()))
        self.assertEqual(self.keeper().run(self.experiment())["result"], {"words": 4})

    def test_a_part_does_not_take_the_place_of_the_whole(self):
        part = self.experiment(command=("{tool}", "{input}", "quick"), scale="1 of 9")
        self.assertIsNone(self.keeper().get(part))
        self.keeper().run(part)
        self.assertEqual(self.keeper().get(part)["scale"], "1 of 9")
        self.assertEqual(self.keeper().get(self.experiment())["scale"], "")

    def test_an_error_is_told_and_not_kept(self):
        self.program("tool", "echo sorry >&2; exit 3")
        with self.assertRaisesRegex(kept.Failed, "sorry"):
            self.keeper().run(self.experiment())
        self.assertIsNone(self.keeper().get(self.experiment()))
        self.assertEqual(self.keeper().run(self.experiment(may_fail=True))["result"], {"words": 0})

    def test_what_one_leaves_is_the_input_of_another(self):
        leaves = self.experiment("leaves", command=("cp", "{input}/a", "{out}/b"), leaves={"left": "b"})
        after = kept.Experiment("after", [["cat", "{left}"]], words_printed, [], ["left"])
        keeper = self.keeper()
        self.assertEqual(keeper.missing(after), ["left"])
        keeper.run(leaves)
        self.assertEqual(keeper.run(after)["result"], {"words": 3})
        (self.folder / "input" / "a").write_text("one")
        keeper = self.keeper()
        keeper.run(leaves)
        self.assertIsNone(keeper.get(after))


    def test_functions_that_a_measure_calls_count(self):
        source = kept.source_of(papers_measures.followed)
        for needed in ("def tracked(", "def run_numbers(", "def largest_eigenvector("):
            self.assertIn(needed, source)
        self.assertNotIn("def moment_figures(", source)


class Running(Folder):
    def test_what_is_finished_before_an_interruption_is_kept(self):
        first, last = self.experiment("first"), self.experiment("last", command=("{tool}", "{input}", "last"))
        stops = self.experiment("stops", interrupts)
        self.assertFalse(papers.run_all(self.keeper(), [first, stops, last]))
        self.assertIsNotNone(self.keeper().get(first))
        self.assertIsNone(self.keeper().get(last))
        with mock.patch.object(kept.Kept, "run", side_effect=AssertionError("it was kept")):
            self.assertTrue(papers.run_all(self.keeper(), [first]))
        self.assertTrue(papers.run_all(self.keeper(), [first, last]))
        self.assertIsNotNone(self.keeper().get(last))

    def test_what_misses_its_input_or_fails_stops_nothing(self):
        lacks = kept.Experiment("lacks", [["cat", "{left}"]], words_printed, [], ["left"])
        fails = self.experiment("fails", command=("false",))
        last = self.experiment("last")
        self.assertTrue(papers.run_all(self.keeper(), [lacks, fails, self.experiment("stumbles", stumbles), last]))
        self.assertIsNotNone(self.keeper().get(last))


def rows():
    return [(paper, row) for paper, items in papers_rows.PAPERS.items() for of in items().values() for row in of]


class Rows(unittest.TestCase):
    def test_every_table_and_figure_is_there(self):
        found = {(paper, row.item) for paper, row in rows()}
        counts = {"LBA09": (19, 8), "IFBA01": (15, 2)}
        for paper, (figures, tables) in counts.items():
            for kind, count in (("Figure", figures), ("Table", tables)):
                for number in range(1, count + 1):
                    self.assertIn((paper, f"{kind} {number}"), found)
        for section in ("Section 5.4", "Section 6.2"):
            self.assertIn(("LBA09", section), found)

    @unittest.skipUnless(TEXTS.is_dir(), "the papers are missing")
    def test_the_papers_have_no_others(self):
        for paper, start in (("LBA09", "000"), ("IFBA01", "004")):
            text = next(TEXTS.glob(f"{start}*.txt")).read_text()
            for number in re.findall(r"^Fig(?:ure|\.) (\d+)[.:]", text, re.MULTILINE):
                self.assertIn((paper, f"Figure {number}"), {(p, row.item) for p, row in rows()})

    def test_each_has_an_experiment_or_a_reason(self):
        known = {e.name for e in papers_experiments.experiments(quick=False)}
        known |= {f"{film} adjust n={n}" for film in papers_rows.FILMS for n in papers_rows.TABLE_6}
        known |= {f"{film} by angles" for film in papers_rows.FILMS}
        for _, row in rows():
            self.assertEqual(bool(row.none), row.experiment == "", row.what)
            self.assertTrue(row.none or row.experiment in known, row.experiment)

    def test_quick_experiments_are_the_same_but_for_what_they_leave_out(self):
        whole = {e.name: e for e in papers_experiments.experiments(quick=False)}
        quick = {e.name: e for e in papers_experiments.experiments(quick=True)}
        self.assertEqual(list(whole), list(quick))
        for name, e in quick.items():
            self.assertEqual(whole[name].scale, "")
            self.assertEqual(e.commands != whole[name].commands, e.scale != "", name)
        for name in papers_experiments.CHECKED:
            self.assertIn(name, whole)


class Table(Folder):
    def written(self, records):
        (self.folder / "images").mkdir(exist_ok=True)
        counts = papers_table.write(self.folder / "papers.md", self.folder / "images", records, "raysfm 1", ["kernel"])
        return counts, (self.folder / "papers.md").read_text()

    def test_without_any_experiment_it_says_so_in_every_row(self):
        counts, text = self.written({})
        self.assertEqual(text.count("| not yet run |") + text.count("| not reproduced |"), len(rows()))
        self.assertIn(f"{len(rows())} rows", counts)
        self.assertIn("Not yet run: kernel.", text)

    def test_a_number_its_ratio_and_its_scale(self):
        record = {"result": {"gain_5_20": 5.0}, "scale": "a part", "seconds": 1, "load": 2, "commands": ["bench 0"],
                  "made": "today"}
        text = self.written({"growth": record})[1]
        self.assertIn("n = 5, N = 20, gain of one iteration | 10 | 5 | 0.5 | growth (a part) |", text)
        self.assertIn("| growth | `bench 0` | 1 | 2 | today |", text)

    def test_a_run_that_failed_is_seen_to_fail(self):
        record = {"result": {"failed": "failed (40 % of the frames posed)", "mean_m": 0.1}, "scale": "", "seconds": 1, "load": 2,
                  "commands": [], "made": ""}
        text = self.written({"street n=3 N=3": record})[1]
        self.assertIn("street, n = 3, N = 3 | failed | failed (40 % of the frames posed) | - |", text)

    def test_limits(self):
        name = papers_rows.window_name("kitti07-mono", 3, 10)
        self.assertEqual(papers.beyond_limits({name: {"result": {"mean_m": 0.01, "global_mean_m": 0.01}}}), [])
        self.assertEqual(len(papers.beyond_limits({name: {"result": {"mean_m": 9.0, "global_mean_m": 0.01}}})), 1)
        self.assertEqual(len(papers.beyond_limits({name: {"result": {"failed": "failed"}}})), 1)


class Measures(unittest.TestCase):
    def test_a_similarity_is_found(self):
        points = [[math.sin(i), 0.3 * math.cos(3 * i), 0.1 * i] for i in range(20)]
        turned = [[7 - 2 * p[1], 2 * p[0] + 1, 2 * p[2] - 3] for p in points]  # a quarter turn about z, twice as large
        move = aligned.similarity(points, turned)
        self.assertLess(max(math.dist(move(p), t) for p, t in zip(points, turned)), 1e-12)
        flat = [[float(i), 0.0, 0.0] for i in range(9)]
        move = aligned.similarity(flat, [[0.0, 3 * p[0], 0.0] for p in flat])
        self.assertLess(math.dist(move([4.0, 0.0, 0.0]), [0.0, 12.0, 0.0]), 1e-12)

    def test_tables_of_a_benchmark(self):
        text = "### A rigid object\n\n| lens share % | method | CPU ms | iterations | structure error, mm | focal error, % |\n" \
               "|---|---|---|---|---|---|\n" + "".join(f"| {x} | {m} | {x + 2} | 9 | 1e-3 | 4 |\n" for x in (0, 50) for m in papers_measures.METHODS)
        found = papers_measures.lens_figures(None, [text])["rigid"]
        self.assertEqual((found["x"], found["free cpu"], found["polished structure"]), ([0.0, 50.0], [2.0, 52.0], [0.001, 0.001]))
        self.assertEqual(papers_rows.times_better("rigid", "cpu", 50.0)({"rigid": found}), "1.00 free, 1.00 polished")

    def test_places_of_a_colmap_model(self):
        half = math.sqrt(0.5)  # a quarter turn about z: the camera at (2, -1, -3) has t = (-1, -2, 3)
        image = struct.pack("<I7dI", 1, half, 0, 0, half, -1.0, -2.0, 3.0, 1) + b"b.png\0" + struct.pack("<Q", 1) + bytes(24)
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "images.bin"
            path.write_bytes(struct.pack("<Q", 2) + image + image.replace(b"b.png", b"c.png"))
            found = peers.colmap_centres(path)
        self.assertEqual(sorted(found), ["b.png", "c.png"])
        self.assertLess(math.dist(found["c.png"], [2.0, -1.0, -3.0]), 1e-12)

    def test_calibration_for_colmap_counts_from_the_corner(self):
        flags = peers.colmap_camera("x\n    intrinsics: {fx: 500, fy: 501, cx: 319.5, cy: 239.5, k1: -0.02}\n")
        self.assertEqual(flags[-1], "500.0,501.0,320.0,240.0,-0.02,0.0,0.0,0.0")

    def test_charts(self):
        drawn = charts.chart([("a", "line", [0, 1, 2], [0, 5, math.nan]), ("b", "bars", [1], [3])], "x", "y")
        self.assertEqual(drawn.count("<path") - drawn.count('stroke="#ddd"'), 2)
        self.assertNotIn("nan", drawn)
        self.assertIn("<svg", charts.chart([("", "dots", [], [])], "x", "y", equal=True))


if __name__ == "__main__":
    unittest.main()
