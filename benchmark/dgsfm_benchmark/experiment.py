"""Experiments: what is run, as written in a TOML file.

    title = "Real photos"        # heading on the page of results
    text = "..."                 # what the reader should know
    seeds = [0, 1, 2]
    threads = 1                  # of each mapper
    thresholds_deg = [1, 3, 5]   # of the pose AUC
    reference = "name"           # engine that others are compared with: in an
                                 # ablation, or in time and memory
    plot = { x = "log_noise", ... }   # see plots.py

    [[dataset]]                  # one or more
    name = "eth3d"
    layout = "eth3d"             # a loader of datasets.py, or "synthetic"
    path = "eth3d"               # in the data folder, or in the project if it
                                 # starts with "../" or "./"
    max_image_size = 1600        # larger images are reduced [px]; 0 = never
    every = [1, 2]               # also every second image as a scene of its own
    seeds = [0]                  # instead of the experiment's
    role = "fit"                 # constants may be chosen on it; "report",
                                 # the default: it is only looked at
    scene_file = "../data_sets/shared.toml"  # with [scene.NAME] tables, for
                                 # all experiments on the same data
    [dataset.scene.NAME]         # options of a scene, over those of the file
                                 # and of the set; also those of its loader
    is_metric = false            # truth and depth maps have different units
    depth_units = { depth_meter = 1000 }  # truth units per unit of this depth
    min_threshold_deg = 5        # what the truth can bear: the AUC up to less
                                 # says nothing
    single_camera = true         # one camera took all images
    merge_cameras = true         # and the database says so
    like = "NAME"                # another scene, of whose folder this is, too
    depth_options = { depth_sensor = ["--depth_scale", "0.001"] }

    [[engine]]                   # one or more
    name = "DGSfM"
    type = "dgsfm"               # see engines.py
"""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

from .errors import BenchmarkError

PROJECT = Path(__file__).resolve().parents[2]

ROLES = ("fit", "report")
# Fields of Scene that an experiment may set ...
SCENE_FACTS = {
    "is_metric", "depth_units", "role", "min_threshold_deg", "single_camera",
    "merge_cameras",
}  # fmt: skip
# ... and all else that may be said of a scene: to its loader and importer.
SCENE_OPTIONS = SCENE_FACTS | {
    "folder", "database", "truth", "images", "position_accuracy",
    "depth_options", "exif_error",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Experiment:
    """An experiment file; ``datasets`` and ``engines`` are its tables."""

    name: str  # of the file
    title: str
    text: str
    seeds: tuple[int, ...]
    threads: int
    thresholds_deg: tuple[float, ...]
    reference: str | None
    plot: dict | None
    datasets: tuple[dict, ...]
    engines: tuple[dict, ...]


def read_experiment(path: Path) -> Experiment:
    """Reads and checks a file; raises BenchmarkError with its name."""
    try:
        values = tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise BenchmarkError(f"experiment '{path}': {error}") from error
    known = {
        "title", "text", "seeds", "threads", "thresholds_deg", "reference",
        "plot", "dataset", "engine",
    }  # fmt: skip
    _check_keys(path, values, known, required={"dataset", "engine"})
    for dataset in values["dataset"]:
        _check_keys(path, dataset, None, required={"name", "layout"})
        dataset["scene"] = _scene_tables(path, dataset)
        for table in (dataset, *dataset["scene"].values()):
            if table.get("role", "fit") not in ROLES:
                raise BenchmarkError(
                    f"experiment '{path}': role '{table['role']}' must be one "
                    f"of {', '.join(ROLES)}"
                )
    for engine in values["engine"]:
        _check_keys(path, engine, None, required={"name", "type"})
    names = [engine["name"] for engine in values["engine"]]
    if len(set(names)) != len(names):
        raise BenchmarkError(f"experiment '{path}' has two engines of one name")
    reference = values.get("reference")
    if reference is not None and reference not in names:
        raise BenchmarkError(
            f"experiment '{path}': reference '{reference}' is no engine"
        )
    return Experiment(
        name=path.stem,
        title=values.get("title", path.stem),
        text=values.get("text", "").strip(),
        seeds=tuple(values.get("seeds", [0])),
        threads=values.get("threads", 1),
        thresholds_deg=tuple(values.get("thresholds_deg", [1, 3, 5])),
        reference=reference,
        plot=values.get("plot"),
        datasets=tuple(values["dataset"]),
        engines=tuple(values["engine"]),
    )


def with_engines(
    experiment: Experiment, names: list[str] | None
) -> Experiment:
    """The experiment with the engines of these names alone; all, if None.

    Raises BenchmarkError where it has no engine of a name.
    """
    if names is None:
        return experiment
    known = [engine["name"] for engine in experiment.engines]
    for name in names:
        if name not in known:
            raise BenchmarkError(
                f"experiment '{experiment.name}' has no engine '{name}', but "
                + ", ".join(known)
            )
    return dataclasses.replace(
        experiment,
        engines=tuple(e for e in experiment.engines if e["name"] in names),
    )


def _scene_tables(path: Path, dataset: dict) -> dict[str, dict]:
    """What is said of scenes: in a file that experiments share, and here."""
    tables = {}
    if "scene_file" in dataset:
        file = path.parent / dataset["scene_file"]
        try:
            shared = tomllib.loads(file.read_text())
        except (OSError, tomllib.TOMLDecodeError) as error:
            raise BenchmarkError(f"scenes '{file}': {error}") from error
        _check_keys(file, shared, {"scene"}, required={"scene"})
        tables = shared["scene"]
    own = dataset.get("scene", {})
    tables = {
        name: {**tables.get(name, {}), **own.get(name, {})}
        for name in {**tables, **own}
    }
    merged = {
        name: _with_likeness(tables, name)
        for name in tables
        if name in dataset.get("scenes", [name])
    }
    for name, table in merged.items():
        unknown = set(table) - SCENE_OPTIONS
        if unknown:
            raise BenchmarkError(
                f"experiment '{path}': scene '{name}' has an unknown "
                f"'{min(unknown)}'"
            )
    return merged


def _with_likeness(tables: dict[str, dict], name: str) -> dict:
    table = dict(tables[name])
    like = table.pop("like", None)
    if like is None:
        return table
    return {"folder": like, **tables.get(like, {}), **table}


def dataset_path(dataset: dict, data_folder: Path) -> Path:
    """Folder of a data set: in the project or in the user's data folder."""
    path = str(dataset.get("path", dataset["name"]))
    root = PROJECT if path.startswith(("./", "../")) else data_folder
    return (root / path).resolve()


def _check_keys(path, values, known, required):
    for key in required - set(values):
        raise BenchmarkError(f"experiment '{path}' lacks '{key}'")
    for key in set(values) - (known or set(values)):
        raise BenchmarkError(f"experiment '{path}' has an unknown '{key}'")
