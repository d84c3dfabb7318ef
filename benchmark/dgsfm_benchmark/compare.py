"""Comparison of two sets of runs by paired differences."""

from __future__ import annotations

from collections.abc import Callable

from .errors import BenchmarkError
from .statistics import Record, auc, paired_difference


def _metric(name: str, idx: int) -> Callable[[Record], float | None]:
    if name == "auc":
        return lambda record: auc(record, idx)
    if name == "registered":
        return lambda record: (
            100
            * record.get("metrics", {}).get("num_registered", 0)
            / record.get("metrics", {}).get("num_images", 1)
        )
    return lambda record: record.get(name)


def compare(
    records_a: list[Record],
    records_b: list[Record],
    thresholds_deg: list[float],
    by_engine: bool = True,
) -> list[str]:
    """Lines of a table: for each figure the means, the mean difference B - A
    over scenes and seeds, its standard deviation, and a verdict.

    ``by_engine``: runs are paired engine by engine; otherwise A and B are one
    engine each. Raises BenchmarkError if nothing can be paired.
    """
    figures = [
        (f"AUC@{threshold:g}", _metric("auc", i))
        for i, threshold in enumerate(thresholds_deg)
    ]
    figures += [
        ("registered [%]", _metric("registered", 0)),
        ("time [s]", _metric("seconds", 0)),
        ("CPU time [s]", _metric("cpu_seconds", 0)),
        ("memory [MB]", _metric("peak_memory_mb", 0)),
    ]
    engines = [""]
    if by_engine:
        engines = sorted(
            {r["engine"] for r in records_a} & {r["engine"] for r in records_b}
        )
    lines = [
        "| engine | figure | pairs | A | B | B - A | sd | verdict |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for engine in engines:
        for name, value in figures:
            try:
                difference = paired_difference(
                    _values(records_a, engine, value),
                    _values(records_b, engine, value),
                )
            except ValueError:
                continue
            lines.append(
                f"| {engine} | {name} | {difference.num_pairs} "
                f"| {difference.mean_a:.2f} | {difference.mean_b:.2f} "
                f"| {difference.mean:+.2f} | {difference.stddev:.2f} "
                f"| {difference.verdict()} |"
            )
    if len(lines) == 2:
        raise BenchmarkError("A and B have no engine, scene and seed in common")
    return lines


def _values(records, engine, value):
    values = {}
    for record in records:
        number = value(record)
        if number is not None and engine in ("", record["engine"]):
            key = (record["dataset"], record["scene"], record["seed"])
            values[key] = number
    return values
