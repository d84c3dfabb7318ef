"""Statistics with the scene as the unit."""

import unittest

import support  # noqa: F401
import numpy as np
from dgsfm_benchmark import statistics


def run(scene, seed, auc, **values):
    return {
        "dataset": "test",
        "scene": scene,
        "seed": seed,
        "metrics": {"auc": [auc]},
        **values,
    }


def value(record):
    return statistics.auc(record, 0)


class SceneTest(unittest.TestCase):
    def test_seeds_of_a_scene_are_one_scene(self):
        changes = {"a": 1.0, "b": 2.0, "c": 4.0, "d": -1.0, "e": 3.0}
        before = [run(s, 0, 50) for s in changes]
        after = [run(s, 0, 50 + c) for s, c in changes.items()]
        one = statistics.run_difference(before, after, value)
        three = statistics.run_difference(
            [run(s, k, 50) for s in changes for k in range(3)],
            [
                run(s, k, 50 + c + (k - 1))
                for s, c in changes.items()
                for k in range(3)
            ],
            value,
        )
        self.assertEqual(one.num_scenes, 5)
        self.assertEqual(three.num_scenes, 5)
        self.assertEqual(
            (one.mean, one.low, one.high, one.sign_p),
            (three.mean, three.low, three.high, three.sign_p),
        )
        # What seeds differ by is told apart.
        self.assertTrue(np.isnan(one.stddev))
        self.assertAlmostEqual(three.stddev, 1)

    def test_subsets_of_a_scene_are_one_scene(self):
        names = ["castle", "castle/2", "castle, two ends", "door"]
        difference = statistics.run_difference(
            [run(name, 0, 10) for name in names],
            [run(name, 0, 10 + i) for i, name in enumerate(names)],
            value,
        )
        self.assertEqual(difference.num_scenes, 2)
        self.assertEqual(difference.mean, (1 + 3) / 2)

    def test_runs_are_paired_by_seed(self):
        difference = statistics.run_difference(
            [run("a", 0, 10), run("a", 1, 90)],
            [run("a", 0, 12), run("b", 0, 99)],
            value,
        )
        self.assertEqual((difference.num_scenes, difference.mean), (1, 2))
        with self.assertRaises(ValueError):
            statistics.run_difference([run("a", 0, 1)], [], value)

    def test_summary_has_mean_worst_case_and_reproducibility(self):
        runs = [run("a", s, 20 + s) for s in (-1, 1)]
        runs += [run("b", s, 40 + 3 * s) for s in (-1, 1)]
        summary = statistics.summarize(runs, value)
        self.assertEqual((summary.mean, summary.num_scenes), (30, 2))
        self.assertEqual((summary.worst, summary.worst_scene), (20, "a"))
        # Variances over seeds 2 and 18.
        self.assertAlmostEqual(summary.stddev, np.sqrt(10))
        self.assertEqual(summary.text(), "30.0")
        self.assertEqual(summary.text_of_worst(), "20.0 (a)")
        self.assertEqual(summary.text_with_spread(), "30.0 ± 3.2")


class TestsTest(unittest.TestCase):
    def difference(self, changes):
        a = {str(i): 0.0 for i in range(len(changes))}
        b = {str(i): change for i, change in enumerate(changes)}
        return statistics.paired_difference(a, b)

    def test_sign_test_is_exact(self):
        for changes, p in (
            ([1.0] * 5, 2 / 2**5),
            ([1.0] * 6, 2 / 2**6),
            # 2 (1 + 8) / 2^8.
            ([1.0] * 7 + [-1.0], 18 / 256),
            # Without a difference: no sign.
            ([1.0] * 6 + [0.0] * 9, 2 / 2**6),
            ([0.0, 0.0], 1.0),
        ):
            self.assertAlmostEqual(self.difference(changes).sign_p, p)

    def test_bootstrap_has_known_answers(self):
        # Two scenes: means 0, 1 and 2 with probabilities 1/4, 1/2 and 1/4.
        self.assertEqual(
            statistics.bootstrap_interval(np.array([0.0, 2.0])), (0.0, 2.0)
        )
        equal = statistics.bootstrap_interval(np.array([1.5] * 4))
        self.assertEqual(equal, (1.5, 1.5))
        # Many scenes: that of a normal distribution.
        values = np.random.default_rng(1).normal(3, 1, 400)
        low, high = statistics.bootstrap_interval(values)
        error = values.std() / 20
        self.assertAlmostEqual(low, values.mean() - 1.96 * error, delta=0.01)
        self.assertAlmostEqual(high, values.mean() + 1.96 * error, delta=0.01)
        # The same each time.
        self.assertEqual(
            statistics.bootstrap_interval(values), (low, high)
        )

    def test_verdict_names_its_tests_and_scenes(self):
        self.assertEqual(
            self.difference([1.0, 2.0, 3.0, 1.0, 2.0, 3.0]).verdict(),
            "higher (bootstrap and sign test p = 0.031, 6 scenes)",
        )
        self.assertEqual(
            self.difference([-1.0] * 6).verdict(),
            "lower (bootstrap and sign test p = 0.031, 6 scenes)",
        )
        self.assertEqual(
            self.difference([1.0] * 5).verdict(),
            "no difference shown (bootstrap alone, sign test p = 0.062, "
            "5 scenes)",
        )
        self.assertEqual(
            self.difference([1.0, -1.0]).verdict(),
            "no difference shown (sign test p = 1, 2 scenes)",
        )
        self.assertEqual(
            self.difference([1.0]).verdict(),
            "no difference shown (sign test p = 1, 1 scene)",
        )


class NoiseTest(unittest.TestCase):
    def changes(self, before, after):
        return {
            change.variant[1]: change
            for change in statistics.variant_changes(before, after, value, 0.1)
        }

    def test_noise_is_that_of_the_seeds_of_a_scene(self):
        seeds = range(3)
        before = [run("loud", s, 50 + 5 * s) for s in seeds]
        before += [run("quiet", s, 50 + 0.1 * s) for s in seeds]
        after = [{**r, "metrics": {"auc": [value(r) + 2]}} for r in before]
        changes = self.changes(before, after)
        # Student's t of 4 degrees of freedom: 2.776.
        self.assertAlmostEqual(
            changes["loud"].noise, 2.776 * np.sqrt(2 * 25 / 3), delta=1e-2
        )
        self.assertEqual(changes["loud"].sign, 0)
        self.assertEqual(changes["quiet"].sign, 1)

    def test_one_seed_has_the_noise_of_other_scenes(self):
        before = [run("a", s, 50 + s) for s in range(3)] + [run("b", 0, 50)]
        after = [run("a", s, 50 + s) for s in range(3)] + [run("b", 0, 47)]
        # Standard deviations of 1 on both sides.
        noise = self.changes(before, after)["b"].noise
        self.assertAlmostEqual(noise, 1.96 * np.sqrt(2), delta=1e-2)
        self.assertEqual(self.changes(before, after)["b"].sign, -1)

    def test_many_tests_have_wider_bounds(self):
        before = [run("a", s, 50 + s) for s in range(3)]
        noise = [
            statistics.variant_changes(before, before, value, 0.1, number)[0].noise
            for number in (1, 10)
        ]
        # Student's t of 4 degrees of freedom at 5 % and 0.5 %.
        self.assertAlmostEqual(noise[1] / noise[0], 5.598 / 2.776, delta=1e-2)

    def test_rounding_is_no_change(self):
        changes = self.changes([run("a", 0, 50)], [run("a", 0, 50.05)])
        self.assertEqual(changes["a"].sign, 0)


class ValueTest(unittest.TestCase):
    def test_failed_run_is_zero(self):
        self.assertEqual(statistics.auc({"metrics": {}}, 0), 0)
        self.assertEqual(statistics.auc({}, 0), 0)

    def test_auc_that_the_truth_does_not_bear_is_none(self):
        record = {"metrics": {"auc": [1, 5]}, "min_threshold_deg": 3}
        values = [statistics.auc_at([1, 5], i)(record) for i in (0, 1)]
        self.assertEqual(values, [None, 5])


if __name__ == "__main__":
    unittest.main()
