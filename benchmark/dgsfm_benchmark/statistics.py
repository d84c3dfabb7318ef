"""Means and paired differences of runs, with the scene as the unit.

Seeds of a scene are no scenes of their own, nor are subsets of its images or
other key points of them: what they have in common would count several times.
Values are averaged over the seeds of a scene as it was run (a "variant" here:
"castle-P19/2" is one), then over the variants of a scene. How far seeds differ
is told apart from this, as reproducibility.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
from scipy import stats

Record = dict
Variant = tuple[str, str]  # data set, scene as it was run
Value = Callable[[Record], float | None]

NUM_RESAMPLES = 10_000
_BOOTSTRAP_SEED = 0
_LEVEL = 0.05


def auc(record: Record, idx: int) -> float:
    """The pose AUC at the idx-th threshold; zero for a run without."""
    values = record.get("metrics", {}).get("auc")
    return float(values[idx]) if values else 0.0


def bears(record: Record, threshold_deg: float) -> bool:
    """Whether the truth of the scene is good enough for a threshold."""
    return threshold_deg >= record.get("min_threshold_deg", 0)


def auc_at(thresholds_deg: list[float], idx: int) -> Value:
    """The AUC at the idx-th threshold, None where the truth does not bear
    it."""
    return lambda r: auc(r, idx) if bears(r, thresholds_deg[idx]) else None


def repeatable_auc(record: Record) -> float | None:
    """The AUC@1 between halves of the points; None for a run without."""
    return record.get("metrics", {}).get("repeatable_auc_1")


def scale_error(record: Record) -> float | None:
    """By how much the unit of depth comes out wrong, in per cent."""
    error = record.get("metrics", {}).get("scale_error")
    return None if error is None else 100 * error


def variant_of(record: Record) -> Variant:
    return record.get("dataset", ""), record["scene"]


def scene_of(record: Record) -> str:
    """The scene that a variant shows: "castle-P19/2" and "castle-P19, two
    ends" are images of castle-P19, levels of a family are of the family."""
    return record["scene"].split("/")[0].split(",")[0]


def seed_values(
    records: Iterable[Record], value: Value
) -> dict[Variant, dict[int, float]]:
    """Values by variant and seed, of the runs that have one."""
    values: dict[Variant, dict[int, float]] = {}
    for record in records:
        number = value(record)
        if number is not None:
            values.setdefault(variant_of(record), {})[record["seed"]] = number
    return values


def variant_means(
    records: Iterable[Record], value: Value
) -> dict[Variant, float]:
    """Means over the seeds of each variant."""
    return {
        variant: float(np.mean(list(seeds.values())))
        for variant, seeds in seed_values(records, value).items()
    }


def _scene_means(variants: dict[Variant, float]) -> dict[str, float]:
    scenes: dict[str, list[float]] = {}
    for (dataset, scene), number in variants.items():
        key = scene_of({"dataset": dataset, "scene": scene})
        scenes.setdefault(key, []).append(number)
    return {scene: float(np.mean(numbers)) for scene, numbers in scenes.items()}


def scene_means(records: Iterable[Record], value: Value) -> dict[str, float]:
    """Means over the variants of each scene of the means over their seeds."""
    return _scene_means(variant_means(records, value))


def seed_spread(values: dict[Variant, dict[int, float]]) -> float:
    """Standard deviation over the seeds of a variant, pooled over variants;
    NaN if each has one seed."""
    variances = [
        np.var(list(seeds.values()), ddof=1)
        for seeds in values.values()
        if len(seeds) > 1
    ]
    return float(np.sqrt(np.mean(variances))) if variances else np.nan


@dataclasses.dataclass(frozen=True)
class Summary:
    """Mean and worst case over scenes, and reproducibility."""

    mean: float
    worst: float
    worst_scene: str
    num_scenes: int
    stddev: float  # over seeds of a variant; NaN for one seed

    def text(self, digits: int = 1) -> str:
        return "" if np.isnan(self.mean) else f"{self.mean:.{digits}f}"

    def text_of_worst(self, digits: int = 1) -> str:
        text = "" if np.isnan(self.worst) else f"{self.worst:.{digits}f}"
        return f"{text} ({self.worst_scene})" if self.num_scenes > 1 else text

    def text_with_spread(self, digits: int = 1) -> str:
        """For one variant, whose seeds are all there is to average."""
        text = self.text(digits)
        if text and not np.isnan(self.stddev):
            text += f" ± {self.stddev:.{digits}f}"
        return text


def summarize(records: Iterable[Record], value: Value) -> Summary:
    """Mean over the scenes that have a value."""
    values = seed_values(records, value)
    means = _scene_means(
        {v: float(np.mean(list(seeds.values()))) for v, seeds in values.items()}
    )
    if not means:
        return Summary(np.nan, np.nan, "", 0, np.nan)
    worst = min(means, key=means.get)
    return Summary(
        float(np.mean(list(means.values()))),
        means[worst],
        worst,
        len(means),
        seed_spread(values),
    )


@dataclasses.dataclass(frozen=True)
class Difference:
    """Paired differences B - A of scenes."""

    num_scenes: int
    mean: float
    low: float  # 95 % interval of the mean, by bootstrap over scenes
    high: float
    sign_p: float  # exact two-sided sign test over scenes
    mean_a: float
    mean_b: float
    stddev: float = np.nan  # of the difference over seeds of a variant

    def interval(self, digits: int = 2) -> str:
        if np.isnan(self.low):
            return ""
        return f"{self.low:+.{digits}f} to {self.high:+.{digits}f}"

    def verdict(self) -> str:
        """Plain only where bootstrap and sign test agree: an interval of few
        scenes is too narrow, and a sign knows nothing of sizes."""
        basis = f"sign test p = {self.sign_p:.2g}, {scenes(self.num_scenes)}"
        excludes_zero = self.low > 0 or self.high < 0
        if excludes_zero and self.sign_p <= _LEVEL:
            word = "higher" if self.mean > 0 else "lower"
            return f"{word} (bootstrap and {basis})"
        if excludes_zero:
            return f"no difference shown (bootstrap alone, {basis})"
        return f"no difference shown ({basis})"


def scenes(number: int) -> str:
    return "1 scene" if number == 1 else f"{number} scenes"


def bootstrap_interval(differences: np.ndarray) -> tuple[float, float]:
    """95 % percentile interval of the mean, of resampled scenes; the seed is
    fixed, so that tables do not change from run to run."""
    random = np.random.default_rng(_BOOTSTRAP_SEED)
    count = len(differences)
    choices = random.integers(count, size=(NUM_RESAMPLES, count))
    low, high = np.quantile(differences[choices].mean(axis=1), [0.025, 0.975])
    return float(low), float(high)


def sign_test(differences: np.ndarray) -> float:
    """Exact two-sided p of as uneven signs; scenes without a difference are
    left out."""
    num_positive = int(np.sum(differences > 0))
    num_signs = num_positive + int(np.sum(differences < 0))
    if num_signs == 0:
        return 1.0
    return float(stats.binomtest(num_positive, num_signs).pvalue)


def paired_difference(
    values_a: dict[str, float], values_b: dict[str, float]
) -> Difference:
    """Differences of the scenes that both have; raises ValueError if they
    share none. The values are means over seeds."""
    keys = sorted(set(values_a) & set(values_b))
    if not keys:
        raise ValueError("the two have no scene in common")
    a = np.array([values_a[key] for key in keys])
    b = np.array([values_b[key] for key in keys])
    low, high = np.nan, np.nan
    if len(keys) > 1:
        low, high = bootstrap_interval(b - a)
    return Difference(
        len(keys),
        float((b - a).mean()),
        low,
        high,
        sign_test(b - a),
        float(a.mean()),
        float(b.mean()),
    )


def run_difference(
    records_a: Iterable[Record], records_b: Iterable[Record], value: Value
) -> Difference:
    """Paired differences of runs: by variant and seed, averaged over seeds and
    variants of a scene. Raises ValueError if nothing can be paired."""
    a = seed_values(records_a, value)
    b = seed_values(records_b, value)
    pairs = {}
    for variant in sorted(set(a) & set(b)):
        seeds = sorted(set(a[variant]) & set(b[variant]))
        if seeds:
            pairs[variant] = seeds

    def means(values):
        return _scene_means(
            {v: float(np.mean([values[v][s] for s in pairs[v]])) for v in pairs}
        )

    spread = seed_spread(
        {v: {s: b[v][s] - a[v][s] for s in pairs[v]} for v in pairs}
    )
    difference = paired_difference(means(a), means(b))
    return dataclasses.replace(difference, stddev=spread)


@dataclasses.dataclass(frozen=True)
class VariantChange:
    """What a switch changes on one variant, against the noise of seeds."""

    variant: Variant
    change: float
    noise: float

    @property
    def sign(self) -> int:
        """1 or -1 where the change is more than noise, else 0."""
        if abs(self.change) <= self.noise:
            return 0
        return 1 if self.change > 0 else -1


def variant_changes(
    records_a: Iterable[Record],
    records_b: Iterable[Record],
    value: Value,
    min_noise: float,
    num_tests: int = 1,
) -> list[VariantChange]:
    """Changes from A to B on each variant that both have.

    Noise is Student's 95 % bound of a difference of means over seeds, and
    ``min_noise`` at least. A variant of one seed is given the spread of the
    others. With ``num_tests`` the bounds hold for so many together
    (Bonferroni).
    """
    level = _LEVEL / num_tests
    a = seed_values(records_a, value)
    b = seed_values(records_b, value)
    common = sorted(set(a) & set(b))
    pooled = np.nan_to_num(
        [seed_spread({v: values[v] for v in common}) for values in (a, b)]
    )
    changes = []
    for variant in common:
        sides = [list(values[variant].values()) for values in (a, b)]
        bound = _noise_of_means(sides, pooled, level)
        change = float(np.mean(sides[1]) - np.mean(sides[0]))
        changes.append(VariantChange(variant, change, max(bound, min_noise)))
    return changes


def _noise_of_means(
    sides: list[list[float]], pooled: np.ndarray, level: float
) -> float:
    if min(len(side) for side in sides) < 2:
        variance = sum(p**2 / len(side) for p, side in zip(pooled, sides))
        return float(stats.norm.ppf(1 - level / 2) * np.sqrt(variance))
    variance = sum(np.var(side, ddof=1) / len(side) for side in sides)
    freedom = sum(len(side) - 1 for side in sides)
    return float(stats.t.ppf(1 - level / 2, freedom) * np.sqrt(variance))
