"""Programs, with their time and memory."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import time
from pathlib import Path

from .errors import BenchmarkError


# How often programs are looked at: of their last moment nothing is known.
_POLL_SECONDS = 0.02


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
        peak_memory_mb = 0.0
        while True:
            peak_memory_mb = max(peak_memory_mb, _peak_memory_mb(process.pid))
            # Unlike subprocess, wait4 tells the resources of this very child.
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            seconds = time.monotonic() - start
            if pid != 0:
                break
            if seconds >= timeout_seconds:
                process.kill()
            time.sleep(_POLL_SECONDS)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        reason = f"exit code {process.returncode}"
        if seconds >= timeout_seconds:
            reason = f"no result after {timeout_seconds:.0f} s"
        lines = log.read_text(errors="replace").strip().split("\n")
        raise BenchmarkError(
            f"{Path(arguments[0]).name}: {reason}: {lines[-1][-200:]}"
        )
    return Usage(seconds, usage.ru_utime + usage.ru_stime, peak_memory_mb)


def _peak_memory_mb(pid: int) -> float:
    # Not ru_maxrss, which starts at the memory of this very process.
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    for line in status.split("\n"):
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    return 0.0
