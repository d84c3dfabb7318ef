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
    [dataset.scene.NAME]         # options of a scene, over those of the set
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
