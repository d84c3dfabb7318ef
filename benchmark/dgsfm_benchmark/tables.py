"""Tables of runs, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from . import compare
from .engines import MAPPING, VERIFICATION
from .statistics import (
    Record,
    Value,
    auc,
    auc_at,
    bears,
    paired_difference,
    repeatable_auc,
    scale_error,
    scene_means,
    scene_of,
    summarize,
    variant_changes,
    variant_of,
)
from .storage import DEPTH_TITLES

# AUC points below which a difference is rounding.
MIN_CHANGE = 0.1
# Times below which they are rounding.
_MIN_SECONDS = 0.1

ROLE_TITLES = {
    "fit": "Sets that constants may be fitted on",
    "report": "Sets that are only looked at",
}


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [
        "| " + " | ".join(header) + " |",
        "| " + " | ".join("---" for _ in header) + " |",
    ]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def _unique(values):
    return list(dict.fromkeys(values))


def _metric(name):
    return lambda record: record.get("metrics", {}).get(name)


def of_engine(records: Iterable[Record], engine: str) -> list[Record]:
    return [r for r in records if r["engine"] == engine]


def roles_of(records: Iterable[Record]) -> list[str]:
    """Roles that occur, those of fitted sets first."""
    found = {r.get("role", "report") for r in records}
    return [role for role in ROLE_TITLES if role in found]


def of_role(records: Iterable[Record], role: str) -> list[Record]:
    return [r for r in records if r.get("role", "report") == role]


def finest_auc(thresholds: Sequence[float]) -> Value:
    """The AUC at the smallest threshold that the truth of a scene bears."""

    def value(record):
        for i, threshold in enumerate(thresholds):
            if bears(record, threshold):
                return auc(record, i)
        return None

    return value


def main_threshold(thresholds: Sequence[float]) -> int:
    """Index of the threshold that is compared where there is room for one:
    five degrees, or the largest of a set with smaller ones."""
    fitting = [i for i, t in enumerate(thresholds) if t <= 5]
    return fitting[-1] if fitting else 0


class _RepeatabilityColumn:
    """Cells of a column that tables have only if an engine measured it; of
    such an engine, runs without a value count as zero."""

    def __init__(self, records: list[Record]):
        self._engines = {
            r["engine"] for r in records if repeatable_auc(r) is not None
        }

    def header(self) -> list[str]:
        return ["repeatable AUC@1"] if self._engines else []

    def cells(self, engine: str, runs: list[Record]) -> list[str]:
        if not self._engines:
            return []
        if engine not in self._engines:
            return [""]
        return [summarize(runs, lambda r: repeatable_auc(r) or 0.0).text()]


def common_records(
    records: list[Record], engines: Sequence[str]
) -> tuple[list[str], list[Record]]:
    """Engines that ran on half of the scenes at least, and the records of
    scenes that all of these ran on."""
    scenes = {
        engine: {variant_of(r) for r in of_engine(records, engine)}
        for engine in engines
    }
    num_scenes = len({variant_of(r) for r in records})
    engines = [e for e in engines if 2 * len(scenes[e]) >= num_scenes]
    if not engines:
        return [], []
    common = set.intersection(*(scenes[engine] for engine in engines))
    return engines, [
        r
        for r in records
        if r["engine"] in engines and variant_of(r) in common
    ]


def summary_table(
    records: list[Record], engines: Sequence[str], thresholds: Sequence[float]
) -> list[str]:
    """One row an engine: means over the scenes that all of them ran on.
    Engines with fewer than half of the scenes are left out."""
    engines, records = common_records(records, engines)
    if not records:
        return ["No scene is common to the engines."]
    idx = main_threshold(thresholds)
    repeatability = _RepeatabilityColumn(records)
    values = [auc_at(thresholds, i) for i in range(len(thresholds))]
    rows = []
    for engine in engines:
        runs = of_engine(records, engine)
        failed = [r for r in runs if r["status"] != "ok"]
        main = summarize(runs, values[idx])
        rows.append(
            [
                engine,
                *(summarize(runs, value).text() for value in values),
                main.text_of_worst(),
                "" if np.isnan(main.stddev) else f"± {main.stddev:.1f}",
                *repeatability.cells(engine, runs),
                f"{_registered_share(runs):.1f} %",
                f"{len(failed)} / {len(runs)}" if failed else "none",
            ]
        )
    header = [
        "engine",
        *(
            f"AUC@{t:g} (n = {summarize(records, value).num_scenes})"
            for t, value in zip(thresholds, values)
        ),
        f"worst AUC@{thresholds[idx]:g}",
        f"AUC@{thresholds[idx]:g} over seeds",
        *repeatability.header(),
        "registered",
        "failed runs",
    ]
    return [_scope(records), "", *markdown(header, rows)]


def _scope(records):
    names = sorted({scene_of(r) for r in records})
    variants = {variant_of(r) for r in records}
    text = f"Mean of {len(names)} scene{'s' if len(names) > 1 else ''}"
    if len(names) < 12:
        text += f" ({', '.join(names)})"
    if len(variants) > len(names):
        text += f", run as {len(variants)} variants"
    return text + "."


def _registered_share(runs):
    registered = sum(r.get("metrics", {}).get("num_registered", 0) for r in runs)
    total = sum(r.get("metrics", {}).get("num_images", 0) for r in runs)
    return 100 * registered / total if total else 0.0


def difference_table(
    records: list[Record],
    pairs: Sequence[tuple[str, str]],
    thresholds: Sequence[float],
) -> list[str]:
    """Paired differences over scenes of engines A and B; empty without any."""
    rows = []
    idx = main_threshold(thresholds)
    for a, b in pairs:
        for i in sorted({0, idx}):
            row = compare.difference_row(
                f"AUC@{thresholds[i]:g}",
                of_engine(records, a),
                of_engine(records, b),
                auc_at(thresholds, i),
            )
            if row is not None:
                rows.append([a, b, *row])
    header = ["A", "B", *compare.HEADER]
    header[4:6] = ["mean of A", "mean of B"]
    return markdown(header, rows) if rows else []


# Columns of scenes that results may lack: name, metric, text.
_OPTIONAL_COLUMNS = (
    ("COLMAP's AUC@1 / 5", "colmap_auc", lambda runs: _colmap_aucs(runs)),
    ("scale", "scale", lambda runs: _scale(runs)),
    (
        "points", "num_points",
        lambda runs: summarize(runs, _metric("num_points")).text(0),
    ),
    (
        "track length", "mean_track_length",
        lambda runs: summarize(runs, _metric("mean_track_length")).text(2),
    ),
)  # fmt: skip


def scene_table(
    records: list[Record], engines: Sequence[str], thresholds: Sequence[float]
) -> list[str]:
    """One row a scene and engine: means over seeds, ± what seeds differ by.
    Empty where the truth does not bear a figure."""
    repeatability = _RepeatabilityColumn(records)
    optional = [
        (title, text)
        for title, name, text in _OPTIONAL_COLUMNS
        if any(_metric(name)(r) is not None for r in records)
    ]
    header = [
        "scene", "engine", "depth", "registered", "models",
        *(f"AUC@{t:g}" for t in thresholds), *repeatability.header(),
        *(title for title, _ in optional),
    ]  # fmt: skip
    rows = []
    for variant in _unique(variant_of(r) for r in records):
        own = [r for r in records if variant_of(r) == variant]
        name = variant[1]
        for engine in engines:
            runs = of_engine(own, engine)
            if not runs:
                continue
            cells = _scene_cells(engine, runs, thresholds, repeatability)
            if runs_ok(runs):
                cells += [text(runs) for _, text in optional]
            blanks = [""] * (len(header) - 1 - len(cells))
            rows.append([name, *cells, *blanks])
            name = ""
    return markdown(header, rows)


def runs_ok(runs: list[Record]) -> bool:
    return any(r["status"] == "ok" for r in runs)


def _scene_cells(engine, runs, thresholds, repeatability):
    depth = DEPTH_TITLES.get(runs[0].get("depth", ""), "")
    if not runs_ok(runs):
        reasons = _unique(_short_reason(r["reason"]) for r in runs)
        return [engine, depth, "; ".join(reasons)]
    models = summarize(runs, _metric("num_models")).mean
    return [
        engine,
        depth,
        _registered(runs),
        f"{models:.3g}",
        *(
            summarize(runs, auc_at(thresholds, i)).text_with_spread()
            for i in range(len(thresholds))
        ),
        *repeatability.cells(engine, runs),
    ]


def _scale(runs):
    scale = summarize(runs, _metric("scale")).text(3)
    return scale if runs[0].get("is_metric", True) else ""


def _registered(runs):
    total = next(
        (n for n in map(_metric("num_images"), runs) if n is not None), 0
    )
    return f"{summarize(runs, _metric('num_registered')).mean:.4g} / {total}"


def _short_reason(reason):
    return reason if len(reason) < 60 else reason[:57] + "..."


def _colmap_aucs(runs):
    # COLMAP's thresholds are 0.5, 1, 5 and 10 degrees.
    texts = [
        summarize(runs, lambda r, i=i: _colmap_auc(r, i)).text()
        if bears(runs[0], threshold)
        else "-"
        for i, threshold in ((1, 1), (2, 5))
    ]
    return " / ".join(texts)


def _colmap_auc(record, idx):
    values = record.get("metrics", {}).get("colmap_auc")
    return values[idx] if values else 0.0


def _depth_label(record):
    kind = record.get("depth", "")
    # Levels of a sweep are kinds of their own.
    level = record.get("parameters", {}).get("level")
    label = DEPTH_TITLES.get(kind, kind)
    return f"{label}, {level}" if kind == "database" and level else label


def scale_table(records: list[Record], engines: Sequence[str]) -> list[str]:
    """Errors of the unit by kind of depth and role of the sets, medians and
    worst over scenes; empty if no run with depth has a true unit."""
    rows = []
    for role in roles_of(records):
        for engine in engines:
            runs = of_engine(of_role(records, role), engine)
            for kind in _unique(map(_depth_label, runs)):
                errors = scene_means(
                    [r for r in runs if _depth_label(r) == kind], scale_error
                )
                if errors:
                    worst = max(errors, key=errors.get)
                    rows.append(
                        [
                            engine,
                            kind,
                            role,
                            str(len(errors)),
                            f"{np.median(list(errors.values())):.1f} %",
                            f"{errors[worst]:.1f} % ({worst})",
                        ]
                    )
    header = [
        "engine", "depth", "role", "scenes", "median scale error", "worst",
    ]  # fmt: skip
    return markdown(header, rows) if rows else []


def ablation_table(
    records: list[Record],
    switches: Sequence[str],
    reference: str,
    thresholds: Sequence[float],
) -> list[str]:
    """One row a switch: mean and worst case over scenes, and on how many
    variants of them the reference is better or worse by more than seeds."""
    idx = main_threshold(thresholds)
    own = of_engine(records, reference)
    rows = [_ablation_row(reference, own, [], thresholds)]
    for switch in switches:
        runs = of_engine(records, switch)
        if {variant_of(r) for r in runs} & {variant_of(r) for r in own}:
            rows.append(_ablation_row(switch, runs, own, thresholds))
    header = [
        "switch",
        f"mean AUC@{thresholds[idx]:g}",
        f"worst AUC@{thresholds[idx]:g}",
        *(f"change of AUC@{thresholds[i]:g}" for i in sorted({0, idx})),
        "largest loss, finest AUC",
        "worth: better / worse / all",
        "change of scale error",
        "time",
        f"AUC@{thresholds[idx]:g}",
    ]
    return markdown(header, rows)


def _ablation_row(name, runs, reference, thresholds):
    idx = main_threshold(thresholds)
    main = summarize(runs, auc_at(thresholds, idx))
    row = [name, main.text(), main.text_of_worst()]
    if not reference:
        return row + [""] * (len({0, idx}) + 5)
    for i in sorted({0, idx}):
        means = [
            scene_means(side, auc_at(thresholds, i))
            for side in (reference, runs)
        ]
        row.append(
            f"{paired_difference(*means).mean:+.1f}"
            if set(means[0]) & set(means[1])
            else ""
        )
    changes = variant_changes(
        reference, runs, finest_auc(thresholds), MIN_CHANGE
    )
    worst = min(changes, key=lambda c: c.change)
    verdict = compare.difference_row(
        "", reference, runs, auc_at(thresholds, idx)
    )
    return row + [
        f"{worst.change:+.1f} ({worst.variant[1]})",
        f"{sum(c.sign < 0 for c in changes)} / "
        f"{sum(c.sign > 0 for c in changes)} / {len(changes)}",
        _scale_change(reference, runs),
        _time_ratio(reference, runs),
        verdict[-1] if verdict else "",
    ]


def _scale_change(reference, runs):
    means = [scene_means(side, scale_error) for side in (reference, runs)]
    if not set(means[0]) & set(means[1]):
        return ""
    return f"{paired_difference(*means).mean:+.1f} %"


def _time_ratio(reference, runs):
    """Geometric mean over scenes."""
    times = [
        scene_means(side, lambda r: r.get("seconds"))
        for side in (reference, runs)
    ]
    common = set(times[0]) & set(times[1])
    logs = [np.log(times[1][s] / times[0][s]) for s in sorted(common)]
    return f"x {np.exp(np.mean(logs)):.2f}" if logs else ""


def worthless(
    records: list[Record],
    switches: Sequence[str],
    reference: str,
    thresholds: Sequence[float],
    together: bool = False,
) -> list[str]:
    """Switches that change neither an AUC nor the unit of any variant by more
    than seeds do. ``together``: noise is bounded for all variants and figures
    at once, of which some exceed their own bounds by chance."""
    own = of_engine(records, reference)
    values = [auc_at(thresholds, i) for i in range(len(thresholds))]
    values.append(scale_error)
    num_variants = len({variant_of(r) for r in own})
    num_tests = len(values) * num_variants if together else 1
    found = []
    for switch in switches:
        runs = of_engine(records, switch)
        changes = [
            change
            for value in values
            for change in variant_changes(
                own, runs, value, MIN_CHANGE, num_tests
            )
        ]
        if changes and all(change.sign == 0 for change in changes):
            found.append(switch)
    return found


def ablation_changes(
    records: list[Record],
    switches: Sequence[str],
    reference: str,
    thresholds: Sequence[float],
) -> list[str]:
    """Changes of the finest AUC that the truth bears, one row a switch, those
    within noise left out."""
    own = of_engine(records, reference)
    value = finest_auc(thresholds)
    switches = [s for s in switches if of_engine(records, s)]
    changes = {
        (c.variant, switch): c
        for switch in switches
        for c in variant_changes(
            own, of_engine(records, switch), value, MIN_CHANGE
        )
    }
    rows = []
    for switch in switches:
        found = [c for (_, name), c in changes.items() if name == switch]
        found = sorted((c for c in found if c.sign), key=lambda c: c.change)
        rows.append(
            [
                switch,
                "; ".join(f"{c.variant[1]} {c.change:+.1f}" for c in found)
                or "none",
            ]
        )
    return markdown(["switch", "changes beyond the noise of seeds"], rows)


def resource_table(records: list[Record], engines: Sequence[str]) -> list[str]:
    """Seconds and memory of each scene and engine, medians over seeds."""
    rows = []
    for variant in _unique(variant_of(r) for r in records):
        row = [variant[1]]
        for engine in engines:
            runs = [
                r
                for r in records
                if variant_of(r) == variant
                and r["engine"] == engine
                and "seconds" in r
            ]
            if not runs:
                row.append("")
                continue
            seconds = np.median([r["seconds"] for r in runs])
            memory = [
                r["peak_memory_mb"] for r in runs if "peak_memory_mb" in r
            ]
            row.append(
                f"{seconds:.1f} s"
                + (f", {np.median(memory):.0f} MB" if memory else "")
            )
        rows.append(row)
    return markdown(["scene", *engines], rows)


def ratio_table(
    records: list[Record], engines: Sequence[str], reference: str
) -> list[str]:
    """Time and memory of the reference over those of the other engines, ratios
    of medians over seeds."""

    def median(scene, engine, key):
        values = [
            r[key]
            for r in records
            if r["scene"] == scene and r["engine"] == engine and key in r
        ]
        return np.median(values) if values else np.nan

    columns = {
        "wall time": "seconds",
        "processor time": "cpu_seconds",
        "peak memory": "peak_memory_mb",
    }
    rows = []
    for scene in _unique(r["scene"] for r in records):
        for engine in engines:
            if engine == reference:
                continue
            ratios = [
                median(scene, reference, key) / median(scene, engine, key)
                for key in columns.values()
            ]
            rows.append([scene, engine, *(f"{r:.2f}" for r in ratios)])
    return markdown(["scene", f"{reference} / ...", *columns], rows)


def fit_exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Slope of log y over log x, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def scaling_table(records: list[Record]) -> list[str]:
    """Stages of an engine that verifies first over x of the levels, the longest
    first, with the exponents of time and memory; none without two levels."""
    by_x: dict[float, list[Record]] = {}
    for record in records:
        # Results may be older than the separation of verification.
        if record["status"] == "ok" and VERIFICATION in record["stages"]:
            by_x.setdefault(record["parameters"]["x"], []).append(record)
    x = sorted(by_x)
    if len(x) < 2:
        return []

    def medians(stage, key):
        return [
            float(
                np.median(
                    [r["stages"].get(stage, {}).get(key, 0.0) for r in by_x[v]]
                )
            )
            for v in x
        ]

    totals = [VERIFICATION, MAPPING]
    times = {
        stage: medians(stage, "cpu_seconds")
        for stage in _unique(
            totals + [name for r in by_x[x[-1]] for name in r["stages"]]
        )
    }
    stages = sorted(
        (s for s in times if s not in totals and times[s][-1] >= _MIN_SECONDS),
        key=lambda s: -times[s][-1],
    )
    rows = []
    for stage in totals + stages:
        memory = medians(stage, "peak_memory_mb")
        rows.append(
            [stage]
            + [f"{s:.1f} s, {m:.0f} MB" for s, m in zip(times[stage], memory)]
            + [_exponent(x, times[stage], _MIN_SECONDS), _exponent(x, memory, 1)]
        )
    header = ["stage", *(f"{value:g} images" for value in x)]
    return markdown([*header, "exponent of time", "of memory"], rows)


def _exponent(x, y, min_value):
    # Of the values that are more than rounding.
    points = [(a, b) for a, b in zip(x, y) if b >= min_value]
    return f"{fit_exponent(*zip(*points)):.2f}" if len(points) > 1 else ""


def point_table(records: list[Record], engines: Sequence[str]) -> list[str]:
    """Accuracy and completeness against scans, means over scenes; empty
    without scans."""
    records = [r for r in records if "points" in r.get("metrics", {})]
    if not records:
        return []
    names = [
        f"{kind}_{tolerance}cm"
        for kind in ("accuracy", "completeness")
        for tolerance in (1, 2, 5)
    ]
    rows = []
    for engine in engines:
        runs = [r for r in records if r["engine"] == engine]
        for alignment in ("aligned", "metric"):
            rows.append(
                [engine, alignment]
                + [
                    summarize(
                        runs,
                        lambda r, a=alignment, n=name: (
                            r["metrics"]["points"].get(a, {}).get(n)
                        ),
                    ).text()
                    for name in names
                ]
            )
    header = ["engine", "scale"] + [name.replace("_", " ") for name in names]
    return markdown(header, rows)


def level_table(
    records: list[Record], reference: str, thresholds: Sequence[float]
) -> list[str]:
    """Levels of a depth-quality sweep against an engine without depth, over
    families: mean, largest loss, verdict."""
    idx = main_threshold(thresholds)
    rows = []
    # The reference ran on any level: they differ in depth only.
    own = _by_family(of_engine(records, reference), idx)
    engines = _unique(r["engine"] for r in records if r.get("uses_depth"))
    for engine in engines:
        runs = of_engine(records, engine)
        for level in _unique(r["parameters"]["level"] for r in runs):
            values = _by_family(
                [r for r in runs if r["parameters"]["level"] == level], idx
            )
            common = sorted(set(own) & set(values))
            if not common:
                continue
            difference = paired_difference(own, values)
            worst = min(common, key=lambda f: values[f] - own[f])
            loss = values[worst] - own[worst]
            rows.append(
                [
                    engine,
                    level,
                    f"{difference.mean:+.1f}",
                    difference.interval(1),
                    f"{loss:+.1f} ({worst})" if loss < -MIN_CHANGE else "none",
                    difference.verdict(),
                ]
            )
    header = [
        "engine", "depth", f"change of AUC@{thresholds[idx]:g}",
        "95 % interval", "largest loss", "verdict",
    ]  # fmt: skip
    return markdown(header, rows)


def _by_family(records, idx):
    return scene_means(records, lambda r: auc(r, idx))
