"""Statistics, comparison, tables and plots of made-up runs."""

import tempfile
import unittest
from pathlib import Path

import support
import numpy as np
from dgsfm_benchmark import compare, plots, statistics, tables
from dgsfm_benchmark.errors import BenchmarkError
from dgsfm_benchmark.experiment import read_experiment

EXPERIMENT = """
seeds = [0, 1, 2]
thresholds_deg = [1, 5]
reference = "plain"
plot = {{ kind = "{kind}", references = ["plain"] }}
[[dataset]]
name = "test"
layout = "synthetic"
[[dataset.level]]
name = "exact"
x = 10
[[dataset.level]]
name = "useless"
x = 100
[[engine]]
name = "plain"
type = "dgsfm"
[[engine]]
name = "deep"
type = "dgsfm"
depth = "database"
"""


def record(engine, level, seed, auc, **values):
    return {
        "dataset": "test",
        "scene": f"ring/{level}",
        "engine": engine,
        "seed": seed,
        "status": "ok",
        "reason": "",
        "uses_depth": engine == "deep",
        "parameters": {
            "family": "ring",
            "level": level,
            "x": {"exact": 10, "useless": 100}[level],
        },
        "seconds": {"exact": 2.0, "useless": 40.0}[level],
        "cpu_seconds": 1.0,
        "peak_memory_mb": {"exact": 50.0, "useless": 500.0}[level],
        "metrics": {
            "auc": [auc / 2, auc],
            "colmap_auc": [auc, auc, auc, auc],
            "num_images": 10,
            "num_registered": 10,
            "num_models": 1,
            "num_points": 100,
            "mean_track_length": 3.0,
            "scale": 1.01,
        },
        **values,
    }


def sweep():
    records = []
    for seed in range(3):
        records.append(record("plain", "exact", seed, 80 + seed))
        records.append(record("deep", "exact", seed, 90 + seed))
        records.append(record("deep", "useless", seed, 79 + seed))
    return records


class StatisticsTest(unittest.TestCase):
    def test_mean_over_scenes_and_spread_over_seeds(self):
        runs = [record("deep", "exact", s, 10 * s) for s in (1, 2)]
        runs += [record("deep", "useless", s, 30 * s) for s in (1, 2)]
        summary = statistics.summarize(
            runs, lambda r: statistics.auc(r, 1)
        )
        self.assertEqual(summary.mean, 30)  # of 20 and 40
        self.assertAlmostEqual(summary.stddev, np.sqrt(200))
        self.assertEqual(summary.text(), "30.0 ± 14.1")

    def test_verdict_only_beyond_noise(self):
        a = {(i,): float(i) for i in range(5)}
        differences = [1.0, 1.2, 0.8, 1.1, 0.9]
        b = {(i,): i + differences[i] for i in range(5)}
        difference = statistics.paired_difference(a, b)
        self.assertAlmostEqual(difference.mean, 1)
        self.assertAlmostEqual(difference.stddev, np.sqrt(0.1 / 4))
        # Student's t of 4 degrees of freedom: 2.776.
        self.assertAlmostEqual(
            difference.half_width, 2.776 * np.sqrt(0.025 / 5), delta=1e-3
        )
        self.assertEqual(difference.verdict(), "higher")
        b[(0,)] = -4.0
        self.assertEqual(
            statistics.paired_difference(a, b).verdict(), "within noise"
        )
        one = statistics.paired_difference({(0,): 1.0}, {(0,): 2.0})
        self.assertEqual(one.verdict(), "one pair: no verdict")
        with self.assertRaises(ValueError):
            statistics.paired_difference(a, {})

    def test_failed_run_is_zero(self):
        self.assertEqual(statistics.auc({"metrics": {}}, 0), 0)
        self.assertEqual(statistics.auc({}, 0), 0)


class CompareTest(unittest.TestCase):
    def test_pairs_by_engine_scene_and_seed(self):
        before = sweep()
        after = [
            {**r, "metrics": {**r["metrics"], "auc": [50.0, 95.0]}}
            for r in before
        ]
        text = "\n".join(compare.compare(before, after, [1, 5]))
        self.assertIn("| deep | AUC@5 | 6 | 85.50 | 95.00 | +9.50", text)
        self.assertIn("| plain | AUC@5 | 3 |", text)
        self.assertIn("| within noise |", text)  # times are the same
        with self.assertRaisesRegex(BenchmarkError, "in common"):
            compare.compare(before, [], [1, 5])


class PageTest(unittest.TestCase):
    def experiment(self, kind):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "test.toml"
            path.write_text(EXPERIMENT.format(kind=kind))
            return read_experiment(path)

    def test_lists_where_depth_makes_things_worse(self):
        self.assertEqual(
            tables.losses(sweep(), "plain", 1),
            [("deep", "ring", "useless", -1.0, "lower")],
        )

    def test_tables_name_failed_runs(self):
        records = sweep()
        for r in records:
            if r["engine"] == "plain":
                r.update(status="failed", reason="no model", metrics={})
        engines = ["plain", "deep"]
        text = "\n".join(tables.scene_table(records, engines, [1, 5]))
        self.assertIn("| ring/exact | plain | no model |", text)
        self.assertIn("| 91.0 ± 1.0 |", text)
        text = "\n".join(tables.summary_table(records, engines, [1, 5]))
        self.assertIn("| plain | 0.0 ± 0.0 | 0.0 ± 0.0 |", text)
        self.assertIn("3 / 3", text)

    def test_repeatability_has_a_column_where_an_engine_measured_it(self):
        records = sweep()
        engines = ["plain", "deep"]

        def rows(table):
            lines = table(records, engines, [1, 5])
            lines = [line for line in lines if line.startswith("|")]
            header, _, *body = [
                [cell.strip() for cell in line.split("|")[1:-1]]
                for line in lines
            ]
            for row in body:
                self.assertEqual(len(row), len(header))
            return [dict(zip(header, row)) for row in body]

        both = (tables.summary_table, tables.scene_table)
        for table in both:
            self.assertNotIn("repeatable AUC@1", rows(table)[0])
        for r in records:
            if r["engine"] == "deep":
                r["metrics"]["repeatable_auc_1"] = 60.0 + 3 * r["seed"]
        for table in both:
            plain, deep = rows(table)[:2]
            self.assertEqual(plain["repeatable AUC@1"], "")
            self.assertEqual(deep["repeatable AUC@1"], "63.0 ± 3.0")
        # A run that fails counts as zero, and a scene of such has no figures.
        for r in records:
            if r["engine"] == "deep" and (
                r["scene"] == "ring/useless" or r["seed"] == 0
            ):
                r.update(status="failed", reason="no model")
                r["metrics"].pop("repeatable_auc_1")
        self.assertEqual(
            [row["repeatable AUC@1"] for row in rows(tables.summary_table)],
            ["", "43.0 ± 37.3"],  # of 0, 63 and 66
        )
        self.assertEqual(
            [row["repeatable AUC@1"] for row in rows(tables.scene_table)],
            ["", "43.0 ± 37.3", ""],
        )

    def test_mean_is_over_common_scenes(self):
        records = [record("deep", level, 0, 90) for level in ("exact", "useless")]
        records.append(record("plain", "exact", 0, 80))
        rare = {**record("rare", "exact", 0, 10), "scene": "other"}
        more = [{**record("deep", "exact", 0, 90), "scene": "other"}]
        text = "\n".join(
            tables.summary_table(
                records + more + [rare], ["plain", "deep", "rare"], [1, 5]
            )
        )
        # Plain and rare ran on one of three scenes.
        self.assertIn("Mean of 3 scenes", text)
        self.assertNotIn("rare", text)
        self.assertNotIn("plain", text)
        text = "\n".join(
            tables.summary_table(records, ["plain", "deep"], [1, 5])
        )
        self.assertIn("Mean of 1 scenes (ring/exact)", text)
        self.assertIn("| plain | 40.0 | 80.0 | 100.0 % | none |", text)

    def test_plots_are_the_same_bytes_each_time(self):
        for kind in ("depth_quality", "scaling", "ablation"):
            with tempfile.TemporaryDirectory() as folder:
                paths = [Path(folder) / f"{i}.svg" for i in range(2)]
                for path in paths:
                    plots.plot_experiment(
                        self.experiment(kind), sweep(), path
                    )
                self.assertEqual(
                    paths[0].read_bytes(), paths[1].read_bytes(), kind
                )

    def test_fits_exponents(self):
        x = np.array([100, 300, 1000])
        self.assertAlmostEqual(tables.fit_exponent(x, 3 * x**1.15), 1.15)

    def test_ratios_are_of_medians(self):
        runs = [
            record(engine, "exact", seed, 90.0, seconds=seconds)
            for engine, times in {
                "deep": [1.0, 9.0, 2.0],
                "plain": [4.0, 8.0, 100.0],
            }.items()
            for seed, seconds in enumerate(times)
        ]
        table = tables.ratio_table(runs, ["deep", "plain"], "deep")
        self.assertEqual(table[2:], ["| ring/exact | plain | 0.25 | 1.00 | 1.00 |"])

    def test_scaling_table_separates_verification(self):
        def usage(cpu_seconds, peak_memory_mb):
            return {
                "seconds": 99.0,
                "cpu_seconds": cpu_seconds,
                "peak_memory_mb": peak_memory_mb,
            }

        records = [
            record(
                "deep",
                level,
                0,
                90,
                stages={
                    "verification": usage(1000.0 * factor, 10.0),
                    "positions": usage(1.0 * factor**2, 100.0 * factor),
                    "bundle": usage(2.0 * factor**2, 200.0 * factor),
                    "models": usage(0.01, 200.0 * factor),
                    "all after": usage(3.0 * factor**2, 200.0 * factor),
                },
            )
            for level, factor in (("exact", 1), ("useless", 10))
        ]
        text = "\n".join(tables.scaling_table(records))
        self.assertIn("| 10 images | 100 images |", text)
        self.assertIn("| verification | 1000.0 s, 10 MB |", text)
        self.assertIn(
            "| all after | 3.0 s, 200 MB | 300.0 s, 2000 MB | 2.00 | 1.00 |",
            text,
        )
        self.assertIn("| bundle | 2.0 s, 200 MB | 200.0 s, 2000 MB |", text)
        self.assertNotIn("models", text)


if __name__ == "__main__":
    unittest.main()
