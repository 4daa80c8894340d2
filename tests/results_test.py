"""The arithmetic behind docs/results/hard.md, cost.md and covariance.md: results_test.py [unittest arguments]."""
import math
import pathlib
import random
import sys
import tempfile
import unittest
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "scripts"))

import cost
import halves
import hard
import least_squares


class LeastSquares(unittest.TestCase):
    def test_a_line_with_known_errors(self):
        numbers = random.Random(1)
        rows = [[1.0, 0.1 * i] for i in range(2000)]
        values = [2 + 3 * x + numbers.gauss(0, 0.5) for _, x in rows]
        found, errors = least_squares.fit(rows, values, [1.0] * len(rows))
        for value, error, true in zip(found, errors, (2, 3)):
            self.assertLess(abs(value - true), 4 * error)
        self.assertAlmostEqual(errors[0], 2 * 0.5 / math.sqrt(len(rows)), delta=0.05 * errors[0])  # of a line from 0

    def test_no_cost_is_below_zero(self):
        rows = [[1.0, x, x * x] for x in range(1, 9)]
        found, errors = least_squares.fit_not_below_zero(rows, [5 + 2 * x - 0.001 * x * x for _, x, _ in rows], [1.0] * 8)
        self.assertEqual(found[2], 0)
        self.assertTrue(math.isinf(errors[2]))
        self.assertAlmostEqual(found[1], 2, delta=0.05)


def result_of(setting, ms_of, mib):
    return {"frames": setting.T, "keyframes": setting.K, "posed": setting.T, "peak_mib": mib,
            "stages": {stage: ms_of(stage, setting) for stage in cost.TIME}}


class Model(unittest.TestCase):
    def test_the_coefficients_that_made_the_runs_come_back(self):
        numbers = random.Random(2)
        time = {stage: [numbers.uniform(0.5, 5) for _ in terms] for stage, terms in cost.TIME.items()}
        memory = [numbers.uniform(0.5, 5) for _ in cost.MEMORY]

        def ms(stage, s):
            return sum(c * term(s) for c, (_, _, term) in zip(time[stage], cost.TIME[stage]))

        def mib(s):
            return sum(c * term(s) for c, (_, _, term) in zip(memory, cost.MEMORY))

        settings = [cost.Setting(numbers.choice((1, 2, 4)), numbers.uniform(0.1, 8), numbers.uniform(0.5, 3),
                                 numbers.choice((5, 10, 20)), numbers.choice((60, 400, 3000)), numbers.uniform(0.05, 0.3))
                    for _ in range(40)]
        model = cost.Model([(s, result_of(s, ms, mib(s))) for s in settings])
        unseen = cost.Setting(3, 1.9, 0.8, 15, 1000, 0.1)
        self.assertAlmostEqual(model.ms(unseen), sum(ms(stage, unseen) for stage in cost.TIME), places=6)
        self.assertAlmostEqual(model.mib(unseen), mib(unseen), places=6)


class Honesty(unittest.TestCase):
    def setUp(self):
        numbers = random.Random(3)
        self.truth = {t: [0.1 * t, math.sin(0.05 * t), 0.02 * t * math.cos(0.1 * t)] for t in range(100)}
        self.sigma = (0.02, 0.01, 0.03)
        self.found = {t: [-3 + 2 * (-p[1] + self.sigma[0] * numbers.gauss(0, 1)), 1 + 2 * (p[0] + self.sigma[1] * numbers.gauss(0, 1)),
                          2 * (p[2] + self.sigma[2] * numbers.gauss(0, 1))] for t, p in self.truth.items()}

    def covariances(self, factor):
        return {t: [[(2 * factor * self.sigma[i]) ** 2 * (i == j) for j in range(3)] for i in range(3)] for t in self.truth}

    def test_errors_as_stated_are_within_their_ellipsoids(self):
        stated = hard.path_error(self.found, self.truth, self.covariances(1))
        self.assertLess(stated["beyond_percent"], 3)
        self.assertGreater(hard.path_error(self.found, self.truth, self.covariances(0.2))["beyond_percent"], 70)
        length = sum(math.dist(self.truth[t], self.truth[t + 1]) for t in range(99))
        expected = 100 * math.sqrt(sum(s * s for s in self.sigma)) / length
        self.assertAlmostEqual(stated["ate_percent"], expected, delta=0.2 * expected)

    def test_mahalanobis_of_a_full_matrix(self):
        c = [[4.0, 1.0, 0.5], [1.0, 3.0, 0.2], [0.5, 0.2, 2.0]]
        x = [0.3, -1.1, 0.7]
        e = [sum(c[i][j] * x[j] for j in range(3)) for i in range(3)]
        self.assertAlmostEqual(hard.solved(c, e), sum(a * b for a, b in zip(x, e)))

    def test_verdicts(self):
        plain = {"ate_percent": 0.2, "beyond_percent": 10, "posed_percent": 100, "said": []}
        wrong = {"ate_percent": 5.0, "beyond_percent": 90, "posed_percent": 100, "said": []}
        self.assertEqual(hard.verdict(wrong, plain), "**wrong, silent**")
        self.assertEqual(hard.verdict(wrong | {"said": ["something"]}, plain), "wrong, said")
        self.assertEqual(hard.verdict(wrong | {"ate_percent": 0.7}, plain), "holds")  # less than a hundredth of the path
        self.assertEqual(hard.verdict({"posed_percent": 0, "said": []}, plain), "lost, its frames say why")

    def test_what_the_quick_check_misses(self):
        plain = {"ate_percent": 0.2, "beyond_percent": 10, "posed_percent": 100, "said": []}
        wrong = {"ate_percent": 9.0, "beyond_percent": 99, "posed_percent": 100, "said": []}
        results = {hard.name_of("kitti07", "none", 0): plain, hard.name_of("kitti07", "noise", 10): plain,
                   hard.name_of("kitti07", "walkers", 40): wrong | {"said": ["60 % of what frames ..."]}}
        self.assertEqual(hard.misses(results), [])
        results[hard.name_of("kitti07", "walkers", 40)] = wrong
        results[hard.name_of("kitti07", "noise", 10)] = wrong | {"said": ["a word"]}
        self.assertEqual(len(hard.misses(results)), 2)

    def test_waiting_for_a_start_is_no_word(self):
        errors = "warning: no start yet: too little\nframe 100, 50 posed\nwarning: track lost at frame 3: dark\n"
        self.assertEqual(hard.words_said(errors), ["track lost at frame 3: dark"])


@unittest.skipIf(not hard.python_with_numpy().exists(), "needs numpy and Pillow")
class Halves(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def test_no_pixel_is_in_both_and_each_in_one(self):
        def pixels(png, width, height):
            data = png[png.index(b"IDAT") + 4:png.index(b"IEND") - 8]
            rows = zlib.decompress(data)
            self.assertEqual(len(rows), height * (width + 1))
            return [rows[y * (width + 1) + 1:(y + 1) * (width + 1)] for y in range(height)]

        width, height = 150, 90  # not whole fields
        first, second = (pixels(halves.chessboard(width, height, i), width, height) for i in (True, False))
        self.assertTrue(all({a, b} == {0, 255} for one, other in zip(first, second) for a, b in zip(one, other)))
        self.assertEqual([first[0][0], first[0][63], first[0][64], first[64][0], first[64][64]], [255, 255, 0, 0, 255])

    def test_each_camera_of_a_rig_has_the_mask(self):
        (self.folder / "camera.yaml").write_text("cameras:\n  - name: a\n    resolution: [70, 66]\n  - name: b\n    resolution: [70, 66]\n")
        halves.write_masks(self.folder, self.folder)
        for half in (0, 1):
            text = (self.folder / f"half{half}.yaml").read_text()
            self.assertEqual(text.count(f"    mask: {self.folder}/half{half}.png\n"), 2)

    def test_covariances_are_doubled_and_times_are_not(self):
        (self.folder / "in.csv").write_text("# order\ntimestamp,c00\n1.5,0.25,-3e-5\n")
        halves.double(self.folder / "in.csv", self.folder / "out.csv")
        self.assertEqual((self.folder / "out.csv").read_text(), "# order\ntimestamp,c00\n1.5,0.5,-6e-05\n")


class Degrade(unittest.TestCase):
    def test_every_kind(self):
        import subprocess
        script = """
import sys; sys.path.insert(0, sys.argv[1])
import numpy, degrade
random = numpy.random.default_rng(0)
first = degrade.texture(random, 96, 128)
for kind, make in degrade.KINDS.items():
    change = make(20.0, random, 60, first)
    image = change.apply(36, first)
    assert image.shape == first.shape, kind
    assert (kind in ("none", "dropped", "blur-bursts")) == numpy.array_equal(image, first), kind
flat = numpy.full((20, 30), 7.0)
assert numpy.allclose(degrade.blurred(flat, 9, 0.4), flat)
edge = numpy.tile(numpy.where(numpy.arange(40) < 20, 0.0, 100.0), (4, 1))
assert numpy.allclose(degrade.shifted(edge, 0.25, 0)[0, 20], 75)
assert [f for f in range(50) if degrade.Dropped(10, random, 60, first).keeps(f)] == [0, 10, 20, 30, 40]
"""
        done = subprocess.run([str(hard.python_with_numpy()), "-c", script, str(ROOT / "scripts")], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)


if __name__ == "__main__":
    unittest.main()
