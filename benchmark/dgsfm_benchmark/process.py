"""Programs, with their time and memory."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import threading
import time
from pathlib import Path

from .errors import BenchmarkError


@dataclasses.dataclass(frozen=True)
class Usage:
    """Resources of one or more finished programs."""

    seconds: float = 0.0  # wall time
    cpu_seconds: float = 0.0  # of all threads
    peak_memory_mb: float = 0.0

    def __add__(self, other: Usage) -> Usage:
        return Usage(
            self.seconds + other.seconds,
            self.cpu_seconds + other.cpu_seconds,
            max(self.peak_memory_mb, other.peak_memory_mb),
        )


def run_program(
    arguments: list[str], log: Path, timeout_seconds: float = 3600.0
) -> Usage:
    """Runs a program with its output appended to ``log``.

    Raises BenchmarkError, with the end of its output, if it fails or takes
    longer than the timeout.
    """
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("ab") as output:
        output.write(("$ " + " ".join(arguments) + "\n").encode())
        output.flush()
        start = time.monotonic()
        try:
            process = subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        except OSError as error:
            raise BenchmarkError(f"'{arguments[0]}': {error}") from error
        timer = threading.Timer(timeout_seconds, process.kill)
        timer.start()
        # Unlike subprocess, wait4 tells the resources of this very child.
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - start
    if process.returncode != 0:
        reason = f"exit code {process.returncode}"
        if seconds >= timeout_seconds:
            reason = f"no result after {timeout_seconds:.0f} s"
        lines = log.read_text(errors="replace").strip().split("\n")
        raise BenchmarkError(
            f"{Path(arguments[0]).name}: {reason}: {lines[-1][-200:]}"
        )
    return Usage(
        seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
    )
