"""Plots of experiments, as SVG files that do not change from run to run.

An experiment asks for one with plot = { kind = ..., ... }:

    kind = "depth_quality"   AUC over the levels of each family
    kind = "scaling"         time and memory over x of the levels
    kind = "ablation"        loss of AUC against the reference, per engine

The overview has two more, of real photos and of where depth decides.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("svg")
import numpy as np
from matplotlib import pyplot

from .statistics import (
    auc_at,
    paired_difference,
    scene_means,
    summarize,
    variant_means,
    variant_of,
)
from .summary import NO_DEPTH, depth_groups, engines_of
from .tables import finest_auc, fit_exponent, main_threshold, of_engine

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


def plot_experiment(result: dict, path: Path) -> None:
    """Writes the plot that an experiment asks for."""
    functions = {
        "depth_quality": _plot_depth_quality,
        "scaling": _plot_scaling,
        "ablation": _plot_ablation,
    }
    _write(functions[result["plot"]["kind"]], path, result)


def plot_accuracy(result: dict, path: Path) -> None:
    """Writes the AUC of all engines on each scene, at the smallest threshold
    that its truth bears."""
    _write(_plot_accuracy, path, result)


def plot_depth_gain(name: str, result: dict, path: Path) -> None:
    """Writes what depth adds to none, over what makes scenes hard."""
    _write(_plot_depth_gain, path, name, result)


def _write(function, path, *arguments):
    with matplotlib.rc_context(_STYLE):
        figure = function(*arguments)
        figure.savefig(path, metadata={"Date": None})
        pyplot.close(figure)


def _unique(values):
    return list(dict.fromkeys(values))


def _plot_accuracy(result):
    thresholds = result["thresholds_deg"]
    value = finest_auc(thresholds)
    records = [r for r in result["records"] if value(r) is not None]
    records = sorted(records, key=lambda r: r["role"])
    variants = _unique(map(variant_of, records))
    figure, axis = pyplot.subplots(figsize=(8, 0.32 * len(variants) + 1.2))
    engines = engines_of(result)
    for k, engine in enumerate(engines):
        means = variant_means(of_engine(records, engine), value)
        places = [i for i, v in enumerate(variants) if v in means]
        shift = 0.5 * (k / max(1, len(engines) - 1) - 0.5)
        axis.plot(
            [means[variants[i]] for i in places],
            [i + shift for i in places],
            "osD^vP*"[k % 7],
            color=f"C{k}",
            markersize=5,
            label=engine,
        )
    labels = [_accuracy_label(v, records, thresholds) for v in variants]
    axis.set_yticks(range(len(variants)), labels)
    axis.invert_yaxis()
    axis.set_xlabel("AUC [%] at the smallest threshold that the truth bears")
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _accuracy_label(variant, records, thresholds):
    first = next(r for r in records if variant_of(r) == variant)
    borne = next(t for t in thresholds if t >= first["min_threshold_deg"])
    source = " (ALIKED)" if "ALIKED" in variant[0] else ""
    return f"{variant[1]}{source}, {first['role']}, AUC@{borne:g}"


def _plot_depth_gain(name, result):
    thresholds = result["thresholds_deg"]
    idx = main_threshold(thresholds)
    value = auc_at(thresholds, idx)
    groups = depth_groups(name, result["records"])
    with_depth = {r["engine"] for r in result["records"] if r["uses_depth"]}
    engines = [e for e in engines_of(result) if e in with_depth]
    figure, axis = pyplot.subplots(figsize=(8, 3.2))
    for k, engine in enumerate(engines):
        # The colour that the engine has in the plot of accuracy.
        color = f"C{engines_of(result).index(engine)}"
        for g, (_, records) in enumerate(groups):
            gains = _gains(records, engine, value)
            place = g + 0.5 * (k / max(1, len(engines) - 1) - 0.5)
            label = engine if g == 0 else None
            axis.plot([place] * len(gains), gains, ".", color=color, alpha=0.5)
            mean = np.mean(gains) if gains else np.nan
            style = {"markersize": 14, "markeredgewidth": 2, "color": color}
            axis.plot([place], [mean], "_", label=label, **style)
    axis.axhline(0, color="black", linewidth=0.8)
    labels = [label.replace(", ", ",\n") for label, _ in groups]
    axis.set_xticks(range(len(groups)), labels, rotation=30, ha="right")
    axis.set_ylabel(f"change of AUC@{thresholds[idx]:g} [points]")
    axis.set_title("against no depth; a dot a scene, a dash their mean")
    figure.legend(loc="outside upper center", ncols=4)
    return figure


def _gains(records, engine, value):
    own = scene_means(of_engine(records, NO_DEPTH), value)
    other = scene_means(of_engine(records, engine), value)
    return [other[s] - own[s] for s in own if s in other]


def _plot_depth_quality(result):
    records = result["records"]
    families = _unique(r["parameters"]["family"] for r in records)
    levels = _levels(result)
    engines = engines_of(result)
    idx = main_threshold(result["thresholds_deg"])
    value = auc_at(result["thresholds_deg"], idx)
    num_columns = min(4, len(families))
    num_rows = -(-len(families) // num_columns)
    figure, axes = pyplot.subplots(
        num_rows,
        num_columns,
        figsize=(2.6 * num_columns, 2.3 * num_rows + 0.5),
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for axis, family in zip(axes.flat, families):
        for k, engine in enumerate(engines):
            runs = [
                r
                for r in of_engine(records, engine)
                if r["parameters"]["family"] == family
            ]
            _plot_levels(axis, levels, runs, engine, f"C{k}", value)
        axis.set_title(family)
    for axis in axes.flat[len(families) :]:
        axis.axis("off")
    for axis in axes[:, 0]:
        axis.set_ylabel(f"AUC@{result['thresholds_deg'][idx]:g} [%]")
    for axis in axes.flat:
        axis.set_xticks(range(len(levels)), levels, rotation=60, ha="right")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(engines)
    )
    return figure


def _levels(result):
    return [
        level["name"]
        for dataset in result["datasets"]
        for level in dataset.get("level", [])
    ]


def _plot_levels(axis, levels, runs, engine, color, value):
    if not runs:
        return
    if not runs[0].get("uses_depth"):
        mean = summarize(runs, value).mean
        axis.axhline(mean, color=color, linestyle="--", label=engine)
        return
    means, spreads = [], []
    for level in levels:
        summary = summarize(
            (r for r in runs if r["parameters"]["level"] == level), value
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


def _plot_scaling(result):
    figure, axes = pyplot.subplots(1, 2, figsize=(8, 3.5))
    for axis, name, label in zip(
        axes, ("seconds", "peak_memory_mb"), ("time [s]", "memory [MB]")
    ):
        for k, engine in enumerate(engines_of(result)):
            values: dict[float, list[float]] = {}
            for r in of_engine(result["records"], engine):
                if name in r:
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


def _plot_ablation(result):
    """Mean changes and intervals over scenes; the dots are scenes."""
    idx = main_threshold(result["thresholds_deg"])
    value = auc_at(result["thresholds_deg"], idx)
    reference = scene_means(
        of_engine(result["records"], result["reference"]), value
    )
    names = []
    figure, axis = pyplot.subplots()
    for engine in engines_of(result):
        values = scene_means(of_engine(result["records"], engine), value)
        common = sorted(set(values) & set(reference))
        if engine == result["reference"] or not common:
            continue
        difference = paired_difference(reference, values)
        place = len(names)
        names.append(engine)
        low, high = np.nan_to_num([difference.low, difference.high])
        axis.barh(place, difference.mean, color="C0", alpha=0.6)
        axis.hlines(place, low, high, color="black")
        changes = [values[s] - reference[s] for s in common]
        axis.plot(changes, [place] * len(changes), ".", color="C1")
    figure.set_size_inches(7, 0.3 * len(names) + 1)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.set_xlabel(
        f"change of AUC@{result['thresholds_deg'][idx]:g} against "
        f"“{result['reference']}” [points]"
    )
    return figure
