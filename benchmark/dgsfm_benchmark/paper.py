"""Figures of the paper (DGSfM) beside ours, from stored runs alone."""

from __future__ import annotations

import dataclasses

from . import tables
from .statistics import auc_at, run_difference, scene_means, summarize
from .summary import Results
from .tables import of_engine

NOT_MEASURED = "not measured: the data is not here"
NO_SWITCH = "not measured: no such switch here"
NOT_RUN = "not measured: not run here"
_DEPTH, _GLOBAL, _INCREMENTAL = "depth", "COLMAP global", "COLMAP incremental"


@dataclasses.dataclass(frozen=True)
class Row:
    """A method of a table: its figures, and the engine that stands for it
    with the same key points, if the data was here."""

    method: str
    features: str
    figures: tuple[float, ...]
    engine: str | None = None


@dataclasses.dataclass(frozen=True)
class Table:
    """Poses of a published data set."""

    title: str
    experiment: str
    place: str  # part of the names of its scenes; empty = all
    thresholds_deg: tuple[float, ...]
    rows: tuple[Row, ...]


def _sift(ours, glomap, colmap, name="Ours, no Doppelgangers++"):
    return (
        Row("COLMAP", "SIFT", colmap, _INCREMENTAL),
        Row("GLOMAP", "SIFT", glomap, _GLOBAL),
        Row(name, "SIFT", ours, _DEPTH),
    )


POSE_TABLES = (
    Table(
        "ETH3D", "eth3d", "", (1, 3, 5),
        (
            *_sift(
                (38.88, 61.67, 70.12), (41.22, 56.56, 60.58),
                (31.58, 45.65, 49.18),
            ),
            Row("InstantSfM", "SIFT", (18.95, 33.27, 39.11)),
            Row("COLMAP", "ALIKED, LightGlue", (35.50, 53.77, 58.68)),
            Row("GLOMAP", "ALIKED, LightGlue", (36.23, 50.97, 55.21)),
            Row("Ours, no Doppelgangers++", "ALIKED, LightGlue",
                (37.19, 59.43, 66.96)),
            Row("COLMAP", "LoMa-B", (43.45, 61.66, 66.32)),
            Row("GLOMAP", "LoMa-B", (43.74, 60.19, 64.84)),
            Row("InstantSfM", "LoMa-B", (23.44, 34.64, 36.78)),
            Row("Ours, no Doppelgangers++", "LoMa-B", (46.87, 71.92, 78.78)),
            Row("Ours", "LoMa-B", (51.60, 78.25, 85.43)),
            Row("Ours, true intrinsics", "LoMa-B", (56.74, 81.16, 87.71)),
            Row("COLMAP", "LoMa-G", (48.19, 65.61, 71.12)),
            Row("GLOMAP", "LoMa-G", (46.01, 61.70, 66.37)),
            Row("InstantSfM", "LoMa-G", (29.72, 38.83, 42.75)),
            Row("Ours, no Doppelgangers++", "LoMa-G", (49.01, 72.97, 79.31)),
            Row("Ours", "LoMa-G", (53.58, 79.11, 86.04)),
            Row("MP-SfM", "SuperPoint, RoMa v1", (5.64, 22.44, 34.16)),
            Row("MP-SfM, true intrinsics", "SuperPoint, RoMa v1",
                (58.63, 78.87, 84.34)),
            Row("PixSfM", "SIFT, refined", (26.94, 39.01, 42.19)),
            Row("MASt3R-SfM", "MASt3R", (27.05, 45.84, 52.61)),
            Row("DF-SfM", "RoMa v1", (59.12, 75.59, 79.53)),
            Row("Dense-SfM", "RoMa v1", (60.92, 78.41, 82.63)),
            Row("Ours", "RoMa v1", (61.00, 82.63, 88.33)),
            Row("Ours, true intrinsics", "RoMa v1", (64.69, 85.20, 90.50)),
            Row("VGGT", "-", (0.65, 8.37, 17.76)),
            Row("Pi3", "-", (14.31, 38.63, 51.25)),
            Row("DepthAnything3", "-", (15.53, 46.27, 58.63)),
            Row("VGGT + BA", "ALIKED, SuperPoint", (18.23, 38.49, 46.98)),
            Row("Pi3 + BA", "SIFT, deep", (32.84, 58.51, 68.19)),
            Row("VGGSfM", "SuperPoint, SIFT", (28.09, 44.41, 49.91)),
        ),
    ),
    Table(
        "IMC 2021", "imc2021", "", (3, 5, 10),
        (
            *_sift(
                (35.55, 48.29, 64.87), (33.79, 44.48, 57.38),
                (27.56, 37.10, 48.55),
            ),
            Row("COLMAP", "ALIKED, LightGlue", (38.89, 50.83, 64.40)),
            Row("GLOMAP", "ALIKED, LightGlue", (41.31, 53.56, 67.37)),
            Row("Ours, no Doppelgangers++", "ALIKED, LightGlue",
                (43.43, 56.45, 71.54)),
            Row("COLMAP", "LoMa-B", (42.40, 54.27, 67.36)),
            Row("GLOMAP", "LoMa-B", (45.91, 58.29, 71.81)),
            Row("Ours, no Doppelgangers++", "LoMa-B", (46.62, 60.84, 73.80)),
            Row("Ours", "LoMa-B", (46.59, 59.91, 75.59)),
            Row("Ours, true intrinsics", "LoMa-B", (50.77, 63.85, 77.68)),
            Row("COLMAP", "LoMa-G", (44.58, 56.18, 68.73)),
            Row("GLOMAP", "LoMa-G", (46.75, 59.32, 72.36)),
            Row("Ours, no Doppelgangers++", "LoMa-G", (46.75, 60.16, 74.75)),
            Row("Ours", "LoMa-G", (47.74, 61.12, 75.65)),
            Row("MP-SfM", "SuperPoint, RoMa v1", (19.43, 29.13, 40.87)),
            Row("MP-SfM, true intrinsics", "SuperPoint, RoMa v1",
                (56.27, 62.78, 70.54)),
            Row("PixSfM", "SIFT, refined", (25.54, 34.80, 46.73)),
            Row("MASt3R-SfM", "MASt3R", (31.77, 46.36, 64.37)),
            Row("DF-SfM", "RoMa v1", (47.43, 59.84, 73.19)),
            Row("Dense-SfM", "RoMa v1", (48.48, 60.79, 73.90)),
            Row("MV-RoMa", "RoMa v1", (51.31, 62.92, 75.92)),
            Row("Ours", "RoMa v1", (50.66, 63.03, 76.30)),
            Row("Ours, true intrinsics", "RoMa v1", (55.28, 68.71, 82.36)),
            Row("VGGT", "-", (41.15, 55.52, 71.73)),
            Row("Pi3", "-", (43.34, 57.57, 73.35)),
            Row("DepthAnything3", "-", (44.15, 58.54, 74.21)),
            Row("VGGT + BA", "ALIKED, SuperPoint", (44.96, 58.08, 73.52)),
            Row("Pi3 + BA", "SIFT, deep", (55.30, 66.43, 78.67)),
            Row("VGGSfM", "SuperPoint, SIFT", (45.23, 58.89, 73.92)),
        ),
    ),
    *(
        Table(
            f"LaMAR, {place}", "lamar", place, (5, 10, 30),
            (
                *_sift(*sift, name="Ours"),
                Row("COLMAP", "LoMa-B", loma[0]),
                Row("GLOMAP", "LoMa-B", loma[1]),
                Row("Ours", "LoMa-B", loma[2]),
            ),
        )
        for place, sift, loma in (
            (
                "LIN",
                ((14.48, 24.78, 31.42), (5.11, 7.19, 11.09),
                 (10.69, 11.62, 12.66)),
                ((24.76, 32.81, 49.07), (21.18, 29.93, 43.65),
                 (32.45, 45.58, 63.74)),
            ),
            (
                "HGE",
                ((9.32, 12.43, 20.64), (1.33, 1.71, 2.96),
                 (5.34, 5.65, 5.92)),
                ((4.80, 5.43, 7.30), (1.07, 1.51, 3.49),
                 (10.49, 15.37, 23.49)),
            ),
        )
    ),
)  # fmt: skip

# Depth models, on ETH3D with LoMa-B.
DEPTH_MODELS = (
    ("MoGe2", (51.60, 78.25, 85.43)),
    ("MoGe1", (52.47, 78.34, 85.53)),
    ("UniK3D", (49.00, 75.70, 83.23)),
    ("UniDepthV2", (48.17, 73.99, 81.29)),
)

_FULL = (51.60, 78.25, 85.43)
# Modules, on ETH3D with LoMa-B: figures, and the switch of our ablation.
MODULES = (
    ("w/o Doppelgangers++", (46.87, 71.92, 78.78), "no pair scores"),
    ("w/o triplet-edge prune", (49.54, 76.22, 83.41), None),
    ("w/o scaled-depth filter", (48.61, 74.46, 81.73), "no depth consistency"),
    ("w/o global positioning", (40.70, 63.40, 70.64), "no global positioning"),
    ("w/o scale averaging", (47.54, 72.98, 80.16), "no scale averaging"),
    ("w/o depth pose init.", (48.81, 74.03, 81.18), "random start"),
)

# Seconds on ETH3D; those after "+" are the depth network's.
RUNTIMES = (
    ("COLMAP", "12.70", _INCREMENTAL),
    ("GLOMAP", "16.40", _GLOBAL),
    ("MP-SfM", "110.58 + 3.35", None),
    ("Ours", "13.99 + 3.35", "emulated strong depth"),
)

# Accuracy, then completeness, of points at 1, 2 and 5 cm on ETH3D.
POINTS = (
    ("COLMAP", "LoMa-B", (31.84, 43.21, 58.66, 0.66, 2.93, 13.28)),
    ("GLOMAP", "LoMa-B", (31.65, 45.82, 65.07, 0.27, 1.50, 9.14)),
    ("Ours", "LoMa-B", (45.28, 61.25, 79.76, 0.26, 1.32, 7.49)),
    ("DepthAnything3", "-", (13.62, 23.96, 44.44, 8.08, 16.24, 27.12)),
    ("PixSfM", "SIFT, refined", (76.18, 85.60, 93.16, 0.17, 0.71, 3.29)),
    ("VGGSfM", "SuperPoint, SIFT", (80.62, 89.49, 96.52, 4.52, 13.11, 33.96)),
    ("MASt3R-SfM", "MASt3R", (27.34, 43.90, 69.50, 14.86, 34.81, 68.72)),
    ("MP-SfM", "SuperPoint, RoMa v1", (3.64, 6.63, 12.91, 0.26, 1.42, 7.21)),
    ("MP-SfM, true intrinsics", "SuperPoint, RoMa v1",
     (42.17, 60.42, 81.38, 3.22, 12.20, 40.29)),
    ("DF-SfM", "RoMa v1", (79.32, 88.42, 95.82, 3.13, 9.79, 29.10)),
    ("Dense-SfM", "RoMa v1", (84.79, 92.62, 97.77, 7.38, 17.06, 36.35)),
    ("MV-RoMa", "RoMa v1", (85.88, 92.99, 98.05, 3.95, 9.94, 23.81)),
    ("Ours", "RoMa v1", (60.12, 74.90, 90.17, 20.28, 47.53, 74.58)),
)  # fmt: skip


def _slashed(figures) -> str:
    return " / ".join(f"{figure:.2f}" for figure in figures)


def _at(thresholds) -> str:
    return "AUC@" + " / ".join(f"{t:g}" for t in thresholds)


def _pose_lines(table: Table, results: Results) -> list[str]:
    rows = [
        [
            row.method,
            row.features,
            _slashed(row.figures),
            _ours(table, row, results),
        ]
        for row in table.rows
    ]
    figures = f"paper: {_at(table.thresholds_deg)}"
    header = ["method of the paper", "key points", figures, "here"]
    return [f"## {table.title}", "", *tables.markdown(header, rows), ""]


def _ours(table: Table, row: Row, results: Results) -> str:
    result = results.get(table.experiment)
    if row.engine is None or not result:
        return NOT_MEASURED
    runs = [
        r
        for r in of_engine(result["records"], row.engine)
        if table.place in r["scene"]
    ]
    if not runs or list(result["thresholds_deg"]) != list(table.thresholds_deg):
        return NOT_MEASURED
    figures = [
        summarize(runs, auc_at(table.thresholds_deg, i)).mean
        for i in range(len(table.thresholds_deg))
    ]
    return f"{row.engine}: {_slashed(figures)}"


def _module_lines(results: Results) -> list[str]:
    result = results.get("ablation")
    rows = []
    for name, figures, switch in MODULES:
        losses = [a - b for a, b in zip(figures, _FULL)]
        rows.append(
            [
                name,
                " / ".join(f"{loss:+.2f}" for loss in losses),
                *_module_cells(switch, result),
            ]
        )
    return [
        "## Ablation of modules",
        "",
        "The paper: ETH3D, LoMa-B. Here: other sets, with SIFT and the depth "
        "that [the ablation](ablation.md) names, mostly emulated strong depth; "
        "differences can be compared, figures cannot. “No pair scores” counts "
        "only where a set has scores of Doppelgangers++.",
        "",
        *tables.markdown(
            [
                "module of the paper", "paper: change of AUC@1 / 3 / 5",
                "switch here", "here: change of AUC@1 / 3 / 5", "scenes",
            ],
            rows,
        ),
        "",
    ]  # fmt: skip


def _module_cells(switch: str | None, result: dict | None) -> list[str]:
    if switch is None:
        return ["-", NO_SWITCH, ""]
    changes = []
    number = 0
    for i, _ in enumerate((result or {}).get("thresholds_deg", [])[:3]):
        try:
            difference = run_difference(
                of_engine(result["records"], result["reference"]),
                of_engine(result["records"], switch),
                auc_at(result["thresholds_deg"], i),
            )
        except ValueError:
            continue
        changes.append(f"{difference.mean:+.2f}")
        number = max(number, difference.num_scenes)
    if not changes:
        return [switch, "no runs stored yet", ""]
    return [switch, " / ".join(changes), str(number)]


def _runtime_lines(results: Results) -> list[str]:
    result = results.get("speed")
    rows = []
    for name, seconds, engine in RUNTIMES:
        runs = of_engine(result["records"], engine) if result else []
        times = scene_means(runs, lambda r: r.get("seconds"))
        here = NOT_RUN if engine is None else "no runs stored yet"
        if times:
            mean = sum(times.values()) / len(times)
            here = f"{engine}: {mean:.2f} ({', '.join(times)})"
        rows.append([name, seconds, here])
    return [
        "## Time",
        "",
        "The paper: seconds on ETH3D, on another machine. Here: means over the "
        "sets named; only ratios can be compared.",
        "",
        *tables.markdown(["method", "paper [s]", "here [s]"], rows),
        "",
    ]


def _other_lines() -> list[str]:
    models = [[name, _slashed(f), NOT_MEASURED] for name, f in DEPTH_MODELS]
    points = [[m, k, _slashed(f), NOT_MEASURED] for m, k, f in POINTS]
    return [
        "## Depth models",
        "",
        "On ETH3D with LoMa-B.",
        "",
        *tables.markdown(["model", "paper: AUC@1 / 3 / 5", "here"], models),
        "",
        "## Points",
        "",
        "On ETH3D's training scenes.",
        "",
        *tables.markdown(
            [
                "method", "key points",
                "paper: accuracy at 1 / 2 / 5 cm / completeness", "here",
            ],
            points,
        ),
    ]  # fmt: skip


def paper_lines(results: Results) -> list[str]:
    """All tables of the paper, with ours where there are runs."""
    lines = [
        "# The paper's tables",
        "",
        "Figures of the paper beside those of the stored runs here. "
        "[The overview](../results.md) has what was measured on other data.",
        "",
    ]
    for table in POSE_TABLES:
        lines += _pose_lines(table, results)
    lines += _module_lines(results) + _runtime_lines(results)
    return lines + _other_lines()
