"""Means and paired differences of runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
from scipy import stats

Record = dict
Key = tuple[str, str, str, int]  # data set, scene, engine, seed


def auc(record: Record, idx: int) -> float:
    """The pose AUC at the idx-th threshold; zero for a run without."""
    values = record.get("metrics", {}).get("auc")
    return float(values[idx]) if values else 0.0


def repeatable_auc(record: Record) -> float | None:
    """The AUC@1 between halves of the points; None for a run without."""
    return record.get("metrics", {}).get("repeatable_auc_1")


@dataclasses.dataclass(frozen=True)
class Summary:
    """Mean over scenes, then mean and spread of that over seeds."""

    mean: float
    stddev: float  # NaN for one seed

    def text(self, digits: int = 1) -> str:
        if np.isnan(self.mean):
            return ""
        text = f"{self.mean:.{digits}f}"
        if not np.isnan(self.stddev):
            text += f" ± {self.stddev:.{digits}f}"
        return text


def summarize(
    records: Iterable[Record], value: Callable[[Record], float | None]
) -> Summary:
    """Mean over the scenes of each seed that have a value."""
    by_seed: dict[int, list[float]] = {}
    for record in records:
        number = value(record)
        if number is not None:
            by_seed.setdefault(record["seed"], []).append(number)
    means = [np.mean(numbers) for numbers in by_seed.values()]
    if not means:
        return Summary(np.nan, np.nan)
    spread = float(np.std(means, ddof=1)) if len(means) > 1 else np.nan
    return Summary(float(np.mean(means)), spread)


@dataclasses.dataclass(frozen=True)
class Difference:
    """Paired differences B - A."""

    num_pairs: int
    mean: float
    stddev: float  # of the single differences
    half_width: float  # of the 95 % interval of the mean; NaN = one pair
    mean_a: float
    mean_b: float

    def verdict(self) -> str:
        """Plain only where the interval of the mean excludes zero."""
        if np.isnan(self.half_width):
            return "one pair: no verdict"
        if abs(self.mean) <= self.half_width:
            return "within noise"
        return "higher" if self.mean > 0 else "lower"


def paired_difference(
    values_a: dict[tuple, float], values_b: dict[tuple, float]
) -> Difference:
    """Differences of what both have; raises ValueError if they share none.

    The interval is Student's, for the mean of independent differences.
    """
    keys = sorted(set(values_a) & set(values_b))
    if not keys:
        raise ValueError("the two have no scene and seed in common")
    a = np.array([values_a[key] for key in keys])
    b = np.array([values_b[key] for key in keys])
    differences = b - a
    half_width = stddev = np.nan
    if len(keys) > 1:
        stddev = float(np.std(differences, ddof=1))
        quantile = stats.t.ppf(0.975, len(keys) - 1)
        half_width = float(quantile * stddev / np.sqrt(len(keys)))
    return Difference(
        len(keys),
        float(differences.mean()),
        stddev,
        half_width,
        float(a.mean()),
        float(b.mean()),
    )
