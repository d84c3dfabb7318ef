"""Results of experiments as files.

A result is a dict: date, command, machine, commit and jobs of the runs, what
the experiment file said then (see ``definition``), engines, data sets, and the
records of the runner.

docs/results/NAME.json holds one result as the pages need it, rounded, one line
per run, so that a change of runs is a readable change of the file. Any other
file holds results whole: those of "run --output FILE".
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from .errors import BenchmarkError
from .experiment import PROJECT, Experiment, read_experiment
from .files import rounded, write_json, write_text

RUNS = PROJECT / "docs" / "results"
EXPERIMENTS = PROJECT / "benchmark" / "experiments"

# CPU seconds below which a stage is not kept.
_MIN_STAGE_SECONDS = 0.01

# Titles of kinds of depth, as readers should meet them.
DEPTH_TITLES = {
    "none": "none",
    "depth": "emulated strong depth",
    "depth_meter": "small network",
    "depth_sensor": "sensor depth",
    "database": "emulated depth",
}
_DEFINITION = (
    "title", "text", "seeds", "threads", "thresholds_deg", "reference", "plot",
)  # fmt: skip
_ABOUT = (
    "date", "command", "machine", "commit", "jobs", "versions", *_DEFINITION,
)  # fmt: skip
# Of a scene, not of a run; with the values that need no mention.
_SCENE_DEFAULTS = {
    "role": "report",
    "is_metric": True,
    "min_threshold_deg": 0,
    "parameters": {},
}
# Columns of runs and their decimals; negative: significant digits.
_METRICS = {
    "num_registered": 0,
    "num_models": 0,
    "scale": -4,
    "scale_error": -3,
    "repeatable_auc_1": 2,
    "num_points": 0,
    "mean_track_length": 2,
}
_USAGE = {"seconds": -3, "cpu_seconds": -3, "peak_memory_mb": 0}
# An ablation has by far the most runs, and its page no use for the rest; so
# have sweeps of synthetic scenes.
_ABLATION_COLUMNS = {"auc", "scale_error", "seconds", "reason"}
_NOT_OF_SWEEPS = {
    "cpu_seconds", "num_points", "mean_track_length", "colmap_auc",
}  # fmt: skip


def definition(experiment: Experiment) -> dict:
    """What the pages say of an experiment, to be kept with its runs."""
    return {key: getattr(experiment, key) for key in _DEFINITION}


def read_runs(path: Path = RUNS) -> dict[str, dict]:
    """Results by experiment, of a folder or a file; empty if there are none."""
    if path.is_dir():
        results = {}
        for file in sorted(path.glob("*.json")):
            results.update(read_runs(file))
        return results
    if not path.exists():
        return {}
    try:
        values = json.loads(path.read_text())
        if "experiments" in values:
            return values["experiments"]
        return {values["experiment"]: _unpack(values)}
    except (OSError, ValueError, KeyError) as error:
        raise BenchmarkError(f"'{path}' holds no runs: {error}") from error


def store_runs(results: dict[str, dict], path: Path = RUNS) -> None:
    """Writes each result to the folder, or all of them whole to a file."""
    if path.suffix == ".json":
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, {"experiments": results})
        return
    path.mkdir(parents=True, exist_ok=True)
    for name, result in results.items():
        text = pack(name, described(name, result))
        write_text(path / f"{name}.json", text)


def with_stored_runs(
    records: list[dict], stored: dict, experiment: Experiment
) -> list[dict]:
    """The records, and those of a stored result that are of the experiment's
    other engines, scene by scene."""
    ran = {record["engine"] for record in records}
    names = {engine["name"] for engine in experiment.engines} - ran
    kept = [r for r in stored.get("records", []) if r["engine"] in names]
    scenes: dict[tuple, list[dict]] = {}
    for record in [*records, *kept]:
        key = (record["dataset"], record["scene"])
        scenes.setdefault(key, []).append(record)
    return [
        record
        for key in scenes
        for record in sorted(
            scenes[key], key=lambda r: (r["engine"], r["seed"])
        )
    ]


def described(name: str, result: dict) -> dict:
    """A result with all that the pages ask for: results may be older than the
    roles of scenes and the names of engines."""
    experiment = _experiment(name)
    values = dict(result)
    if experiment is not None:
        values = {**definition(experiment), **values}
    values.setdefault("title", name)
    values.setdefault("text", "")
    values.setdefault("thresholds_deg", [1, 3, 5])
    specs = values.get("engines", [])
    titles = {
        spec["name"]: _engine_title(spec, values.get("datasets", []))
        for spec in specs
    }
    values["engines"] = [
        {**spec, "name": titles[spec["name"]]} for spec in specs
    ]
    values["versions"] = {
        **values.get("versions", {}), **_versions(result["records"], titles)
    }  # fmt: skip
    if values.get("reference") in titles:
        values["reference"] = titles[values["reference"]]
    kinds = {spec["name"]: spec.get("depth", "none") for spec in specs}
    values["records"] = [
        _described_record(record, values, experiment, titles, kinds)
        for record in result["records"]
    ]
    return values


def _experiment(name: str) -> Experiment | None:
    path = EXPERIMENTS / f"{name}.toml"
    return read_experiment(path) if path.exists() else None


def _versions(records: list[dict], titles: dict[str, str]) -> dict[str, str]:
    """Versions of the engines' programs, of runs that still say it."""
    versions: dict[str, set[str]] = {}
    for record in records:
        version = record.get("key", {}).get("version")
        if version:
            name = titles.get(record["engine"], record["engine"])
            versions.setdefault(name, set()).add(version)
    return {name: ", ".join(sorted(v)) for name, v in versions.items()}


def _engine_title(spec: dict, datasets: list[dict]) -> str:
    # A user's data set has depth of its own under the same name.
    emulated = all(
        d.get("layout") == "synthetic"
        or str(d.get("path", "")).startswith("../shared")
        for d in datasets
    )
    if spec["name"] in ("depth", "depth_meter", "depth_sensor") and emulated:
        return DEPTH_TITLES.get(str(spec.get("depth")), spec["name"])
    return spec["name"]


def _described_record(record, result, experiment, titles, kinds):
    kind = kinds.get(record["engine"], "none")
    values = {
        **_SCENE_DEFAULTS,
        "thresholds_deg": list(result["thresholds_deg"]),
        "depth": kind if isinstance(kind, str) else kind[0],
        "uses_depth": kind != "none",
        **(_scene_facts(record, experiment) if "role" not in record else {}),
        **record,
        "engine": titles.get(record["engine"], record["engine"]),
    }
    metrics = record.get("metrics", {})
    # The unit of a network's maps is not that of each truth.
    if (
        "role" not in record
        and values["is_metric"]
        and values["depth"] in ("depth", "depth_sensor", "database")
        and metrics.get("scale") is not None
    ):
        values["metrics"] = {
            **metrics, "scale_error": abs(metrics["scale"] - 1)
        }  # fmt: skip
    return values


def _scene_facts(record: dict, experiment: Experiment | None) -> dict:
    if experiment is None:
        return {}
    base = record["scene"].split("/")[0]
    for dataset in experiment.datasets:
        if dataset["name"] == record["dataset"] and base in dataset.get(
            "scenes", [base]
        ):
            facts = {**dataset, **dataset.get("scene", {}).get(base, {})}
            return {
                key: facts[key]
                for key in ("role", "min_threshold_deg")
                if key in facts
            }
    return {}


@dataclasses.dataclass(frozen=True)
class _Column:
    """One value of a run, or one value per threshold of it."""

    name: str
    decimals: int | None = None  # None: kept as it is

    def value(self, record: dict) -> object:
        metrics = record.get("metrics", {})
        if self.name == "auc":
            return _rounded_list(metrics.get("auc"), self.decimals)
        if self.name == "colmap_auc":
            return _rounded_list(metrics.get("colmap_auc"), self.decimals)
        if self.name == "stages":
            return _long_stages(record.get("stages", {}))
        if self.name == "reason":
            return record.get("reason") or None
        if self.name in _USAGE:
            return rounded(record.get(self.name), self.decimals)
        value = metrics.get(self.name)
        return value if self.decimals is None else rounded(value, self.decimals)


_COLUMNS = (
    _Column("auc", 2),
    *(_Column(name, digits) for name, digits in _METRICS.items()),
    *(_Column(name, digits) for name, digits in _USAGE.items()),
    _Column("colmap_auc", 1),
    _Column("points"),
    _Column("reason"),
    _Column("stages"),
)


def _rounded_list(values, decimals):
    return [rounded(v, decimals) for v in values] if values else None


def _long_stages(stages: dict) -> dict | None:
    """CPU seconds and megabytes of stages, where the mapper ran apart from the
    verification: only then the pages show them."""
    if "verification" not in stages:
        return None
    return {
        name: [
            rounded(stage.get("cpu_seconds", 0.0), -3),
            rounded(stage.get("peak_memory_mb", 0.0), 0),
        ]
        for name, stage in stages.items()
        if stage.get("cpu_seconds", 0.0) >= _MIN_STAGE_SECONDS
    }


def pack(name: str, result: dict) -> str:
    """A described result as the text of its file."""
    records = result["records"]
    columns = [
        column
        for column in _wanted_columns(result)
        if any(column.value(record) is not None for record in records)
    ]
    head = {
        "experiment": name,
        "about": {k: result[k] for k in _ABOUT if k in result},
        "engines": result.get("engines", []),
        "datasets": [
            {k: v for k, v in dataset.items() if k != "scene"}
            for dataset in result.get("datasets", [])
        ],
        "columns": [column.name for column in columns],
    }
    lines = [f"{_json(key)}:{_json(value)}," for key, value in head.items()]
    scenes = _group(records, lambda r: f"{r['dataset']}/{r['scene']}")
    facts = [_scene_line(key, runs) for key, runs in scenes]
    runs = [_run_lines(key, runs, columns) for key, runs in scenes]
    lines += ['"scenes":{', *_joined(facts), "},", '"runs":{', *_joined(runs)]
    return "{\n" + "\n".join(lines) + "\n}\n}\n"


def _wanted_columns(result: dict) -> list[_Column]:
    if (result.get("plot") or {}).get("kind") == "ablation":
        return [c for c in _COLUMNS if c.name in _ABLATION_COLUMNS]
    if any(d.get("layout") == "synthetic" for d in result.get("datasets", [])):
        return [c for c in _COLUMNS if c.name not in _NOT_OF_SWEEPS]
    return list(_COLUMNS)


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)


def _joined(parts: list[str]) -> list[str]:
    return [part + "," for part in parts[:-1]] + parts[-1:]


def _group(records, key) -> list[tuple[str, list[dict]]]:
    groups: dict[str, list[dict]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return list(groups.items())


def _scene_line(key: str, records: list[dict]) -> str:
    first = records[0]
    values = {"depths": sorted({r["depth"] for r in records})}
    images = [r.get("metrics", {}).get("num_images") for r in records]
    values["num_images"] = next((n for n in images if n is not None), None)
    for name, default in _SCENE_DEFAULTS.items():
        if name == "role" or first[name] != default:
            values[name] = first[name]
    if "parameters" in values:
        values["parameters"] = {
            name: value
            for name, value in first["parameters"].items()
            if value not in (None, False)
        }
    return f"{_json(key)}:{_json(values)}"


def _run_lines(key: str, records: list[dict], columns: list[_Column]) -> str:
    engines = []
    for engine, runs in _group(records, lambda r: r["engine"]):
        lines = [
            f'"{run["seed"]}":{_json(_run_values(run, columns))}'
            for run in runs
        ]
        engines.append(f"{_json(engine)}:{{" + ",\n".join(lines) + "}")
    return f"{_json(key)}:{{\n" + ",\n".join(engines) + "}"


def _run_values(record: dict, columns: list[_Column]) -> list:
    values = [column.value(record) for column in columns]
    while values and values[-1] is None:
        values.pop()
    return values


def _unpack(values: dict) -> dict:
    result = {
        **values["about"],
        "engines": values["engines"],
        "datasets": values["datasets"],
        "records": [],
    }
    specs = {spec["name"]: spec for spec in values["engines"]}
    for key, engines in values["runs"].items():
        facts = {**_SCENE_DEFAULTS, **values["scenes"][key]}
        dataset, _, scene = key.partition("/")
        for engine, runs in engines.items():
            depth = _depth_kind(specs.get(engine, {}), facts["depths"])
            for seed, cells in runs.items():
                record = _unpack_run(dict(zip(values["columns"], cells)))
                if facts["num_images"] is not None:
                    record["metrics"]["num_images"] = facts["num_images"]
                result["records"].append(
                    {
                        "experiment": values["experiment"],
                        "dataset": dataset,
                        "scene": scene,
                        "engine": engine,
                        "seed": int(seed),
                        "depth": depth,
                        "uses_depth": depth != "none",
                        "thresholds_deg": values["about"]["thresholds_deg"],
                        **{name: facts[name] for name in _SCENE_DEFAULTS},
                        **record,
                    }
                )
    return result


def _depth_kind(spec: dict, depths: list[str]) -> str:
    """The first kind that an engine wants and the scene has."""
    wanted = spec.get("depth", "none")
    wanted = wanted if isinstance(wanted, list) else [wanted]
    return next((kind for kind in wanted if kind in depths), wanted[-1])


def _unpack_run(cells: dict) -> dict:
    cells = {name: value for name, value in cells.items() if value is not None}
    reason = cells.pop("reason", "")
    stages = {
        name: {"cpu_seconds": seconds, "peak_memory_mb": memory}
        for name, (seconds, memory) in cells.pop("stages", {}).items()
    }
    usage = {name: cells.pop(name) for name in _USAGE if name in cells}
    return {
        "status": "failed" if reason else "ok",
        "reason": reason,
        "stages": stages,
        "metrics": cells,
        **usage,
    }
