"""Plots of experiments, as SVG files that do not change from run to run.

An experiment asks for one with plot = { kind = ..., ... }:

    kind = "depth_quality"   AUC over the levels of each family
    kind = "scaling"         time and memory over x of the levels
    kind = "ablation"        loss of AUC against the reference, per engine
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import numpy as np
from matplotlib import pyplot

from .experiment import Experiment
from .statistics import Record, auc, paired_difference, summarize
from .tables import fit_exponent

_STYLE = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 9,
    "grid.alpha": 0.3,
    "svg.hashsalt": "dgsfm",
    "svg.fonttype": "none",
}


def plot_experiment(
    experiment: Experiment, records: list[Record], path: Path
) -> None:
    """Writes the experiment's plot."""
    functions = {
        "depth_quality": _plot_depth_quality,
        "scaling": _plot_scaling,
        "ablation": _plot_ablation,
    }
    with matplotlib.rc_context(_STYLE):
        figure = functions[experiment.plot["kind"]](experiment, records)
        figure.savefig(path, metadata={"Date": None})
        pyplot.close(figure)


def _unique(values):
    return list(dict.fromkeys(values))


def _plot_depth_quality(experiment, records):
    families = _unique(r["parameters"]["family"] for r in records)
    levels = _levels(experiment)
    engines = [spec["name"] for spec in experiment.engines]
    idx = len(experiment.thresholds_deg) - 1
    num_columns = min(3, len(families))
    num_rows = -(-len(families) // num_columns)
    figure, axes = pyplot.subplots(
        num_rows,
        num_columns,
        figsize=(3.2 * num_columns, 2.5 * num_rows + 0.5),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for axis, family in zip(axes.flat, families):
        for k, engine in enumerate(engines):
            runs = [
                r
                for r in records
                if r["engine"] == engine
                and r["parameters"]["family"] == family
            ]
            _plot_levels(axis, levels, runs, engine, f"C{k}", idx)
        axis.set_title(family)
    for axis in axes.flat[len(families) :]:
        axis.axis("off")
    for axis in axes[:, 0]:
        axis.set_ylabel(f"AUC@{experiment.thresholds_deg[idx]:g} [%]")
    for axis in axes.flat:
        axis.set_xticks(range(len(levels)), levels, rotation=60, ha="right")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(engines)
    )
    return figure


def _levels(experiment):
    return [
        level["name"]
        for dataset in experiment.datasets
        for level in dataset.get("level", [])
    ]


def _plot_levels(axis, levels, runs, engine, color, idx):
    if not runs:
        return
    if not runs[0].get("uses_depth"):
        mean = summarize(runs, lambda r: auc(r, idx)).mean
        axis.axhline(mean, color=color, linestyle="--", label=engine)
        return
    means, spreads = [], []
    for level in levels:
        summary = summarize(
            (r for r in runs if r["parameters"]["level"] == level),
            lambda r: auc(r, idx),
        )
        means.append(summary.mean)
        spreads.append(summary.stddev)
    axis.errorbar(
        range(len(levels)),
        means,
        np.nan_to_num(spreads),
        color=color,
        marker="o",
        markersize=3,
        capsize=2,
        label=engine,
    )


def _plot_scaling(experiment, records):
    figure, axes = pyplot.subplots(1, 2, figsize=(8, 3.5))
    engines = [spec["name"] for spec in experiment.engines]
    for axis, name, label in zip(
        axes, ("seconds", "peak_memory_mb"), ("time [s]", "memory [MB]")
    ):
        for k, engine in enumerate(engines):
            values: dict[float, list[float]] = {}
            for r in records:
                if r["engine"] == engine and name in r:
                    values.setdefault(r["parameters"]["x"], []).append(r[name])
            if not values:
                continue
            x = sorted(values)
            y = [float(np.median(values[value])) for value in x]
            text = engine
            if len(x) > 1:
                text += f" (exponent {fit_exponent(x, y):.2f})"
            axis.loglog(x, y, "o-", color=f"C{k}", markersize=4, label=text)
        axis.set_xlabel("images")
        axis.set_ylabel(label)
        axis.legend()
    return figure


def _plot_ablation(experiment, records):
    idx = len(experiment.thresholds_deg) - 1
    reference = _values(records, experiment.reference, idx)
    names, means, widths = [], [], []
    for spec in experiment.engines:
        if spec["name"] == experiment.reference:
            continue
        values = _values(records, spec["name"], idx)
        # Results may be older than the row.
        if not values.keys() & reference.keys():
            continue
        difference = paired_difference(reference, values)
        names.append(spec["name"])
        means.append(difference.mean)
        widths.append(np.nan_to_num(difference.half_width))
    figure, axis = pyplot.subplots(figsize=(7, 0.3 * len(names) + 1))
    axis.barh(range(len(names)), means, xerr=widths, capsize=2)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlabel(
        f"change of AUC@{experiment.thresholds_deg[idx]:g} against "
        f"“{experiment.reference}” [points]"
    )
    return figure


def _values(records, engine, idx):
    return {
        (r["dataset"], r["scene"], r["seed"]): auc(r, idx)
        for r in records
        if r["engine"] == engine
    }
