"""Tables of runs, in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .engines import MAPPING, VERIFICATION
from .statistics import (
    Record,
    auc,
    paired_difference,
    repeatable_auc,
    summarize,
)

# AUC points below which a difference is rounding, not a loss.
MIN_LOSS = 0.1
# Times below which they are rounding.
_MIN_SECONDS = 0.1


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


def summary_table(
    records: list[Record], engines: Sequence[str], thresholds: Sequence[float]
) -> list[str]:
    """One row an engine: means over the scenes that all of them ran on.
    Engines with fewer than half of the scenes are left out."""
    scenes = {
        engine: {r["scene"] for r in records if r["engine"] == engine}
        for engine in engines
    }
    num_scenes = len({r["scene"] for r in records})
    engines = [e for e in engines if 2 * len(scenes[e]) >= num_scenes]
    common = set.intersection(*(scenes[engine] for engine in engines))
    repeatability = _RepeatabilityColumn(
        [r for r in records if r["engine"] in engines]
    )
    rows = []
    for engine in engines:
        runs = [
            r
            for r in records
            if r["engine"] == engine and r["scene"] in common
        ]
        failed = [r for r in runs if r["status"] != "ok"]
        rows.append(
            [
                engine,
                *(
                    summarize(runs, lambda r, i=i: auc(r, i)).text()
                    for i in range(len(thresholds))
                ),
                *repeatability.cells(engine, runs),
                f"{_registered_share(runs):.1f} %",
                f"{len(failed)} / {len(runs)}" if failed else "none",
            ]
        )
    header = [
        "engine",
        *(f"AUC@{t:g}" for t in thresholds),
        *repeatability.header(),
        "registered",
        "failed runs",
    ]
    return [
        f"Mean of {len(common)} scenes ({', '.join(sorted(common))}), "
        "± standard deviation over seeds."
        if len(common) < 12
        else f"Mean of {len(common)} scenes, ± standard deviation over seeds.",
        "",
        *markdown(header, rows),
    ]


def _registered_share(runs):
    registered = sum(r.get("metrics", {}).get("num_registered", 0) for r in runs)
    total = sum(r.get("metrics", {}).get("num_images", 0) for r in runs)
    return 100 * registered / total if total else 0.0


def scene_table(
    records: list[Record], engines: Sequence[str], thresholds: Sequence[float]
) -> list[str]:
    """One row a scene and engine, means over seeds."""
    repeatability = _RepeatabilityColumn(records)
    rows = []
    for scene in _unique(r["scene"] for r in records):
        first = True
        for engine in engines:
            runs = [
                r
                for r in records
                if r["scene"] == scene and r["engine"] == engine
            ]
            if not runs:
                continue
            rows.append(
                _scene_row(
                    scene if first else "",
                    engine,
                    runs,
                    thresholds,
                    repeatability,
                )
            )
            first = False
    header = [
        "scene", "engine", "registered", "models",
        *(f"AUC@{t:g}" for t in thresholds), *repeatability.header(),
        "COLMAP's AUC@1 / 5", "scale", "points", "track length",
    ]  # fmt: skip
    return markdown(header, rows)


def _scene_row(scene, engine, runs, thresholds, repeatability):
    if all(r["status"] != "ok" for r in runs):
        reasons = _unique(_short_reason(r["reason"]) for r in runs)
        return [scene, engine, "; ".join(reasons)] + [""] * (
            len(thresholds) + len(repeatability.header()) + 5
        )
    total = runs[0]["metrics"]["num_images"]
    colmap = [
        summarize(runs, lambda r, i=i: _colmap_auc(r, i)) for i in (1, 2)
    ]
    scale = summarize(runs, _metric("scale"))
    is_metric = runs[0].get("is_metric", True)
    return [
        scene,
        engine,
        f"{summarize(runs, _metric('num_registered')).mean:.4g} / {total}",
        f"{summarize(runs, _metric('num_models')).mean:.3g}",
        *(
            summarize(runs, lambda r, i=i: auc(r, i)).text()
            for i in range(len(thresholds))
        ),
        *repeatability.cells(engine, runs),
        " / ".join(f"{c.mean:.1f}" for c in colmap),
        f"{scale.mean:.3f}" if is_metric and not np.isnan(scale.mean) else "",
        f"{summarize(runs, _metric('num_points')).mean:.0f}",
        f"{summarize(runs, _metric('mean_track_length')).mean:.2f}",
    ]


def _short_reason(reason):
    return reason if len(reason) < 60 else reason[:57] + "..."


def _colmap_auc(record, idx):
    values = record.get("metrics", {}).get("colmap_auc")
    return values[idx] if values else 0.0


def resource_table(records: list[Record], engines: Sequence[str]) -> list[str]:
    """Seconds and memory of each scene and engine, medians over seeds."""
    rows = []
    for scene in _unique(r["scene"] for r in records):
        row = [scene]
        for engine in engines:
            runs = [
                r
                for r in records
                if r["scene"] == scene
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


def losses(
    records: list[Record], reference: str, idx: int
) -> list[tuple[str, str, str, float, str]]:
    """Points of a depth-quality sweep where an engine with depth is worse than
    the reference: engine, family, level, mean loss over seeds, verdict."""
    families = {}
    for record in records:
        if record["engine"] == reference:
            key = (record["parameters"]["family"], record["seed"])
            # On any level: they differ in depth only.
            families[key] = auc(record, idx)
    found = []
    for engine in _unique(r["engine"] for r in records):
        for scene in _unique(r["scene"] for r in records):
            runs = [
                r
                for r in records
                if r["engine"] == engine and r["scene"] == scene
            ]
            if not runs or not runs[0].get("uses_depth"):
                continue
            parameters = runs[0]["parameters"]
            difference = paired_difference(
                {(s,): v for (f, s), v in families.items()
                 if f == parameters["family"]},
                {(r["seed"],): auc(r, idx) for r in runs},
            )  # fmt: skip
            if difference.mean < -MIN_LOSS:
                found.append(
                    (
                        engine,
                        parameters["family"],
                        parameters["level"],
                        difference.mean,
                        difference.verdict(),
                    )
                )
    return found
