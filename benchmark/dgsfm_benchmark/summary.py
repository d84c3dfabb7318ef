"""What the results say in short: sentences filled with figures, one table for
the page, one for README.md. A sentence without runs is left out."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable

import numpy as np

from . import tables
from .statistics import (
    Difference,
    Record,
    auc_at,
    run_difference,
    scale_error,
    scene_means,
    scenes,
    summarize,
    variant_of,
)
from .tables import fit_exponent, main_threshold, of_engine, of_role

NO_DEPTH = "no depth"
STRONG = "emulated strong depth"
COLMAP = ("COLMAP global", "COLMAP incremental")
EXPERT = "COLMAP, expert settings"
_DEPTHS = ("small network", STRONG, "sensor depth")
# Ablation switches that take self-calibration away, the widest first.
_SELF_CALIBRATION = ("no self-calibration", "fixed principal points")
# Points an image from which key points alone say enough.
_RICH_TEXTURE = 500

Results = dict[str, dict]

FITTED_ON = (
    "Constants are fitted on sets of role “fit” alone (`docs/constants.md`), those "
    "of role “report” are only looked at."
)
WHAT_IS_EMULATED = (
    "“Emulated strong depth” is made from ground truth, with the errors of a "
    "strong monocular network; “small network” is the depth of a real but tiny "
    "one, “sensor depth” that of RGB-D cameras, both real."
)
EXPERT_TEXT = (
    "“COLMAP, expert settings” is COLMAP's global mapper in the hands of a "
    "user who knows the set: one camera entry where one camera took all images, and "
    "free principal points in a last bundle adjustment."
)


def records_of(results: Results, name: str) -> list[Record]:
    """Records of an experiment, those of its first key points only: other key
    points of the same images would count them twice."""
    result = results.get(name)
    if not result:
        return []
    return [r for r in result["records"] if "ALIKED" not in r["dataset"]]


def engines_of(result: dict) -> list[str]:
    """Names of the engines that have runs, in the order of the experiment."""
    found = {r["engine"] for r in result["records"]}
    return [s["name"] for s in result["engines"] if s["name"] in found]


def _difference(records, a, b, value) -> Difference | None:
    try:
        return run_difference(
            of_engine(records, a), of_engine(records, b), value
        )
    except ValueError:
        return None


def _threshold(results: Results, name: str, idx: int) -> str:
    return f"AUC@{results[name]['thresholds_deg'][idx]:g}"


def _and(texts: Iterable[str]) -> str:
    texts = list(texts)
    if len(texts) < 2:
        return "".join(texts)
    return f"{', '.join(texts[:-1])} and {texts[-1]}"


def _changes(records, a, b, value) -> str:
    """The change from A to B: of each role, and the verdict over all
    scenes."""
    overall = _difference(records, a, b, value)
    if overall is None:
        return ""
    parts = []
    for role in tables.roles_of(records):
        change = _difference(of_role(records, role), a, b, value)
        if change:
            parts.append(
                f"{change.mean:+.1f} on {scenes(change.num_scenes)} of role "
                f"“{role}”"
            )
    return f"{_and(parts)}, over all {overall.verdict()}"


def accuracy_sentence(results: Results) -> str:
    """Means of each role against COLMAP's mappers."""
    records = records_of(results, "real_photos")
    if not records:
        return ""
    thresholds = results["real_photos"]["thresholds_deg"]
    idx = main_threshold(thresholds)
    parts = []
    for role in tables.roles_of(records):
        own = of_role(records, role)
        complete = _complete_engines(own)
        means = {
            engine: summarize(of_engine(own, engine), auc_at(thresholds, idx))
            for engine in (NO_DEPTH, STRONG, *COLMAP, EXPERT)
            if engine in complete
        }
        if means:
            number = next(iter(means.values())).num_scenes
            parts.append(
                f"on {scenes(number)} of role “{role}” "
                + _and(f"{m.text()} ({name})" for name, m in means.items())
            )
    return f"**Accuracy**, mean AUC@{thresholds[idx]:g}: {'; '.join(parts)}."


def calibration_sentence(results: Results) -> str:
    """The gain without depth on images of unknown intrinsics, and what it is
    without self-calibration."""
    parts = []
    records = records_of(results, "real_photos")
    if records:
        value = auc_at(results["real_photos"]["thresholds_deg"], 0)
        gain = _changes(records, COLMAP[0], NO_DEPTH, value)
        expert = _changes(records, COLMAP[0], EXPERT, value)
        if gain:
            name = _threshold(results, "real_photos", 0)
            parts.append(
                f"{name} without depth against COLMAP's global mapper {gain}"
            )
        if expert:
            parts.append(f"expert settings give COLMAP {expert}")
    parts += _calibration_ablation(results)
    if not parts:
        return ""
    return (
        "**Self-calibration**, on photos of cameras that nobody calibrated: "
        + "; ".join(parts)
        + "."
    )


def _calibration_ablation(results: Results) -> list[str]:
    result = results.get("ablation")
    if not result:
        return []
    value = auc_at(result["thresholds_deg"], 0)
    records = [
        r for r in result["records"] if not r["parameters"].get("family")
    ]
    for switch in _SELF_CALIBRATION:
        loss = _changes(records, result["reference"], switch, value)
        if loss:
            name = _threshold(results, "ablation", 0)
            return [f"the ablation “{switch}” changes {name} by {loss}"]
    return []


def depth_sentence(results: Results) -> str:
    """What each kind of depth adds on full sets, and where little else speaks
    for the poses."""
    gains: dict[str, list[str]] = {}
    for name in ("real_photos", "depth_decides"):
        result = results.get(name)
        if not result:
            continue
        value = auc_at(
            result["thresholds_deg"], main_threshold(result["thresholds_deg"])
        )
        topics: dict[str, list[Record]] = {}
        for record in records_of(results, name):
            topics.setdefault(_topic(name, record), []).append(record)
        for topic, records in topics.items():
            for engine in _DEPTHS:
                gain = _difference(records, NO_DEPTH, engine, value)
                if gain:
                    gains.setdefault(engine, []).append(
                        f"{gain.mean:+.1f} on {topic} ({gain.num_scenes})"
                    )
    if not gains:
        return ""
    parts = [f"{engine} {_and(texts)}" for engine, texts in gains.items()]
    return (
        "**Depth**, mean change of AUC@5 against no depth (scenes): "
        + "; ".join(parts)
        + "."
    )


def _topic(name: str, record: Record) -> str:
    """Coarser than the groups of the plot: for a sentence."""
    parameters = record.get("parameters", {})
    number, _, unit = parameters.get("level", "").partition(" ")
    if unit == "images":
        return f"synthetic scenes of {number} images"
    if unit == "points" and number.isdigit() and int(number) < _RICH_TEXTURE:
        return "synthetic scenes of little texture"
    if parameters.get("family"):
        return "synthetic scenes"
    if parameters.get("every", 1) > 1:
        return "every second to fourth image"
    return _hardness(name, record)


def depth_groups(
    name: str, records: list[Record]
) -> list[tuple[str, list[Record]]]:
    """Records by what makes a scene hard."""
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(_hardness(name, record), []).append(record)
    return list(groups.items())


def _hardness(name: str, record: Record) -> str:
    parameters = record.get("parameters", {})
    if name == "real_photos":
        return "full sets"
    if parameters.get("level"):
        return f"synthetic scenes, {parameters['level']}"
    if parameters.get("every", 1) > 1:
        return f"every {_ordinal(parameters['every'])} image"
    return record["dataset"]


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third"}.get(number, f"{number}th")


def scale_sentence(results: Results) -> str:
    """The error of the unit, by kind of depth."""
    records = records_of(results, "real_photos")
    parts = []
    for engine in _DEPTHS:
        errors = scene_means(of_engine(records, engine), scale_error)
        if errors:
            values = list(errors.values())
            parts.append(
                f"{np.median(values):.1f} % with {engine} (at most "
                f"{max(values):.1f} %, {scenes(len(values))})"
            )
    if not parts:
        return ""
    return (
        "**Scale**, without any alignment: the median error of the unit is "
        + _and(parts)
        + "."
    )


def _medians(records: list[Record], engine: str, key: str) -> dict[str, float]:
    values: dict[str, list[float]] = {}
    for record in of_engine(records, engine):
        if key in record:
            values.setdefault(variant_of(record)[1], []).append(record[key])
    return {scene: float(np.median(v)) for scene, v in sorted(values.items())}


def speed_sentence(results: Results) -> str:
    """Seconds beside COLMAP's mappers, and growth with the number of
    images."""
    parts = []
    result = results.get("speed")
    if result:
        for engine in engines_of(result):
            times = _medians(result["records"], engine, "seconds")
            parts.append(
                _and(f"{seconds:.1f}" for seconds in times.values())
                + f" s ({engine})"
            )
        names = _and(sorted({variant_of(r)[1] for r in result["records"]}))
        threads = f"with {result.get('threads', 1)} thread(s)"
        parts = [f"{threads} {names} take {', '.join(parts)}"]
    growth = _growth(results)
    if growth:
        parts.append(growth)
    return "**Time**: " + "; ".join(parts) + "." if parts else ""


def _growth(results: Results) -> str:
    result = results.get("scaling")
    if not result:
        return ""
    engine = result["engines"][0]["name"]
    values: dict[float, list[float]] = {}
    for record in of_engine(result["records"], engine):
        if "seconds" in record:
            x = record["parameters"]["x"]
            values.setdefault(x, []).append(record["seconds"])
    if len(values) < 2:
        return ""
    x = sorted(values)
    exponent = fit_exponent(x, [float(np.median(values[v])) for v in x])
    return (
        f"from {x[0]:g} to {x[-1]:g} images time grows with the power "
        f"{exponent:.2f}"
    )


SENTENCES: tuple[Callable[[Results], str], ...] = (
    accuracy_sentence,
    calibration_sentence,
    depth_sentence,
    scale_sentence,
    speed_sentence,
)


def wrapped(text: str, indent: str = "") -> list[str]:
    """A paragraph as lines of at most 80 characters."""
    return textwrap.wrap(
        text,
        80,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def sentences(results: Results) -> list[str]:
    """The sentences that there are runs for, as a list."""
    lines = []
    for make in SENTENCES:
        text = make(results)
        lines += wrapped(f"- {text}", "  ") if text else []
    return lines


def overview_table(results: Results) -> list[str]:
    """One row an engine, the roles beside each other. Engines that have not
    run on all scenes have their gain over no depth instead."""
    result = results.get("real_photos")
    if not result:
        return []
    records = records_of(results, "real_photos")
    thresholds = result["thresholds_deg"]
    columns: list[_RoleColumn | _ScaleColumn] = []
    for role in tables.roles_of(records):
        own = of_role(records, role)
        columns += [
            _RoleColumn(own, role, thresholds, i)
            for i in sorted({0, main_threshold(thresholds)})
        ]
        columns.append(_ScaleColumn(own, role))
    rows = [
        [engine, *(column.cell(engine) for column in columns)]
        for engine in engines_of(result)
    ]
    return tables.markdown(["engine", *(c.title for c in columns)], rows)


class _ScaleColumn:
    """Median errors of the unit over scenes of a role."""

    def __init__(self, records, role):
        self._records = records
        self.title = f"{role}: scale error"

    def cell(self, engine: str) -> str:
        errors = scene_means(of_engine(self._records, engine), scale_error)
        return f"{np.median(list(errors.values())):.1f} %" if errors else ""


def _complete_engines(records: list[Record]) -> list[str]:
    """Engines that ran on all scenes."""
    variants = {variant_of(r) for r in records}
    return [
        engine
        for engine in dict.fromkeys(r["engine"] for r in records)
        if {variant_of(r) for r in of_engine(records, engine)} == variants
    ]


class _RoleColumn:
    """Means of a figure over all scenes of a role."""

    def __init__(self, records, role, thresholds, idx):
        self._all = records
        self._value = auc_at(thresholds, idx)
        self._complete = _complete_engines(records)
        number = summarize(records, self._value).num_scenes
        self.title = f"{role}: AUC@{thresholds[idx]:g} (n = {number})"

    def cell(self, engine: str) -> str:
        if engine in self._complete:
            return summarize(of_engine(self._all, engine), self._value).text()
        gain = _difference(self._all, NO_DEPTH, engine, self._value)
        if gain is None:
            return ""
        return f"no depth {gain.mean:+.1f} on {scenes(gain.num_scenes)}"


def readme_table(results: Results) -> list[str]:
    """One row a real set: AUC at the smallest and the main threshold."""
    result = results.get("real_photos")
    if not result:
        return []
    records = records_of(results, "real_photos")
    thresholds = result["thresholds_deg"]
    found = set(engines_of(result))
    engines = [
        e for e in (STRONG, "sensor depth", NO_DEPTH, *COLMAP, EXPERT)
        if e in found
    ]  # fmt: skip
    rows = []
    for role in tables.roles_of(records):
        own = of_role(records, role)
        for variant in dict.fromkeys(map(variant_of, own)):
            runs = [r for r in own if variant_of(r) == variant]
            cells = [
                _auc_pair(of_engine(runs, e), thresholds) for e in engines
            ]
            rows.append([variant[1], role, *cells])
    titles = [e if "COLMAP" in e else f"this, {e}" for e in engines]
    return tables.markdown(["set", "role", *titles], rows)


def _auc_pair(runs: list[Record], thresholds: list[float]) -> str:
    if not runs:
        return ""
    texts = [
        summarize(runs, auc_at(thresholds, i)).text() or "-"
        for i in sorted({0, main_threshold(thresholds)})
    ]
    return " / ".join(texts)


def provenance(results: Results) -> str:
    """When and with what the runs behind the sentences were made."""
    names = ["real_photos", "depth_decides", "ablation", "speed", "scaling"]
    texts = [
        f"`{name}` of {results[name]['date']} at commit "
        f"{results[name].get('commit', 'unknown')}"
        for name in names
        if name in results
    ]
    return f"Runs: {_and(texts)}."


def _colmap_version(result: dict) -> str:
    found = {
        version
        for engine, version in result.get("versions", {}).items()
        if "COLMAP" in engine
    }
    return f"COLMAP is {_and(sorted(found))}. " if found else ""


def readme_lines(results: Results) -> list[str]:
    """The block of README.md."""
    result = results.get("real_photos")
    if not result:
        return ["No runs are stored yet."]
    thresholds = result["thresholds_deg"]
    pair = " / ".join(
        f"{thresholds[i]:g}" for i in sorted({0, main_threshold(thresholds)})
    )
    texts = [WHAT_IS_EMULATED]
    if EXPERT in engines_of(result):
        texts.append(EXPERT_TEXT)
    texts.append(
        _colmap_version(result)
        + FITTED_ON + " “-”: the truth does not bear the figure; "
        "empty: no such depth."
    )
    return [
        *wrapped(
            f"Pairwise pose AUC at {pair} degrees on real photos, the same "
            "database for all, means over seeds:"
        ),
        "",
        *readme_table(results),
        "",
        *wrapped(" ".join(texts)),
        "",
        *sentences(results),
        "",
        *wrapped(provenance(results)),
    ]
