"""Verification and mapping of a large database on a cluster of Dask.

    python -m dgsfm.cluster --database_path my.db --local 2
    python -m dgsfm.cluster --database_path my.db --scheduler tcp://host:8786 \\
        --output_path model --max_part_size 1000

All machines need the database under the same path, and this package or, with
--program, the program. Each piece of work is a process of the program that
reads files and writes one, which is renamed when it is complete: whatever is
killed, the same command goes on where it was, and the result is that of one
machine. What has been done is in the folder DATABASE.cluster.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import hashlib
import json
import os
import pathlib
import shutil
import sqlite3
import sys
from typing import Any, Iterator, List, Optional, Sequence

from ._cluster_runner import ClusterError, Runner, Task, call_program, tail

PAIRS_PER_SHARD = 1000
"""Pairs of a shard where --num_shards is not given: minutes of work, so that
little is lost with a worker, and starting the program does not count."""
MAX_NUM_SHARDS = 1000


class State:
    """The folder beside the database that has what has been done."""

    def __init__(self, database_path: pathlib.Path):
        self.database_path = database_path
        self.folder = database_path.with_name(database_path.name + ".cluster")
        self.folder.mkdir(exist_ok=True)

    @contextlib.contextmanager
    def lock(self) -> Iterator[None]:
        """One driver at a time, as long as its process lives."""
        with open(self.folder / "lock", "w", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise ClusterError(
                    f"another driver is at work on {self.database_path}"
                ) from None
            except OSError as error:
                print(f"No lock on {self.folder}: {error}", file=sys.stderr)
            yield

    def read(self, name: str) -> dict:
        try:
            return json.loads((self.folder / name).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}

    def write(self, name: str, value: dict) -> None:
        """Replaces a file in one step."""
        partial = self.folder / (name + ".partial")
        with open(partial, "w", encoding="utf-8") as file:
            json.dump(value, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, self.folder / name)

    def reset(self, stage: str) -> pathlib.Path:
        """An empty folder for a stage."""
        folder = self.folder / stage
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return folder

    def stamp(self) -> List[int]:
        """Differs once the database has been written."""
        status = os.stat(self.database_path)
        return [status.st_size, status.st_mtime_ns]


def count_pairs(database_path: pathlib.Path) -> int:
    """Pairs with matches."""
    uri = f"{database_path.absolute().as_uri()}?mode=ro"
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as connection:
        query = (
            "SELECT max((SELECT count(*) FROM matches WHERE rows != 0),"
            "(SELECT count(*) FROM two_view_geometries WHERE rows != 0))"
        )
        return connection.execute(query).fetchone()[0]


def options_of(project_path: Optional[str]) -> dict:
    """The arguments of a project file, and a key that changes with it."""
    if not project_path:
        return {"arguments": [], "key": ""}
    content = pathlib.Path(project_path).read_bytes()
    return {
        "arguments": ["--project_path", str(pathlib.Path(project_path).absolute())],
        "key": hashlib.sha256(content).hexdigest(),
    }


def call_here(program: str, arguments: Sequence[str], log_path: pathlib.Path) -> None:
    """Runs the program on this machine."""
    if call_program(program, arguments, str(log_path)) != 0:
        raise ClusterError(f"{arguments[0]} failed:\n{tail(str(log_path))}")


def verify(
    state: State,
    runner: Runner,
    num_shards: int = 0,
    project_path: Optional[str] = None,
    num_threads: int = 1,
) -> None:
    """Verifies all pairs in shards and stores the results in the database.

    Does nothing if that has been done since the database was last written.
    Raises ClusterError if a shard fails, or if the database is written meanwhile.
    """
    options = options_of(project_path)
    wanted = {"num_shards": num_shards, "key": options["key"]}
    plan = state.read("verification.json")
    is_same = plan.get("wanted") == wanted
    if is_same and plan["state"] == "done" and plan["stamp"] == state.stamp():
        print("Pairs are verified already", file=sys.stderr)
        return
    # Only this driver writes the database while it merges.
    is_merging = is_same and plan["state"] == "merging"
    is_going_on = is_same and plan["state"] == "shards"
    if not is_merging and not (is_going_on and plan["stamp"] == state.stamp()):
        plan = {
            "wanted": wanted,
            "state": "shards",
            "stamp": state.stamp(),
            "num_shards": num_shards or default_num_shards(state.database_path),
        }
        state.reset("shards")
        state.write("verification.json", plan)
    folder = state.folder / "shards"
    folder.mkdir(exist_ok=True)
    if plan["state"] == "shards":
        tasks = [
            shard_task(state, folder, i, plan["num_shards"], options, num_threads)
            for i in range(plan["num_shards"])
        ]
        runner.run("Verifying shards", tasks)
        if plan["stamp"] != state.stamp():
            raise ClusterError(
                f"{state.database_path} was written while its pairs were verified; "
                "run the same command again"
            )
        plan["state"] = "merging"
        state.write("verification.json", plan)
    call_here(
        runner.program,
        ["pair_geometry_merger", "--database_path", str(state.database_path),
         "--shard_paths", str(folder)],
        state.folder / "merger.log",
    )  # fmt: skip
    # The mapper writes the database, too, but not what was merged.
    merged = hashlib.sha256(json.dumps(plan, sort_keys=True).encode()).hexdigest()
    plan.update(state="done", stamp=state.stamp(), merged=merged)
    state.write("verification.json", plan)
    shutil.rmtree(folder)


def default_num_shards(database_path: pathlib.Path) -> int:
    num_pairs = count_pairs(database_path)
    return min(MAX_NUM_SHARDS, max(1, -(-num_pairs // PAIRS_PER_SHARD)))


def shard_task(
    state: State,
    folder: pathlib.Path,
    index: int,
    num_shards: int,
    options: dict,
    num_threads: int,
) -> Task:
    path = folder / f"{index:05d}.db"
    arguments = [
        "depth_geometric_verifier", *options["arguments"],
        "--database_path", str(state.database_path), "--output_path", str(path),
        "--shard_index", str(index), "--num_shards", str(num_shards),
        "--num_threads", str(num_threads),
    ]  # fmt: skip
    return Task(
        f"shard {index}", tuple(arguments), str(path), str(path.with_suffix(".log"))
    )


def map_parts(
    state: State,
    runner: Runner,
    output_path: pathlib.Path,
    max_part_size: int,
    overlap: float,
    project_path: Optional[str] = None,
    joiner_project_path: Optional[str] = None,
    num_threads: int = 1,
) -> None:
    """Maps parts of at most max_part_size images and joins their models.

    The pairs have to be verified. Raises ClusterError if a part fails.
    """
    options = options_of(project_path)
    joiner_options = options_of(joiner_project_path)
    wanted = {
        "max_part_size": max_part_size,
        "overlap": overlap,
        "key": options["key"],
        "verification": state.read("verification.json")["merged"],
    }
    joined = {"output_path": str(output_path), "key": joiner_options["key"]}
    plan = state.read("mapping.json")
    folder = state.folder / "parts"
    is_joined = plan.get("joined") == joined
    if plan.get("wanted") == wanted and is_joined and output_path.is_dir():
        print(f"Models are in {output_path} already", file=sys.stderr)
        return
    if plan.get("wanted") != wanted or not folder.is_dir():
        state.reset("parts")
        call_here(
            runner.program,
            ["view_graph_partitioner", "--database_path", str(state.database_path),
             "--output_path", str(folder), "--max_part_size", str(max_part_size),
             "--overlap", str(overlap)],
            state.folder / "partitioner.log",
        )  # fmt: skip
        # Written last: parts without it are of a driver that was killed.
        state.write("mapping.json", {"wanted": wanted})
    partition = json.loads((folder / "partition.json").read_text(encoding="utf-8"))
    lists = [folder / part["images"] for part in partition["parts"]]
    tasks = [part_task(state, path, options, num_threads) for path in lists]
    runner.run("Mapping parts", tasks)
    models = ",".join(str(path.with_suffix("")) for path in lists)
    print("Joining the models of the parts", file=sys.stderr)
    call_here(
        runner.program,
        ["model_joiner", *joiner_options["arguments"],
         "--database_path", str(state.database_path), "--input_paths", models,
         "--output_path", str(output_path)],
        state.folder / "joiner.log",
    )  # fmt: skip
    state.write("mapping.json", {"wanted": wanted, "joined": joined})
    print(f"Models are in {output_path}", file=sys.stderr)


def part_task(
    state: State, image_list: pathlib.Path, options: dict, num_threads: int
) -> Task:
    folder = image_list.with_suffix("")
    # Parts must not write the database at the same time.
    arguments = [
        "depth_global_mapper", *options["arguments"],
        "--database_path", str(state.database_path), "--output_path", str(folder),
        "--image_list_path", str(image_list), "--write_pair_statuses", "0",
        "--num_threads", str(num_threads),
    ]  # fmt: skip
    return Task(
        folder.name,
        tuple(arguments),
        str(folder / "report.json"),
        str(image_list.with_suffix(".log")),
    )


@contextlib.contextmanager
def connect(arguments: argparse.Namespace) -> Iterator[Any]:
    """The client of a scheduler, or of workers on this machine."""
    try:
        import distributed
    except ImportError as error:
        raise ClusterError(
            f"{error}; install it by: pip install 'dgsfm[cluster]'"
        ) from None
    if arguments.local:
        cluster = distributed.LocalCluster(
            n_workers=arguments.local, threads_per_worker=1, dashboard_address=":0"
        )
    else:
        cluster = contextlib.nullcontext(arguments.scheduler)
    with cluster as address, distributed.Client(address) as client:
        print(f"Dashboard: {client.dashboard_link}", file=sys.stderr)
        yield client


def parse(argv: Optional[Sequence[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m dgsfm.cluster",
        description="Verifies and maps a large database on a cluster of Dask.",
    )
    parser.add_argument("--database_path", required=True, help="COLMAP database")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--scheduler", help="address of Dask's scheduler")
    where.add_argument("--local", type=int, help="workers on this machine")
    parser.add_argument(
        "--num_shards", type=int, default=0,
        help=f"shards of verification; 0 = one for {PAIRS_PER_SHARD} pairs",
    )  # fmt: skip
    parser.add_argument(
        "--verifier_project_path", help="project file with options of verification"
    )
    parser.add_argument(
        "--output_path", help="folder of the models; without, pairs are verified only"
    )
    parser.add_argument(
        "--max_part_size", type=int, default=1000,
        help="images of a part that is mapped by itself, at most",
    )  # fmt: skip
    parser.add_argument(
        "--overlap", type=float, default=0.2,
        help="share of these that are of neighbouring parts, too",
    )  # fmt: skip
    parser.add_argument(
        "--mapper_project_path", help="project file with options of mapping"
    )
    parser.add_argument(
        "--joiner_project_path", help="project file with options of model_joiner"
    )
    parser.add_argument(
        "--num_threads", type=int, default=1,
        help="threads of a process; each thread of a Dask worker runs one",
    )  # fmt: skip
    parser.add_argument(
        "--max_attempts", type=int, default=3,
        help="how often a shard may fail before it is given up",
    )  # fmt: skip
    parser.add_argument(
        "--program", default="",
        help="path of the program colmap on all machines; empty = this package",
    )  # fmt: skip
    arguments = parser.parse_args(argv)
    if arguments.num_shards < 0 or arguments.max_attempts < 1:
        parser.error("--num_shards must be 0 or more, --max_attempts 1 or more")
    if arguments.local is not None and arguments.local < 1:
        parser.error("--local must be 1 or more")
    return arguments


def main(argv: Optional[Sequence[str]] = None) -> int:
    """Runs the driver; the exit code is 0, 1 after a failure, 2 for wrong usage."""
    arguments = parse(argv)
    try:
        database_path = pathlib.Path(arguments.database_path).absolute()
        if not database_path.is_file():
            raise ClusterError(f"{database_path}: no such database file")
        state = State(database_path)
        with state.lock(), connect(arguments) as client:
            runner = Runner(client, arguments.program, arguments.max_attempts)
            verify(
                state,
                runner,
                arguments.num_shards,
                arguments.verifier_project_path,
                arguments.num_threads,
            )
            if arguments.output_path:
                map_parts(
                    state,
                    runner,
                    pathlib.Path(arguments.output_path).absolute(),
                    arguments.max_part_size,
                    arguments.overlap,
                    arguments.mapper_project_path,
                    arguments.joiner_project_path,
                    arguments.num_threads,
                )
    except (ClusterError, OSError, sqlite3.Error) as error:
        print(f"ERROR: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
