"""The pages of results in docs/, from the stored runs and nothing else.

docs/results.md is the overview, docs/results/NAME.md has an experiment in
detail, docs/results/paper.md the paper's tables. Blocks of README.md and of
other files in docs/ (see blocks.py) are renewed with them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from . import compare, plots, summary, tables
from .blocks import block, update_blocks
from .errors import BenchmarkError
from .experiment import PROJECT
from .files import write_text
from .paper import paper_lines
from .statistics import Record
from .storage import RUNS, described, read_runs, store_runs  # noqa: F401
from .summary import NO_DEPTH, Results, engines_of

PAGE = PROJECT / "docs" / "results.md"

_WRITTEN = (
    "Written by `scripts/benchmark.sh page` from the stored runs; do not edit."
)

_FIGURES = """\
- AUC@t: area under the recall of pairwise pose errors up to t degrees, in per
  cent; the error of a pair is the larger one of rotation and direction of
  translation, infinite if an image is missing. n is the number of scenes whose
  truth bears the threshold; where it does not, the figure is left out.
- COLMAP's AUC: as in COLMAP's own benchmark (ordered pairs, all models).
- repeatable AUC@1: without truth, of the poses from one half of the points
  against those from the other half, over the images of the largest model; empty
  for engines that do not measure it.
- scale: what the model has to be multiplied with to fit the truth; 1 is metric.
  Scale error: by how much the unit of the depth comes out wrong.
- ± and “over seeds”: standard deviation over the seeds of one scene, which is
  how far a figure reproduces, not how far it holds for other scenes.
- A run that fails counts as zero."""

BLOCKS: dict[str, Callable[[Results], list[str]]] = {
    "readme": summary.readme_lines,
    "overview": summary.overview_table,
    "sentences": summary.sentences,
    "readme-table": summary.readme_table,
}


def write_page() -> None:
    """Writes all pages and plots."""
    results = load_results()
    for path, function in _plots(results).items():
        function(path)
    for path, text in render(results).items():
        write_text(path, text)


def load_results(path: Path = RUNS) -> Results:
    """Stored results with all that pages ask for."""
    return {
        name: described(name, result)
        for name, result in sorted(read_runs(path).items(), key=_place)
    }


def render(results: Results) -> dict[Path, str]:
    """The texts of all generated files, and of those with generated blocks."""
    texts = {PAGE: _overview(results), RUNS / "paper.md": _paper(results)}
    for name, result in results.items():
        lines = _experiment_page(name, result)
        texts[RUNS / f"{name}.md"] = "\n".join(lines).rstrip() + "\n"
    contents = {name: make(results) for name, make in BLOCKS.items()}
    others = [PROJECT / "README.md", *sorted((PROJECT / "docs").glob("*.md"))]
    for path in others:
        text = path.read_text() if path.exists() else ""
        if path not in texts and "<!-- results:" in text:
            try:
                texts[path] = update_blocks(text, contents)
            except BenchmarkError as error:
                raise BenchmarkError(f"'{path}': {error}") from error
    return texts


def _place(item: tuple[str, dict]) -> tuple[int, str]:
    name = item[0]
    order = [
        "real_photos", "depth_decides", "wrong_depth", "speed", "depth_quality",
        "ablation", "ablation_synthetic", "scaling",
    ]  # fmt: skip
    return (order.index(name) if name in order else len(order), name)


def _plots(results: Results) -> dict[Path, Callable[[Path], None]]:
    """Functions that write the plots, by their files."""
    found = {}
    if "real_photos" in results:
        found[RUNS / "accuracy.svg"] = lambda path: plots.plot_accuracy(
            results["real_photos"], path
        )
    for name in ("depth_decides", "real_photos"):
        if name in results:
            found[RUNS / "depth_gain.svg"] = (
                lambda path, name=name: plots.plot_depth_gain(
                    name, results[name], path
                )
            )
            break
    for name, result in results.items():
        if result.get("plot"):
            found[RUNS / f"{name}.svg"] = (
                lambda path, result=result: plots.plot_experiment(result, path)
            )
    return found


_OVERVIEW_PLOTS = (
    ("accuracy", "Accuracy on real photos"),
    ("depth_gain", "What depth adds"),
    ("scaling", "Time and memory against the number of images"),
)


def _overview(results: Results) -> str:
    available = {path.stem for path in _plots(results)}
    lines = ["# Results", "", _WRITTEN, ""]
    lines += [*summary.sentences(results), ""]
    lines += [*block("overview", summary.overview_table(results)), ""]
    lines += summary.wrapped(
        summary.WHAT_IS_EMULATED + " " + summary.FITTED_ON + " n is "
        "the number of scenes whose truth bears the threshold."
    )
    lines.append("")
    lines += [
        f"![{title}](results/{name}.svg)"
        for name, title in _OVERVIEW_PLOTS
        if name in available
    ]
    lines += ["", "Details:", ""]
    lines += [
        f"- [{result['title']}](results/{name}.md), {result['date']}"
        for name, result in results.items()
    ]
    lines += ["- [The paper's tables](results/paper.md)"]
    return "\n".join(lines) + "\n"


def _paper(results: Results) -> str:
    lines = paper_lines(results)
    return "\n".join([lines[0], "", _WRITTEN, *lines[1:]]).rstrip() + "\n"


def _experiment_page(name: str, result: dict) -> list[str]:
    records = result["records"]
    seeds = ", ".join(map(str, result.get("seeds", [])))
    lines = [
        f"# {result['title']}",
        "",
        *summary.wrapped(
            f"{_WRITTEN} The runs are in [{name}.json]({name}.json), made on "
            f"{result['date']} by `{result['command']}` at commit "
            f"{result.get('commit', 'unknown')}, {result['machine']}, "
            f"{result['jobs']} at a time with {result.get('threads', 1)} "
            f"thread(s) each, seeds {seeds}."
        ),
        "",
    ]
    if result.get("text"):
        lines += [result["text"], ""]
    lines += [_FIGURES, "", *summary.wrapped(compare.METHOD), ""]
    if result.get("plot"):
        lines += [f"![{result['title']}]({name}.svg)", ""]
        lines += _plot_notes(result)
        if result["plot"]["kind"] == "ablation":
            return lines
    for dataset in dict.fromkeys(r["dataset"] for r in records):
        own = [r for r in records if r["dataset"] == dataset]
        for role in tables.roles_of(own):
            lines += _dataset_tables(
                result, tables.of_role(own, role), f"{dataset}, {role}"
            )
    return lines


def _dataset_tables(result: dict, records: list[Record], title) -> list[str]:
    thresholds = result["thresholds_deg"]
    engines = engines_of({**result, "records": records})
    role = tables.ROLE_TITLES[records[0]["role"]]
    lines = [f"## {title}", "", f"{role}.", ""]
    # A sweep's mean over all levels says nothing.
    if not result.get("plot"):
        lines += [*tables.summary_table(records, engines, thresholds), ""]
        differences = tables.difference_table(
            records, _pairs(engines), thresholds
        )
        lines += [*differences, ""] if differences else []
    scales = tables.scale_table(records, engines)
    if scales:
        lines += ["Unit of the model, by kind of depth:", "", *scales, ""]
    lines += [*tables.scene_table(records, engines, thresholds), ""]
    lines += _point_lines(records, engines)
    reference = result.get("reference")
    if reference and not result.get("plot"):
        lines += [*tables.ratio_table(records, engines, reference), ""]
    return lines + [
        "Time and peak memory, medians over seeds (they differ from run to "
        "run, unlike all else here):",
        "",
        *tables.resource_table(records, engines),
        "",
    ]


def _pairs(engines: list[str]) -> list[tuple[str, str]]:
    """Engines to compare: ours with depth against none, ours against others,
    experts against beginners."""
    others = [e for e in engines if "COLMAP" in e]
    ours = [e for e in engines if e not in others]
    first = NO_DEPTH if NO_DEPTH in ours else next(iter(ours), None)
    pairs = [(NO_DEPTH, e) for e in ours if NO_DEPTH in ours and e != NO_DEPTH]
    pairs += [(e, first) for e in others if first]
    if summary.STRONG in ours and first != summary.STRONG:
        pairs += [(e, summary.STRONG) for e in others]
    if {summary.EXPERT, summary.COLMAP[0]} <= set(others):
        pairs.append((summary.COLMAP[0], summary.EXPERT))
    return pairs


def _point_lines(records, engines):
    points = tables.point_table(records, engines)
    if not points:
        return []
    return [
        "Points against laser scans: share of points, and of the scan, "
        "with a neighbour within 1, 2 and 5 cm.",
        "",
        *points,
        "",
    ]


def _plot_notes(result: dict) -> list[str]:
    notes = {
        "depth_quality": _level_tables,
        "ablation": _ablation_tables,
        "scaling": _scaling_tables,
    }
    return notes[result["plot"]["kind"]](result)


def _level_tables(result):
    lines = []
    for reference in result["plot"]["references"]:
        lines += [
            f"Against “{reference}”, over the families (depth of all levels is "
            "emulated):",
            "",
            *tables.level_table(
                result["records"], reference, result["thresholds_deg"]
            ),
            "",
        ]
    return lines


def _scaling_tables(result):
    lines = []
    for spec in result["engines"]:
        runs = tables.of_engine(result["records"], spec["name"])
        table = tables.scaling_table(runs) if spec.get("verify_first") else []
        if table:
            lines += [
                f"“{spec['name']}”: processor time of all threads and peak "
                "memory by stage, medians over seeds, and the exponents fitted "
                "to them:",
                "",
                *table,
                "",
            ]
    return lines


def _ablation_tables(result):
    records, thresholds = result["records"], result["thresholds_deg"]
    reference = result["reference"]
    switches = [e for e in engines_of(result) if e != reference]
    lines = [
        *summary.wrapped(
            f"Each row is “{reference}” with one thing changed, and changes "
            f"are against “{reference}”. Worth: on how many scenes, subsets "
            f"counted as such, “{reference}” is better or worse by more than "
            f"the noise of seeds (95 %, {tables.MIN_CHANGE} points at least), "
            "of all, at the finest AUC that the truth bears. Mean, worst case "
            "and verdict are over scenes; time is the geometric mean of ratios. "
            "Each verdict is of its row alone: of twenty switches without any "
            "effect one gets “higher” or “lower” by chance."
        ),
        "",
    ]
    for role in tables.roles_of(records):
        own = tables.of_role(records, role)
        lines += [
            f"## {tables.ROLE_TITLES[role]}",
            "",
            *tables.ablation_table(own, switches, reference, thresholds),
            "",
            *tables.ablation_changes(own, switches, reference, thresholds),
            "",
        ]
    return [
        *lines,
        *_worthless_lines(result, switches),
        "",
        *_depth_kinds(records, reference),
    ]


def _worthless_lines(result: dict, switches: list[str]) -> list[str]:
    arguments = (
        result["records"], switches, result["reference"],
        result["thresholds_deg"],
    )  # fmt: skip
    each = tables.worthless(*arguments)
    more = [
        name
        for name in tables.worthless(*arguments, together=True)
        if name not in each
    ]
    lines = [
        "## Worth nothing anywhere",
        "",
        *summary.wrapped(
            "Switches that change neither an AUC nor the scale error of any "
            "scene by more than the noise of seeds "
            f"({tables.MIN_CHANGE} at least):"
        ),
        "",
        *([f"- {name}" for name in each] or ["None."]),
    ]
    if more:
        lines += [
            "",
            *summary.wrapped(
                "Switches of which the same holds if noise is bounded for all "
                "scenes and figures together (Bonferroni), as some changes "
                "exceed their own bounds by chance:"
            ),
            "",
            *(f"- {name}" for name in more),
        ]
    return lines


def _depth_kinds(records: list[Record], reference: str) -> list[str]:
    kinds: dict[str, list[str]] = {}
    for record in tables.of_engine(records, reference):
        names = kinds.setdefault(record["depth"], [])
        if record["scene"] not in names:
            names.append(record["scene"])
    lines = [f"Depth that “{reference}” had:", ""]
    return lines + [
        f"- {tables.DEPTH_TITLES.get(kind, kind)}: {', '.join(names)}"
        for kind, names in kinds.items()
    ]
