"""Faults while a command writes its output leave the old or the new output.

Usage: COLMAP=PATH FAULT_LIBRARY=PATH output_faults_test.py [CASE [all]]

CASE is one of CASES below, or "threads"; without it, all of them. A case writes
once undisturbed, and then over other output: killed, and with a full disk, at
calls that change a file. That is a sample of them, or with "all" each. Then the
command runs again and gives the undisturbed output. Exit code 77 without
pycolmap.
"""

import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ["COLMAP"]
SIGKILL = -9
NUM_SAMPLES = 12


def run(arguments, fault=None):
    environment = dict(os.environ)
    if fault:
        environment["LD_PRELOAD"] = os.environ["FAULT_LIBRARY"]
        environment["DGSFM_FAULT"] = fault
    return subprocess.run(
        [COLMAP, *map(str, arguments)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def remove(path):
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)


def copy(source, target):
    shutil.copytree(source, target) if source.is_dir() else shutil.copyfile(
        source, target
    )


def files_of(path):
    """The bytes of what counts at a path, by names."""
    if path.is_file():
        return {path.name: path.read_bytes()}
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in sorted(path.rglob("*"))
        # The report has times in it, and the project file names the folder.
        if file.is_file() and file.name not in ("report.json", "project.ini")
        and not any(part.startswith(".") for part in file.relative_to(path).parts)
    }  # fmt: skip


def hidden_files_of(path):
    return sorted(
        str(file.relative_to(path)) for file in path.rglob(".*") if path.is_dir()
    )


def rows_of(database):
    """The rows of all tables, of a database that is sound."""
    connection = sqlite3.connect(database)
    assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    tables = connection.execute(
        "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
    ).fetchall()
    rows = {
        table: connection.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall()
        for (table,) in tables
    }
    connection.close()
    return rows


def check_is_readable(path):
    """Files and models can be read by those that they are for."""
    for file in [path, *path.rglob("*")]:
        if any(part.startswith(".") for part in file.relative_to(path).parts):
            continue
        if file.name == "images.bin":
            assert pycolmap.Reconstruction(file.parent).num_reg_images() > 0, file
        elif file.suffix == ".json":
            json.loads(file.read_text())
        elif file.suffix == ".npy":
            np.load(file)


def is_model(name):
    return name.split("/")[0].isdigit()


def check_is_old_or_new(path, old, new):
    """Each file, and each model as a whole, is the old one or the new one."""
    found = files_of(path)
    for model in {name.split("/")[0] for name in found if is_model(name)}:
        def of_model(files):
            return {n: b for n, b in files.items() if n.startswith(model + "/")}
        assert of_model(found) in (of_model(old), of_model(new)), model
    # Files that only one run writes may be there or not.
    for name in found.keys() | (old.keys() & new.keys()):
        assert name in found, name
        assert found[name] in (old.get(name), new.get(name)), name


class Case:
    def __init__(self, command, arguments, old_options, output="output"):
        self.command = command
        self.arguments = arguments
        self.old_options = old_options
        # A file where it has a suffix.
        self.output = output

    def check(self, folder, database, is_all):
        """Returns the numbers of calls, and of those that failed."""
        # Commands that write to it begin with the same one.
        used_database = folder / "used.db"
        # The same path each time, as some output names it.
        output = folder / self.output
        option = "--json_path" if self.command == "model_evaluator" else "--output_path"
        arguments = [
            self.command,
            *(used_database if a == database else a for a in self.arguments),
            option, output,
        ]  # fmt: skip

        def start_anew(start):
            for file in folder.glob("used.db*"):
                file.unlink()
            shutil.copyfile(database, used_database)
            remove(output)
            if start:
                copy(start, output)

        def write(fault=None, options=()):
            result = run([*arguments, *options], fault)
            assert result.returncode == 0, result.stderr
            return files_of(output)

        start_anew(None)
        old = write(options=self.old_options)
        start = folder / "old"
        copy(output, start)
        start_anew(None)
        write()
        start_anew(start)
        count_file = folder / "count"
        new = write(f"count:{count_file}")
        assert old != new
        new_rows = rows_of(used_database)
        hidden = hidden_files_of(output)
        num_calls = int(count_file.read_text())
        assert num_calls > 2, self.command
        calls = range(1, num_calls + 1)
        if not is_all:
            # The last ones are those that give the output its names.
            calls = sorted({
                *calls[-NUM_SAMPLES // 2 :], *calls[:: max(1, 2 * num_calls // NUM_SAMPLES)]
            })  # fmt: skip
        for call in calls:
            for kind in ("kill", "fail"):
                start_anew(start)
                result = run(arguments, f"{kind}:{call}")
                case = f"{self.command} {kind}:{call}: {result.stderr}"
                assert result.returncode in (
                    (SIGKILL,) if kind == "kill" else (0, 1)
                ), f"{result.returncode} {case}"
                if result.returncode == 1:
                    assert "ERROR: " in result.stderr, case
                    assert str(folder) in result.stderr, case
                try:
                    check_is_old_or_new(output, old, new)
                    check_is_readable(output)
                    rows_of(used_database)
                    assert write() == new
                    assert rows_of(used_database) == new_rows
                    assert hidden_files_of(output) == hidden
                except AssertionError as error:
                    raise AssertionError(case) from error
        for path in (start, output):
            remove(path)
        return num_calls, len(calls)


def make_cases(scene, database):
    at = ["--database_path", database, "--num_threads", 1]
    truth = ["--input_path", scene / "gt"]
    scale = ["--DepthAlignment.model", "scale"]
    return {
        "model_renderer": Case("model_renderer", truth, ["--width", 200], "output.png"),
        "model_evaluator": Case(
            "model_evaluator", [*truth, "--ground_truth_path", scene / "gt"],
            ["--thresholds", 7], "output.json",
        ),
        "depth_exporter": Case("depth_exporter", [*at, *truth], scale),
        "depth_exporter_bin": Case(
            "depth_exporter", [*at, *truth, "--format", "bin"], scale
        ),
        "depth_exporter_3dgs": Case(
            "depth_exporter", [*at, *truth, "--format", "3dgs"], scale
        ),
        "depth_global_mapper": Case(
            "depth_global_mapper", at, ["--DepthGlobalMapper.ba_loss_scale", 0.1]
        ),
    }  # fmt: skip


CASES = [
    "model_renderer", "model_evaluator", "depth_exporter", "depth_exporter_bin",
    "depth_exporter_3dgs", "depth_global_mapper",
]  # fmt: skip


def check_without_threads(folder, database):
    for count in (1, 2):
        result = run(
            ["depth_global_mapper", "--database_path", database, "--num_threads", 4,
             "--output_path", folder / "few_threads"], f"threads:{count}",
        )  # fmt: skip
        assert result.returncode == 0, result.stderr


def main():
    names = sys.argv[1:2] or [*CASES, "threads"]
    is_all = sys.argv[2:3] == ["all"]
    with tempfile.TemporaryDirectory() as temporary_name:
        folder = pathlib.Path(temporary_name)
        scene = folder / "scene"
        result = run(
            ["depth_scene_synthesizer", "--output_path", scene, "--database_only", 1,
             "--num_images", 6, "--num_points_per_image", 100]
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        database = scene / "database.db"
        cases = make_cases(scene, database)
        assert list(cases) == CASES
        for name in names:
            if name == "threads":
                check_without_threads(folder, database)
                continue
            num_calls, num_tried = cases[name].check(folder, database, is_all)
            print(f"{name}: {num_tried} of {num_calls} calls", flush=True)


if __name__ == "__main__":
    main()
