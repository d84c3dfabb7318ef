"""Mappers that are compared, as the [[engine]] tables of an experiment.

type = "dgsfm": this project's program. depth = folder of depth maps (a key of
    Scene.depth_folders), "database" for depth that the database already has,
    or "none"; of a list of these the first one that a scene has. depth_change
    = how the maps are changed first (depth_changes.CHANGES). options =
    table of its options without the leading dashes; verify_first = true
    verifies the pairs in a program of its own, so that time and memory of the
    rest are known. With options = { measure_repeatability = 1 } runs have a
    repeatable AUC@1 as well, and their time and memory include its
    measurement.
type = "pycolmap_global", "pycolmap_incremental": COLMAP 4.x by pycolmap.
type = "pycolmap_global_expert": the former with what a user can do by hand who
    knows the set: where one camera took all images (single_camera of the
    scene) one camera entry, and a free principal point in a last bundle
    adjustment. Elsewhere it is the former: free principal points of single
    images do harm.
type = "colmap": a program of the user's. program = path; commands = list of
    argument lists in which {database}, {images}, {output}, {threads} and
    {seed} are replaced.

max_x: levels of a sweep beyond this are left out. seeds: instead of the
experiment's, for engines whose output does not depend on them.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from importlib import metadata
from pathlib import Path

from .errors import BenchmarkError
from .files import file_digest
from .process import Usage, run_program
from .scene import Scene

NO_DEPTH = "none"
# Depth that is part of the database, as of the user's own.
DATABASE_DEPTH = "database"
ALWAYS_THERE = (NO_DEPTH, DATABASE_DEPTH)
# Stages of engines that verify first: this, and the mapper as a whole.
VERIFICATION = "verification"
MAPPING = "all after"


@dataclasses.dataclass(frozen=True)
class MappingJob:
    """Input and output of one run."""

    database: Path  # private copy, may be changed
    image_folder: Path
    output: Path  # existing, empty folder for numbered models
    log: Path
    threads: int
    seed: int


@dataclasses.dataclass(frozen=True)
class Engine:
    """An [[engine]] table and the program of this project."""

    spec: dict
    program: Path

    @property
    def name(self) -> str:
        return self.spec["name"]

    @property
    def depth(self) -> str:
        """Kind of depth that it uses, of an engine from ``on_scene``."""
        return self.spec.get("depth", NO_DEPTH)

    @property
    def one_camera(self) -> bool:
        """Whether it was told that one camera took all images."""
        return self.spec.get("one_camera", False)

    def on_scene(self, scene: Scene) -> Engine | None:
        """The engine with the first kind of depth that it wants and the scene
        has, and with what it is told of the scene; None without such depth."""
        told = {}
        if self.spec["type"] == "pycolmap_global_expert":
            told["one_camera"] = scene.single_camera
        wanted = self.depth if isinstance(self.depth, list) else [self.depth]
        for kind in wanted:
            if kind in ALWAYS_THERE or scene.has_depth(kind):
                return Engine(
                    {**self.spec, **told, "depth": kind}, self.program
                )
        return None

    def version(self) -> str:
        """Changes when the program does; runs are repeated then."""
        if self.spec["type"] == "dgsfm":
            return _identity(self.program)
        if self.spec["type"] == "colmap":
            return _identity(Path(self.spec["program"]))
        return "pycolmap " + metadata.version("pycolmap")

    def map(self, job: MappingJob) -> tuple[dict[str, Usage], Usage]:
        """Runs the mapper; returns the resources of its stages and of all.

        Peaks of memory of the stages of a program are those so far.

        Raises BenchmarkError if the program fails.
        """
        mappers = {
            "dgsfm": self._map_with_depth,
            "pycolmap_global": self._map_with_pycolmap,
            "pycolmap_global_expert": self._map_with_pycolmap,
            "pycolmap_incremental": self._map_with_pycolmap,
            "colmap": self._map_with_program,
        }
        if self.spec["type"] not in mappers:
            raise BenchmarkError(
                f"engine '{self.name}': type '{self.spec['type']}' must be "
                f"one of {', '.join(mappers)}"
            )
        return mappers[self.spec["type"]](job)

    def own_metrics(self, output: Path) -> dict[str, float]:
        """Figures that the mapper itself measured in a run that succeeded.

        ``repeatable_auc_1``: AUC up to one degree, in per cent, of the poses
        from one half of the points against those from the other half, over
        the images of the largest model.
        """
        if self.spec["type"] != "dgsfm":
            return {}
        repeatability = _read_report(output).get("repeatability")
        if repeatability is None:
            return {}
        return {"repeatable_auc_1": repeatability["auc_1_3_5_deg"][0]}

    def _map_with_depth(self, job):
        arguments = [
            "--database_path", str(job.database),
            "--num_threads", str(job.threads),
            "--random_seed", str(job.seed),
        ]  # fmt: skip
        if self.depth == NO_DEPTH:
            arguments += ["--use_depth", "0"]
        stages: dict[str, Usage] = {}
        usage = Usage()
        if self.spec.get("verify_first"):
            usage = stages[VERIFICATION] = run_program(
                [str(self.program), "depth_geometric_verifier", *arguments],
                job.log,
            )
        for option, value in self.spec.get("options", {}).items():
            arguments += [f"--{option}", str(value)]
        mapping = run_program(
            [
                str(self.program), "depth_global_mapper", *arguments,
                "--output_path", str(job.output),
                # Runs share the database.
                "--write_pair_statuses", "0",
            ],
            job.log,
        )  # fmt: skip
        if self.spec.get("verify_first"):
            stages[MAPPING] = mapping
        usage += mapping
        for stage in _read_report(job.output)["stages"]:
            name = stage["stage"]
            stages[name] = stages.get(name, Usage()) + Usage(
                stage["seconds"],
                stage["cpu_seconds"],
                stage["peak_memory_mb"],
            )
        return stages, usage

    def _map_with_pycolmap(self, job):
        names = {
            "pycolmap_global": ["view_graph_calibration", "global"],
            "pycolmap_global_expert": ["view_graph_calibration", "global"],
            "pycolmap_incremental": ["incremental"],
        }[self.spec["type"]]
        if self.one_camera:
            names = [*names, "principal_point"]
        stages, usage = {}, Usage()
        for name in names:
            stage_usage = run_pycolmap(
                name,
                job.log,
                database=str(job.database),
                images=str(job.image_folder),
                output=str(job.output),
                threads=job.threads,
                seed=job.seed,
            )
            stages[name] = stage_usage
            usage += stage_usage
        return stages, usage

    def _map_with_program(self, job):
        values = {
            "database": job.database,
            "images": job.image_folder,
            "output": job.output,
            "threads": job.threads,
            "seed": job.seed,
        }
        stages, usage = {}, Usage()
        for command in self.spec["commands"]:
            arguments = [argument.format(**values) for argument in command]
            stage_usage = run_program(
                [str(self.spec["program"]), *arguments], job.log
            )
            stages[command[0]] = stage_usage
            usage += stage_usage
        return stages, usage


def run_pycolmap(stage: str, log: Path, **job) -> Usage:
    """Runs a stage of pycolmap_worker."""
    module = __name__.rsplit(".", 1)[0] + ".pycolmap_worker"
    arguments = [sys.executable, "-m", module]
    return run_program(
        [*arguments, json.dumps({"stage": stage, **job})], log
    )


def _read_report(output: Path) -> dict:
    return json.loads((output / "report.json").read_text())


def _identity(program: Path) -> str:
    if not program.exists():
        raise BenchmarkError(f"program '{program}' does not exist")
    return f"{program.name} {file_digest(program)}"
