"""Comparison, tables, plots and pages of made-up runs."""

import tempfile
import unittest
from pathlib import Path

import support
import numpy as np
from dgsfm_benchmark import blocks, compare, page, plots, storage, tables
from dgsfm_benchmark.errors import BenchmarkError


DEPTHS = {"deep": "database", "emulated strong depth": "depth"}


def result(records, **values):
    """What is stored of an experiment with these runs."""
    names = dict.fromkeys(r["engine"] for r in records)
    return {
        "title": "Test",
        "date": "2026-01-02",
        "command": "scripts/benchmark.sh run test",
        "machine": "a machine",
        "commit": "0123456789ab",
        "jobs": 1,
        "seeds": [0, 1, 2],
        "threads": 1,
        "thresholds_deg": [1, 5],
        "reference": "plain",
        "plot": None,
        "engines": [
            {"name": name, "type": "dgsfm"}
            | ({"depth": DEPTHS[name]} if name in DEPTHS else {})
            for name in names
        ],
        "datasets": [
            {
                "name": "test",
                "layout": "synthetic",
                "level": [{"name": "exact"}, {"name": "useless"}],
            }
        ],
        "records": records,
        **values,
    }


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


class CompareTest(unittest.TestCase):
    def test_pairs_by_engine_scene_and_seed(self):
        before = sweep()
        after = [
            {**r, "metrics": {**r["metrics"], "auc": [50.0, 95.0]}}
            for r in before
        ]
        text = "\n".join(compare.compare(before, after, [1, 5]))
        # Two levels of one family are one scene, as are three seeds.
        self.assertIn("| deep | AUC@5 | 1 | 85.50 | 95.00 | +9.50 |", text)
        self.assertIn("| plain | AUC@5 | 1 |", text)
        self.assertIn("no difference shown (sign test p = 1, 1 scene)", text)
        with self.assertRaisesRegex(BenchmarkError, "in common"):
            compare.compare(before, [], [1, 5])


class PageTest(unittest.TestCase):
    def test_levels_are_compared_over_families(self):
        records = sweep()
        records += [
            {**r, "scene": r["scene"].replace("ring", "wall"),
             "parameters": {**r["parameters"], "family": "wall"}}
            for r in sweep()
        ]  # fmt: skip
        text = "\n".join(tables.level_table(records, "plain", [1, 5]))
        self.assertIn("| deep | exact | +10.0 | +10.0 to +10.0 | none |", text)
        self.assertIn("| deep | useless | -1.0 |", text)
        self.assertIn("| -1.0 (ring) | no difference shown (bootstrap", text)

    def test_tables_name_failed_runs(self):
        records = sweep()
        for r in records:
            if r["engine"] == "plain":
                r.update(status="failed", reason="no model", metrics={})
        engines = ["plain", "deep"]
        text = "\n".join(tables.scene_table(records, engines, [1, 5]))
        self.assertIn("| ring/exact | plain |  | no model |", text)
        self.assertIn("| 91.0 ± 1.0 |", text)
        text = "\n".join(tables.summary_table(records, engines, [1, 5]))
        self.assertIn("| plain | 0.0 | 0.0 | 0.0 | ± 0.0 |", text)
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
            self.assertEqual(deep["repeatable AUC@1"], "63.0")
        # A run that fails counts as zero, and a scene of such has no figures.
        for r in records:
            if r["engine"] == "deep" and (
                r["scene"] == "ring/useless" or r["seed"] == 0
            ):
                r.update(status="failed", reason="no model")
                r["metrics"].pop("repeatable_auc_1")
        self.assertEqual(
            [row["repeatable AUC@1"] for row in rows(tables.summary_table)],
            ["", "43.0"],  # of 0, 63 and 66
        )
        self.assertEqual(
            [row["repeatable AUC@1"] for row in rows(tables.scene_table)],
            ["", "43.0", ""],
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
        self.assertIn("Mean of 2 scenes (other, ring), run as 3 variants", text)
        self.assertNotIn("rare", text)
        self.assertNotIn("plain", text)
        text = "\n".join(
            tables.summary_table(records, ["plain", "deep"], [1, 5])
        )
        self.assertIn("Mean of 1 scene (ring).", text)
        self.assertIn("| plain | 40.0 | 80.0 | 80.0 |  | 100.0 % | none |", text)

    def test_plots_are_the_same_bytes_each_time(self):
        for kind in ("depth_quality", "scaling", "ablation"):
            with tempfile.TemporaryDirectory() as folder:
                paths = [Path(folder) / f"{i}.svg" for i in range(2)]
                for path in paths:
                    plots.plot_experiment(
                        result(sweep(), plot={"kind": kind}), path
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


def joined(lines):
    """Lines as one, however they are wrapped."""
    return " ".join(" ".join(lines).split())


def real(engine, scene, seed, auc, **values):
    """A run on a real scene, with what a runner says of it."""
    made = record(engine, "exact", seed, auc)
    made.update(
        dataset="photos",
        scene=scene,
        parameters={},
        depth={"plain": "none", "deep": "depth"}.get(engine, "none"),
        role="fit",
        min_threshold_deg=0,
        is_metric=True,
        thresholds_deg=[1, 5],
    )
    return {**made, **values}


class AblationTest(unittest.TestCase):
    """One switch that is worth something, one that costs, one for nothing."""

    def setUp(self):
        self.records = []
        for scene in "abc":
            for seed in range(3):
                jitter = 0.5 * seed
                for engine, change in (
                    ("plain", 0),
                    ("no stage", -20 if scene == "a" else 10),
                    ("no use", 0.1 - 0.1 * seed),
                ):
                    self.records.append(
                        real(engine, scene, seed, 80 + jitter + change)
                    )

    def table(self):
        lines = tables.ablation_table(
            self.records, ["no stage", "no use", "not run"], "plain", [1, 5]
        )
        header, _, *rows = [
            [cell.strip() for cell in line.split("|")[1:-1]] for line in lines
        ]
        return {row[0]: dict(zip(header, row)) for row in rows}

    def test_has_mean_and_worst_case_and_worth(self):
        rows = self.table()
        self.assertEqual(set(rows), {"plain", "no stage", "no use"})
        row = rows["no stage"]
        self.assertEqual(row["mean AUC@5"], "80.5")
        self.assertEqual(row["worst AUC@5"], "60.5 (a)")
        self.assertEqual(row["change of AUC@5"], "+0.0")
        self.assertEqual(row["largest loss, finest AUC"], "-10.0 (a)")
        self.assertEqual(row["worth: better / worse / all"], "1 / 2 / 3")
        self.assertEqual(
            rows["no use"]["worth: better / worse / all"], "0 / 0 / 3"
        )

    def test_lists_what_is_worth_nothing(self):
        switches = ["no stage", "no use"]
        self.assertEqual(
            tables.worthless(self.records, switches, "plain", [1, 5]),
            ["no use"],
        )
        self.assertEqual(
            tables.worthless(
                self.records, switches, "plain", [1, 5], together=True
            ),
            ["no use"],
        )
        text = "\n".join(
            tables.ablation_changes(self.records, switches, "plain", [1, 5])
        )
        self.assertIn("| no stage | a -10.0; b +5.0; c +5.0 |", text)
        self.assertIn("| no use | none |", text)

    def test_page_has_roles_and_depth_apart(self):
        for r in self.records:
            if r["scene"] == "c":
                r.update(role="report", depth="depth_sensor")
        made = result(self.records, plot={"kind": "ablation"})
        text = page.render({"ablation": made})[page.RUNS / "ablation.md"]
        for title in tables.ROLE_TITLES.values():
            self.assertIn(f"## {title}", text)
        self.assertIn("- sensor depth: c", text)
        self.assertIn("- no use", text)


class OverviewTest(unittest.TestCase):
    def results(self):
        records = []
        for scene, role in (("a", "fit"), ("b", "report"), ("c", "report")):
            for seed in range(2):
                for engine, auc, depth in (
                    ("no depth", 80, "none"),
                    ("emulated strong depth", 90, "depth"),
                    ("sensor depth", 85, "depth_sensor"),
                    ("COLMAP global", 70, "none"),
                    ("COLMAP, expert settings", 78, "none"),
                ):
                    if engine == "sensor depth" and scene != "c":
                        continue
                    run = real(engine, scene, seed, auc)
                    run.update(role=role, depth=depth)
                    run["uses_depth"] = depth != "none"
                    if run["uses_depth"]:
                        run["metrics"]["scale_error"] = 0.02
                    records.append(run)
        for run in records:
            if run["scene"] == "b":
                run["min_threshold_deg"] = 5
        return {"real_photos": result(records, reference=None)}

    def test_roles_are_beside_each_other(self):
        lines = page.BLOCKS["overview"](self.results())
        header, _, *rows = [
            [cell.strip() for cell in line.split("|")[1:-1]] for line in lines
        ]
        rows = {row[0]: dict(zip(header, row)) for row in rows}
        strong = rows["emulated strong depth"]
        self.assertEqual(strong["fit: AUC@1 (n = 1)"], "45.0")
        self.assertEqual(strong["report: AUC@1 (n = 1)"], "45.0")  # not of b
        self.assertEqual(strong["report: AUC@5 (n = 2)"], "90.0")
        self.assertEqual(strong["report: scale error"], "2.0 %")
        self.assertEqual(
            rows["sensor depth"]["report: AUC@5 (n = 2)"],
            "no depth +5.0 on 1 scene",
        )

    def test_sentences_have_figures(self):
        text = joined(page.BLOCKS["sentences"](self.results()))
        self.assertIn("on 1 scene of role “fit” 80.0 (no depth)", text)
        self.assertIn("against COLMAP's global mapper +5.0", text)
        self.assertIn("expert settings give COLMAP +4.0", text)
        self.assertIn("emulated strong depth +10.0 on full sets (3)", text)
        self.assertIn("2.0 % with emulated strong depth", text)
        self.assertNotIn("Time", text)  # no runs
        self.assertEqual(page.BLOCKS["sentences"]({}), [])

    def test_readme_says_what_is_emulated(self):
        text = joined(page.BLOCKS["readme"](self.results()))
        self.assertIn("is made from ground truth", text)
        self.assertIn("“COLMAP, expert settings” is", text)
        self.assertIn("| a | fit | 45.0 / 90.0 | | 40.0 / 80.0 |", text)
        self.assertIn("| b | report | - / 90.0 |", text)

    def test_page_of_an_experiment_is_complete(self):
        texts = page.render(self.results())
        text = texts[page.RUNS / "real_photos.md"]
        self.assertIn("## photos, fit", text)
        self.assertIn("| COLMAP global | COLMAP, expert settings | AUC@5 |", text)
        self.assertIn("| sensor depth | sensor depth | report | 1 |", text)
        self.assertIn("not measured", texts[page.RUNS / "paper.md"])

    def test_little_to_go_on(self):
        """Scenes on which depth decides are told by what makes them hard."""
        records = []
        for seed in range(2):
            for engine, auc in (
                ("no depth", 60), ("emulated strong depth", 80),
            ):  # fmt: skip
                third = real(engine, "a/3", seed, auc)
                third["parameters"] = {"every": 3}
                third["uses_depth"] = engine != "no depth"
                few = real(engine, "ring/60 points", seed, auc - seed)
                few["parameters"] = {"family": "ring", "level": "60 points"}
                records += [third, few]
        results = {"depth_decides": result(records, reference=None)}
        text = joined(page.BLOCKS["sentences"](results))
        self.assertIn("+20.0 on every second to fourth image (1)", text)
        self.assertIn("+20.0 on synthetic scenes of little texture (1)", text)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "gain.svg"
            plots.plot_depth_gain(
                "depth_decides", results["depth_decides"], path
            )
            self.assertIn("every third image", path.read_text())


class BlocksTest(unittest.TestCase):
    TEXT = "before\n<!-- results:a -->\nold\n<!-- /results -->\nafter\n"

    def test_only_blocks_change(self):
        text = blocks.update_blocks(self.TEXT, {"a": ["1", "2"], "b": []})
        self.assertEqual(text, self.TEXT.replace("old", "1\n2"))
        self.assertEqual(blocks.read_blocks(text), {"a": "1\n2\n"})
        empty = blocks.update_blocks(self.TEXT, {"a": []})
        self.assertEqual(blocks.read_blocks(empty), {"a": ""})

    def test_faults_are_named(self):
        with self.assertRaisesRegex(BenchmarkError, "generates the block 'a'"):
            blocks.update_blocks(self.TEXT, {})
        with self.assertRaisesRegex(BenchmarkError, "not closed"):
            blocks.read_blocks(self.TEXT.replace("/results", "/result"))
        with self.assertRaisesRegex(BenchmarkError, "one name"):
            blocks.read_blocks(self.TEXT + self.TEXT)


class StorageTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)

    def store(self, *results):
        values = {f"made_{i}": r for i, r in enumerate(results)}
        storage.store_runs(values, self.path)
        return storage.read_runs(self.path)

    def test_one_line_per_run(self):
        self.store(result(sweep()))
        text = (self.path / "made_0.json").read_text()
        runs = text[text.index('"runs"') :]
        self.assertEqual(len([x for x in runs.splitlines() if "[[" in x]), 9)

    def test_reads_what_tables_need(self):
        records = sweep()
        records[1]["metrics"]["auc"] = [45.00123, 90.98765]
        records[2].update(status="failed", reason="no model", metrics={})
        found = self.store(result(records))["made_0"]
        self.assertEqual(found["commit"], "0123456789ab")
        by_key = {
            (r["scene"], r["engine"], r["seed"]): r for r in found["records"]
        }
        self.assertEqual(len(by_key), 9)
        deep = by_key["ring/exact", "deep", 0]
        self.assertEqual(deep["metrics"]["auc"], [45.0, 90.99])
        self.assertEqual(deep["metrics"]["num_images"], 10)
        self.assertEqual(deep["depth"], "database")
        self.assertTrue(deep["uses_depth"])
        self.assertEqual(deep["parameters"]["family"], "ring")
        self.assertFalse(by_key["ring/exact", "plain", 0]["uses_depth"])
        failed = by_key["ring/useless", "deep", 0]
        self.assertEqual(failed["status"], "failed")
        self.assertEqual(failed["reason"], "no model")

    def test_storing_again_changes_nothing(self):
        ablation = result(sweep(), plot={"kind": "ablation"})
        first = self.store(result(sweep()), ablation)
        texts = [p.read_bytes() for p in sorted(self.path.glob("*.json"))]
        self.store(*first.values())
        self.assertEqual(
            texts, [p.read_bytes() for p in sorted(self.path.glob("*.json"))]
        )

    def test_keeps_which_depth_a_scene_had(self):
        records = [real("deep", "a", 0, 80, depth="depth_sensor")]
        records.append(real("deep", "b", 0, 80, depth="depth"))
        made = result(records)
        made["engines"][0]["depth"] = ["depth", "depth_sensor", "none"]
        found = self.store(made)["made_0"]["records"]
        self.assertEqual(
            {r["scene"]: r["depth"] for r in found},
            {"a": "depth_sensor", "b": "depth"},
        )

    def test_emulated_depth_is_named_as_such(self):
        made = result([real("depth", "a", 0, 80)], reference="depth")
        made["engines"][0]["depth"] = "depth"
        made["datasets"] = [{"layout": "plain", "path": "../shared/data"}]
        found = storage.described("made", made)
        self.assertEqual(found["reference"], "emulated strong depth")
        self.assertEqual(found["records"][0]["engine"], "emulated strong depth")
        # A user's depth is not emulated.
        made["datasets"] = [{"layout": "eth3d", "path": "eth3d"}]
        found = storage.described("made", made)
        self.assertEqual(found["records"][0]["engine"], "depth")

    def test_a_file_holds_results_whole(self):
        path = self.path / "a.json"
        results = {"test": result(sweep())}
        storage.store_runs(results, path)
        self.assertEqual(storage.read_runs(path), results)
        self.assertEqual(storage.read_runs(self.path / "b.json"), {})
        path.write_text("{}")
        with self.assertRaisesRegex(BenchmarkError, "holds no runs"):
            storage.read_runs(path)


if __name__ == "__main__":
    unittest.main()
