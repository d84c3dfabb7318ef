"""Runs experiments and keeps every run in a file of its own."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import shutil
import sys
import time
import traceback
from pathlib import Path

from . import synthetic
from .datasets import load_scenes, scene_options
from .engines import NO_DEPTH, Engine, MappingJob
from .errors import BenchmarkError
from .evaluation import evaluate
from .experiment import SCENE_FACTS, Experiment, dataset_path
from .files import empty_folder, file_digest, slug, value_digest, write_json
from .preparation import Preparation
from .scene import Scene


@dataclasses.dataclass(frozen=True)
class Settings:
    """Where things are, and how many runs go on at a time."""

    data_folder: Path
    work_folder: Path
    program: Path
    num_jobs: int
    # Repeat runs that are there already.
    fresh: bool = False


@dataclasses.dataclass(frozen=True)
class Run:
    """One mapper on one scene with one seed."""

    experiment: Experiment
    dataset: dict
    scene: Scene
    engine: Engine
    seed: int
    database: Path
    image_folder: Path
    folder: Path

    def key(self) -> dict:
        """All that determines the result."""
        return {
            "database": file_digest(self.database),
            "engine": value_digest(self.engine.spec),
            "version": self.engine.version(),
            "seed": self.seed,
            "threads": self.experiment.threads,
            "thresholds_deg": list(self.experiment.thresholds_deg),
            "truth": _truth_digest(self.scene),
            "depth_unit": self.scene.depth_unit(self.engine.depth),
        }


def run_experiment(experiment: Experiment, settings: Settings) -> list[dict]:
    """Runs what has no valid result yet; returns the records of all runs, in
    the order of data set, scene, engine and seed."""
    runs = []
    for dataset in experiment.datasets:
        runs += _prepare_runs(experiment, dataset, settings)
    with concurrent.futures.ThreadPoolExecutor(settings.num_jobs) as pool:
        return list(pool.map(lambda run: _run(run, settings), runs))


def subset_scenes(scenes: list[Scene], every: list[int]) -> list[Scene]:
    """Scenes of every n-th image, by name, for each n of ``every``."""
    subsets = []
    for scene in scenes:
        for step in every:
            names = sorted(scene.truth)[::step]
            # Two images leave the unit open, and are no use to averaging.
            if step > 1 and len(names) < 3:
                continue
            subsets.append(
                dataclasses.replace(
                    scene,
                    name=scene.name if step == 1 else f"{scene.name}/{step}",
                    truth={name: scene.truth[name] for name in names},
                    parameters={**scene.parameters, "every": step},
                )
            )
    return subsets


def _truth_digest(scene):
    poses = {
        name: [pose.rotation.tolist(), pose.translation.tolist()]
        for name, pose in scene.truth.items()
    }
    return value_digest([poses, scene.position_accuracy])


def _prepare_runs(experiment, dataset, settings):
    folder = settings.work_folder / experiment.name / slug(dataset["name"])
    preparation = Preparation(
        folder / "prepared",
        settings.program,
        dataset.get("max_image_size", 0),
        settings.num_jobs,
    )
    seeds = dataset.get("seeds", experiment.seeds)
    if dataset["layout"] == "synthetic":
        scenes_by_seed = {
            seed: synthetic.create_scenes(
                dataset, seed, folder / "scenes", settings.program
            )
            for seed in seeds
        }
    else:
        scenes = load_scenes(
            dataset["layout"], dataset_path(dataset, settings.data_folder),
            dataset,
        )  # fmt: skip
        scenes = subset_scenes(scenes, dataset.get("every", [1]))
        scenes_by_seed = {seed: scenes for seed in seeds}
        preparation.prepare_collections(scenes)
    runs = []
    for seed, scenes in scenes_by_seed.items():
        for scene in scenes:
            runs += _scene_runs(
                experiment, dataset, scene, seed, preparation, folder, settings
            )
    return sorted(
        runs, key=lambda r: (r.scene.name, r.engine.name, r.seed)
    )


def _scene_runs(
    experiment, dataset, scene, seed, preparation, folder, settings
):
    options = scene_options(dataset, scene.name)
    scene = dataclasses.replace(
        scene, **{key: options[key] for key in SCENE_FACTS if key in options}
    )
    depth_options = options.get("depth_options", {})
    # Synthetic scenes are drawn anew for each seed.
    place = folder if dataset["layout"] != "synthetic" else folder / str(seed)
    preparation = dataclasses.replace(preparation, folder=place / "prepared")
    runs = []
    for spec in experiment.engines:
        engine = Engine(spec, settings.program).on_scene(scene)
        if engine is None or seed not in spec.get("seeds", [seed]):
            continue
        if engine.depth == NO_DEPTH and scene.parameters.get("depth_only"):
            continue
        x = scene.parameters.get("x")
        if x is not None and x > spec.get("max_x", x):
            continue
        database = preparation.database(
            scene,
            engine.depth,
            depth_options.get(engine.depth, []),
            scene.merge_cameras or engine.one_camera,
            engine.spec.get("depth_change"),
        )
        runs.append(
            Run(
                experiment,
                dataset,
                scene,
                engine,
                seed,
                database,
                preparation.image_folder(scene),
                folder / "runs" / slug(scene.name) / slug(engine.name)
                / str(seed),
            )  # fmt: skip
        )
    return runs


def _run(run: Run, settings: Settings) -> dict:
    record_path = run.folder / "run.json"
    try:
        key = run.key()
    except BenchmarkError as error:
        return _record(run, {}, {"status": "failed", "reason": str(error)})
    if record_path.exists() and not settings.fresh:
        record = _read_record(record_path)
        if record is not None and record["key"] == key:
            # What the experiment says of the scene may have changed.
            return {**record, **_description(run)}
    empty_folder(run.folder)
    start = time.monotonic()
    try:
        outcome = _map_and_evaluate(run)
    except BenchmarkError as error:
        outcome = {"status": "failed", "reason": str(error)}
    except Exception:  # A defect of one run must not end all others.
        traceback.print_exc()
        outcome = {"status": "failed", "reason": "defect of the benchmark"}
    record = _record(run, key, outcome)
    write_json(record_path, record)
    _print_progress(record, time.monotonic() - start)
    return record


def _map_and_evaluate(run: Run) -> dict:
    database = run.folder / "database.db"
    shutil.copyfile(run.database, database)
    output = empty_folder(run.folder / "models")
    job = MappingJob(
        database,
        run.image_folder,
        output,
        run.folder / "log.txt",
        run.experiment.threads,
        run.seed,
    )
    stages, usage = {}, None
    try:
        stages, usage = run.engine.map(job)
        reason = ""
    except BenchmarkError as error:
        # A mapper that fails may have left a model, which does not count.
        # Where it ran says nothing to others.
        reason = str(error).replace(f"{run.folder}/", "")
    finally:
        database.unlink()
    outcome = {
        "stages": {
            name: dataclasses.asdict(stage) for name, stage in stages.items()
        }
    }
    if usage is not None:
        outcome.update(dataclasses.asdict(usage))
    outcome["metrics"] = evaluate(
        run.scene, output, run.experiment.thresholds_deg, not reason
    )
    if not reason:
        outcome["metrics"].update(run.engine.own_metrics(output))
        outcome["metrics"].update(_scale_error(run, outcome["metrics"]))
    if not reason and outcome["metrics"]["num_models"] == 0:
        reason = "no model"
    outcome["status"] = "failed" if reason else "ok"
    outcome["reason"] = reason
    return outcome


def _scale_error(run: Run, metrics: dict) -> dict[str, float]:
    """By how much the unit of depth comes out wrong; 0.01 is 1 %."""
    unit = run.scene.depth_unit(run.engine.depth)
    if run.engine.depth == NO_DEPTH or unit is None or "scale" not in metrics:
        return {}
    if "depth_change" in run.engine.spec:
        return {}
    return {"scale_error": abs(metrics["scale"] / unit - 1)}


def _record(run: Run, key: dict, outcome: dict) -> dict:
    return {**_description(run), "key": key, **outcome}


def _description(run: Run) -> dict:
    return {
        "experiment": run.experiment.name,
        "dataset": run.dataset["name"],
        "scene": run.scene.name,
        "engine": run.engine.name,
        "seed": run.seed,
        "parameters": run.scene.parameters,
        "depth": run.engine.depth,
        "uses_depth": run.engine.depth != NO_DEPTH,
        "is_metric": run.scene.is_metric,
        "role": run.scene.role,
        "thresholds_deg": list(run.experiment.thresholds_deg),
        "min_threshold_deg": run.scene.min_threshold_deg,
    }


def _read_record(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


def _print_progress(record: dict, seconds: float) -> None:
    auc = record.get("metrics", {}).get("auc", [])
    print(
        f"{record['experiment']} {record['scene']} | {record['engine']} | "
        f"seed {record['seed']}: "
        + " / ".join(f"{value:.1f}" for value in auc)
        + (f" ({record['reason']})" if record["reason"] else "")
        + f" [{seconds:.0f} s]",
        file=sys.stderr,
        flush=True,
    )
