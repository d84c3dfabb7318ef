"""The page of results in docs/, from the records of runs.

docs/results/runs.json holds what the page shows; docs/results.md and the
plots beside it are made from nothing else.
"""

from __future__ import annotations

import json
from pathlib import Path

from . import compare, plots, tables
from .errors import BenchmarkError
from .experiment import PROJECT, Experiment, read_experiment
from .files import write_json
from .statistics import Record

RUNS = PROJECT / "docs" / "results" / "runs.json"
PAGE = PROJECT / "docs" / "results.md"
EXPERIMENTS = PROJECT / "benchmark" / "experiments"

_HEADER = """\
# Results

Written by the benchmark (`benchmark/README.md`) from
[results/runs.json](results/runs.json), which has every run with its options,
versions, figures and times.

- AUC@t: area under the recall of pairwise pose errors up to t degrees, in per
  cent; the error of a pair is the larger one of rotation and direction of
  translation, infinite if an image is missing; mean over scenes.
- COLMAP's AUC: as in COLMAP's own benchmark (ordered pairs, all models).
- repeatable AUC@1: without truth, of the poses from one half of the points
  against those from the other half, over the images of the largest model; mean
  over scenes; empty for engines that do not measure it.
- scale: what the model has to be multiplied with to fit the truth; 1 is
  metric.
- A run that fails counts as zero.
"""


def read_runs(path: Path = RUNS) -> dict[str, dict]:
    """Stored results by experiment; empty if there are none yet."""
    if not path.exists():
        return {}
    try:
        return json.loads(path.read_text())["experiments"]
    except (OSError, ValueError, KeyError) as error:
        raise BenchmarkError(f"'{path}' holds no runs: {error}") from error


def store_runs(results: dict[str, dict], path: Path = RUNS) -> None:
    """``results``: by experiment, a dict of date, command, machine, commit,
    engines and data sets with their options, and records."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"experiments": results})


def write_page() -> None:
    """Writes the page and its plots from what is stored."""
    sections = [_HEADER]
    for name, result in sorted(read_runs().items(), key=_place):
        experiment = read_experiment(EXPERIMENTS / f"{name}.toml")
        sections.append("\n".join(_section(experiment, result)))
    PAGE.write_text("\n".join(sections))


def _place(item: tuple[str, dict]) -> tuple[int, str]:
    name = item[0]
    order = ["real_photos", "speed", "depth_quality", "ablation", "scaling"]
    return (order.index(name) if name in order else len(order), name)


def _section(experiment: Experiment, result: dict) -> list[str]:
    records = result["records"]
    seeds = ", ".join(map(str, experiment.seeds))
    lines = [
        f"## {experiment.title}",
        "",
        f"{result['date']}, `{result['command']}`, {result['machine']}, "
        f"{result['jobs']} runs at a time with {experiment.threads} thread(s) "
        f"each, seeds {seeds}.",
        "",
    ]
    if experiment.text:
        lines += [experiment.text, ""]
    if experiment.plot:
        plot = RUNS.parent / f"{experiment.name}.svg"
        plots.plot_experiment(experiment, records, plot)
        lines += [f"![{experiment.title}](results/{plot.name})", ""]
        lines += _plot_notes(experiment, records)
    for dataset in dict.fromkeys(d["name"] for d in experiment.datasets):
        lines += _dataset_tables(
            experiment, [r for r in records if r["dataset"] == dataset], dataset
        )
    return lines


def _dataset_tables(experiment, records: list[Record], dataset) -> list[str]:
    if not records:
        return []
    thresholds = experiment.thresholds_deg
    engines = [
        spec["name"]
        for spec in experiment.engines
        if any(r["engine"] == spec["name"] for r in records)
    ]
    lines = [f"### {dataset}", ""]
    # A sweep's mean over all levels says nothing.
    if not experiment.plot or experiment.plot["kind"] == "ablation":
        lines += [*tables.summary_table(records, engines, thresholds), ""]
    lines += [*tables.scene_table(records, engines, thresholds), ""]
    points = tables.point_table(records, engines)
    if points:
        lines += [
            "Points against laser scans: share of points, and of the scan, "
            "with a neighbour within 1, 2 and 5 cm.",
            "",
            *points,
            "",
        ]
    if experiment.reference and not experiment.plot:
        lines += [
            *tables.ratio_table(records, engines, experiment.reference),
            "",
        ]
    return lines + [
        "Time and peak memory, medians over seeds (they differ from run to "
        "run, unlike all else here):",
        "",
        *tables.resource_table(records, engines),
        "",
    ]


def _plot_notes(experiment: Experiment, records: list[Record]) -> list[str]:
    idx = len(experiment.thresholds_deg) - 1
    threshold = f"AUC@{experiment.thresholds_deg[idx]:g}"
    if experiment.plot["kind"] == "depth_quality":
        lines = []
        for reference in experiment.plot["references"]:
            lines += [
                f"Where depth makes {threshold} worse than “{reference}”, by "
                f"more than {tables.MIN_LOSS} (mean over seeds):",
                "",
            ]
            rows = [
                [engine, family, level, f"{loss:+.1f}", verdict]
                for engine, family, level, loss, verdict in tables.losses(
                    records, reference, idx
                )
            ]
            header = ["engine", "family", "depth", threshold, "verdict"]
            lines += tables.markdown(header, rows) if rows else ["Nowhere."]
            lines.append("")
        return lines
    if experiment.plot["kind"] == "ablation":
        return _ablation_table(experiment, records)
    if experiment.plot["kind"] == "scaling":
        return _scaling_tables(experiment, records)
    return []


def _scaling_tables(experiment, records):
    lines = []
    for spec in experiment.engines:
        runs = [r for r in records if r["engine"] == spec["name"]]
        table = tables.scaling_table(runs) if spec.get("verify_first") else []
        if table:
            lines += [
                f"“{spec['name']}”: processor time of all threads and peak "
                "memory by stage, medians over seeds, and the exponents fitted "
                "to them:",
                "",
                *table,
                "",
            ]
    return lines


def _ablation_table(experiment, records):
    reference = [r for r in records if r["engine"] == experiment.reference]
    lines = []
    for spec in experiment.engines:
        if spec["name"] == experiment.reference:
            continue
        variant = [r for r in records if r["engine"] == spec["name"]]
        rows = compare.compare(
            reference, variant, experiment.thresholds_deg, by_engine=False
        )
        # The header once; an empty first column is the engine's.
        lines += rows[:2] if not lines else []
        lines += [
            row.replace("|  |", f"| {spec['name']} |", 1) for row in rows[2:]
        ]
    return [
        f"A: “{experiment.reference}”, B: the engine of the row.",
        "",
        *lines,
        "",
    ]
