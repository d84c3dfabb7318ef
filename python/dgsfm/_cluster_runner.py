"""Processes of the program on the workers of Dask."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time
from typing import Any, Dict, Sequence

MAX_NUM_LOST_WORKERS = 100
"""Workers that a piece of work may be lost with, none of which is its fault."""
LOG_TAIL_LINES = 15
START_WITH_PARENT = """
import ctypes, os, signal, sys
PR_SET_PDEATHSIG = 1
ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
if os.getppid() != int(sys.argv[1]):
    sys.exit(1)
os.execvp(sys.argv[2], sys.argv[2:])
"""
"""Runs a program that ends when the worker that started it is killed: its work is
somebody else's then."""


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
    starter = [sys.executable, "-ISc", START_WITH_PARENT, str(os.getpid())]
    with open(log_path, "a", encoding="utf-8") as log:
        log.write(f"== {os.uname().nodename}: {' '.join(command)}\n")
        log.flush()
        return subprocess.call(
            starter + command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
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
