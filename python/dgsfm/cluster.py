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
import dataclasses
import fcntl
import hashlib
import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import time
from typing import Any, Dict, Iterator, List, Optional, Sequence

PAIRS_PER_SHARD = 1000
"""Pairs of a shard where --num_shards is not given: minutes of work, so that
little is lost with a worker, and starting the program does not count."""
MAX_NUM_SHARDS = 10000
MAX_NUM_LOST_WORKERS = 100
"""Workers that a piece of work may be lost with, none of which is its fault."""
LOG_TAIL_LINES = 15


class ClusterError(RuntimeError):
    """What went wrong, and what to do."""


@dataclasses.dataclass(frozen=True)
class Task:
    """A process of the program whose result is a file."""

    name: str
    arguments: Sequence[str]
    result_path: str
    log_path: str


def run_task(
    program: str, name: str, arguments: Sequence[str], result_path: str, log_path: str
) -> str:
    """Runs a task on a worker; returns its machine.

    Raises RuntimeError with the end of the log if the program fails.
    """
    machine = os.uname().nodename
    code = call_program(program, arguments, log_path)
    if code == 0 and os.path.exists(result_path):
        return machine
    reason = f"ended by signal {-code}" if code < 0 else f"exit code {code}"
    if code == 0:
        reason = f"no file {result_path}: do all machines share its folder?"
    raise RuntimeError(f"{name} on {machine}: {reason}\n{tail(log_path)}")


def call_program(program: str, arguments: Sequence[str], log_path: str) -> int:
    """The exit code of the program, or of this package as it is on this machine."""
    command = [program] if program else [sys.executable, "-m", "dgsfm"]
    command.extend(arguments)
    with open(log_path, "a", encoding="utf-8") as log:
        log.write(f"== {os.uname().nodename}: {' '.join(command)}\n")
        log.flush()
        return subprocess.call(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT
        )


def tail(path: str) -> str:
    """The last lines of a log."""
    with open(path, encoding="utf-8", errors="replace") as file:
        return "".join(file.readlines()[-LOG_TAIL_LINES:])


class Runner:
    """Runs tasks on the workers of a cluster."""

    def __init__(self, client: Any, program: str, max_attempts: int):
        self.client = client
        self.program = program
        self.max_attempts = max_attempts
        if program:
            # Workers need not have this package then.
            import cloudpickle

            cloudpickle.register_pickle_by_value(sys.modules[__name__])

    def run(self, label: str, tasks: Sequence[Task]) -> None:
        """Runs those tasks that have no result yet.

        Raises ClusterError naming the tasks that failed max_attempts times, once
        all others are done.
        """
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        todo = [task for task in tasks if not os.path.exists(task.result_path)]
        progress = Progress(label, len(tasks), len(tasks) - len(todo))
        attempts: Dict[Task, int] = dict.fromkeys(todo, 0)
        num_lost: Dict[Task, int] = dict.fromkeys(todo, 0)
        failures: Dict[Task, str] = {}
        submitted = {self._submit(task): task for task in todo}
        futures = as_completed(submitted)
        for future in futures:
            task = submitted.pop(future)
            error = future.exception() if future.status != "cancelled" else None
            if os.path.exists(task.result_path):
                progress.step()
                continue
            if error is None or isinstance(error, KilledWorker):
                num_lost[task] += 1
                gives_up = num_lost[task] > MAX_NUM_LOST_WORKERS
            else:
                attempts[task] += 1
                gives_up = attempts[task] >= self.max_attempts
            if gives_up:
                failures[task] = str(error)
                progress.message(f"{task.name} failed, see {task.log_path}")
                continue
            again = self._submit(task)
            submitted[again] = task
            futures.add(again)
        if failures:
            raise ClusterError(failure_text(label, failures))

    def _submit(self, task: Task) -> Any:
        # Where a worker is lost, the scheduler runs its tasks elsewhere.
        return self.client.submit(
            run_task,
            self.program,
            task.name,
            list(task.arguments),
            task.result_path,
            task.log_path,
            pure=False,
        )


def failure_text(label: str, failures: Dict[Task, str]) -> str:
    """What to show of tasks that failed: all names, and one log."""
    task, error = next(iter(failures.items()))
    names = ", ".join(failed.name for failed in failures)
    return (
        f"{label}: {names} failed; all others are done and kept. The first:\n{error}"
        f"\nIts log is {task.log_path}. The same command tries again"
    )


class Progress:
    """Lines on stderr, at most one in two seconds."""

    def __init__(self, label: str, total: int, done: int):
        self.label, self.total, self.done = label, total, done
        self.start, self.num_before, self.last = time.monotonic(), done, 0.0
        self.message(f"{done} of {total} done before" if done else f"{total} to do")

    def step(self) -> None:
        self.done += 1
        now = time.monotonic()
        if self.done < self.total and now - self.last < 2:
            return
        self.last = now
        per_task = (now - self.start) / (self.done - self.num_before)
        left = per_task * (self.total - self.done)
        self.message(f"{self.done} of {self.total} done, about {left:.0f} s left")

    def message(self, text: str) -> None:
        print(f"{self.label}: {text}", file=sys.stderr, flush=True)


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
    plan.update(state="done", stamp=state.stamp())
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
    except (ClusterError, OSError, sqlite3.Error) as error:
        print(f"ERROR: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    # Workers have to find the functions by the name of the module.
    from dgsfm.cluster import main as main_of_module

    sys.exit(main_of_module())
