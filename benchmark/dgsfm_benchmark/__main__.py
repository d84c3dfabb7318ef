"""Command line of the benchmark; see benchmark/README.md."""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import subprocess
import sys
from pathlib import Path

from . import page
from .compare import METHOD, compare
from .errors import BenchmarkError
from .experiment import PROJECT, read_experiment, with_engines
from .runner import Settings, run_experiment
from .storage import EXPERIMENTS, definition, with_stored_runs


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="scripts/benchmark.sh", description="Benchmark of SfM mappers."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    _add_run(commands)
    _add_page(commands)
    _add_compare(commands)
    arguments = parser.parse_args()
    try:
        {"run": _run, "page": _page, "compare": _compare}[arguments.command](
            arguments
        )
    except BenchmarkError as error:
        print(f"ERROR: {error}", file=sys.stderr)
        return 1
    return 0


def _add_run(commands) -> None:
    run = commands.add_parser(
        "run", help="runs experiments and refreshes the page of results"
    )
    run.add_argument(
        "experiments",
        nargs="*",
        help="names in benchmark/experiments, or TOML files; default: all "
        "that the page has",
    )
    run.add_argument(
        "--data_path",
        type=Path,
        default=PROJECT / "benchmark" / "data",
        help="folder of published data sets",
    )
    run.add_argument(
        "--work_path",
        type=Path,
        default=PROJECT / "build" / "benchmark",
        help="folder of intermediate results",
    )
    run.add_argument(
        "--program",
        type=Path,
        default=PROJECT / "build" / "release" / "bin" / "colmap",
        help="this project's program",
    )
    run.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count(),
        help="runs at a time",
    )
    run.add_argument(
        "--fresh", action="store_true", help="repeat runs that are there"
    )
    run.add_argument(
        "--engines",
        nargs="+",
        metavar="ENGINE",
        help="run these alone, and keep the stored runs of the others",
    )
    run.add_argument(
        "--output",
        type=Path,
        help="JSON file of the results, instead of the stored ones",
    )


def _add_page(commands) -> None:
    pages = commands.add_parser(
        "page", help="writes pages and README blocks from the stored runs"
    )
    pages.add_argument(
        "--add",
        type=Path,
        help='JSON file of "run --output", whose experiments are stored first',
    )


def _add_compare(commands) -> None:
    comparison = commands.add_parser(
        "compare", help="paired differences of two results, or of two engines"
    )
    comparison.add_argument("a", type=Path, help="JSON file or folder of results")
    comparison.add_argument("b", type=Path, nargs="?", help="default: the same")
    comparison.add_argument("--experiment", required=True)
    comparison.add_argument(
        "--engines", nargs=2, metavar=("A", "B"), help="engine of each file"
    )


def _run(arguments) -> None:
    results_path = arguments.output or page.RUNS
    results = page.read_runs(results_path)
    settings = Settings(
        arguments.data_path,
        arguments.work_path,
        arguments.program,
        arguments.jobs,
        arguments.fresh,
    )
    names = arguments.experiments or list(results)
    if not names:
        raise BenchmarkError("name an experiment: the page has none yet")
    for name in names:
        path = Path(name)
        if path.suffix != ".toml":
            path = EXPERIMENTS / f"{name}.toml"
        experiment = read_experiment(path)
        stored = results.get(experiment.name, {})
        records = run_experiment(
            with_engines(experiment, arguments.engines), settings
        )
        if arguments.engines:
            records = with_stored_runs(records, stored, experiment)
        results[experiment.name] = {
            **definition(experiment),
            "date": datetime.date.today().isoformat(),
            "command": f"scripts/benchmark.sh run {name}",
            "machine": _machine(),
            "commit": _commit(),
            "jobs": arguments.jobs,
            "engines": list(experiment.engines),
            # Stored runs keep the versions of their programs.
            "versions": stored.get("versions", {}) if arguments.engines else {},
            "datasets": list(experiment.datasets),
            "records": records,
        }
        page.store_runs(results, results_path)
    if arguments.output is None:
        page.write_page()


def _machine() -> str:
    return f"{platform.machine()}, {os.cpu_count()} cores"


def _commit() -> str:
    """The project's commit, with a "+" if files differ from it."""
    process = subprocess.run(
        ["git", "describe", "--always", "--dirty=+", "--abbrev=12"],
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
    )
    return process.stdout.strip() or "unknown"


def _page(arguments) -> None:
    if arguments.add is not None:
        if not arguments.add.exists():
            raise BenchmarkError(f"'{arguments.add}' does not exist")
        page.store_runs(page.read_runs(arguments.add))
    page.write_page()


def _compare(arguments) -> None:
    results_a = page.read_runs(arguments.a)
    results_b = page.read_runs(arguments.b or arguments.a)
    records = []
    for results, path in (
        (results_a, arguments.a),
        (results_b, arguments.b or arguments.a),
    ):
        if arguments.experiment not in results:
            raise BenchmarkError(
                f"'{path}' has no experiment '{arguments.experiment}'"
            )
        result = page.described(
            arguments.experiment, results[arguments.experiment]
        )
        records.append(result["records"])
    if arguments.engines:
        records = [
            [r for r in side if r["engine"] == engine]
            for side, engine in zip(records, arguments.engines)
        ]
    lines = compare(
        records[0],
        records[1],
        result["thresholds_deg"],
        by_engine=not arguments.engines,
    )
    print("\n".join([*lines, "", METHOD]))


if __name__ == "__main__":
    sys.exit(main())
