"""Comparison of two sets of runs by paired differences over scenes."""

from __future__ import annotations

from .errors import BenchmarkError
from .statistics import (
    NUM_RESAMPLES,
    Record,
    Value,
    auc_at,
    run_difference,
    scale_error,
)

METHOD = (
    "Means over scenes, of means over seeds; subsets of a scene's images count "
    f"with the scene. Interval: 95 %, bootstrap over scenes ({NUM_RESAMPLES:,} "
    "resamples, fixed seed). Sign test: exact, two-sided, over scenes. Over "
    "seeds: standard deviation of the difference on one scene. “Higher” and "
    "“lower” need both tests, hence six scenes at least."
)
HEADER = [
    "figure", "scenes", "A", "B", "B - A", "95 % interval", "over seeds",
    "verdict",
]  # fmt: skip


def _registered(record: Record) -> float:
    metrics = record.get("metrics", {})
    return 100 * metrics.get("num_registered", 0) / metrics.get("num_images", 1)


def figures(thresholds_deg: list[float]) -> dict[str, Value]:
    """All that is compared, by its name."""
    return {
        **{
            f"AUC@{threshold:g}": auc_at(thresholds_deg, i)
            for i, threshold in enumerate(thresholds_deg)
        },
        "registered [%]": _registered,
        "scale error [%]": scale_error,
        "time [s]": lambda record: record.get("seconds"),
        "CPU time [s]": lambda record: record.get("cpu_seconds"),
        "memory [MB]": lambda record: record.get("peak_memory_mb"),
    }


def difference_row(
    name: str, records_a: list[Record], records_b: list[Record], value: Value
) -> list[str] | None:
    """Cells of one figure; None if nothing can be paired."""
    try:
        difference = run_difference(records_a, records_b, value)
    except ValueError:
        return None
    spread = difference.stddev
    return [
        name,
        str(difference.num_scenes),
        f"{difference.mean_a:.2f}",
        f"{difference.mean_b:.2f}",
        f"{difference.mean:+.2f}",
        difference.interval(),
        f"± {spread:.2f}" if spread == spread else "",
        difference.verdict(),
    ]


def compare(
    records_a: list[Record],
    records_b: list[Record],
    thresholds_deg: list[float],
    by_engine: bool = True,
) -> list[str]:
    """Lines of a table of the mean differences B - A over scenes.

    ``by_engine``: runs are paired engine by engine; otherwise A and B are one
    engine each. Raises BenchmarkError if nothing can be paired.
    """
    engines = [""]
    if by_engine:
        engines = sorted(
            {r["engine"] for r in records_a} & {r["engine"] for r in records_b}
        )
    rows = []
    for engine in engines:
        sides = [
            [r for r in records if engine in ("", r["engine"])]
            for records in (records_a, records_b)
        ]
        for name, value in figures(thresholds_deg).items():
            row = difference_row(name, *sides, value)
            if row is not None:
                rows.append([engine, *row])
    if not rows:
        raise BenchmarkError("A and B have no engine, scene and seed in common")
    header = ["engine", *HEADER]
    return [
        f"| {' | '.join(cells)} |"
        for cells in [header, ["---"] * len(header), *rows]
    ]
