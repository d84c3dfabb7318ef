"""Faults while a command writes its output leave the old or the new output.

Usage: COLMAP=PATH FAULT_LIBRARY=PATH output_faults_test.py

Each command writes once undisturbed and then over other output, once killed
and once with a full disk at each call that changes a file, and without
threads. Exit code 77 without pycolmap.
"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

try:
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ["COLMAP"]
SIGKILL = -9


def run(arguments, fault=None):
    environment = dict(os.environ)
    if fault:
        environment["LD_PRELOAD"] = os.environ["FAULT_LIBRARY"]
        environment["DGSFM_FAULT"] = fault
    return subprocess.run(
        [COLMAP, *map(str, arguments)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def files_of(path):
    """The bytes of what counts at a path, by names."""
    if path.is_file():
        return {path.name: path.read_bytes()}
    return {
        str(file.relative_to(path)): file.read_bytes()
        for file in sorted(path.rglob("*"))
        # The report has times in it.
        if file.is_file() and file.name != "report.json"
        and not any(part.startswith(".") for part in file.relative_to(path).parts)
    }  # fmt: skip


def check_parts(output, parts, old, new):
    """Each part, a file or a model, is the old one or the new one."""
    found = files_of(output)
    for part in parts:
        def of_part(files):
            return {n: b for n, b in files.items() if n.startswith(part)}
        assert of_part(found) in (of_part(old), of_part(new)), part
        if part == "0/":
            pycolmap.Reconstruction(output / "0")


def check_command(folder, name, arguments, old_options, parts):
    """Returns the number of calls at which faults were injected."""
    output = folder / f"{name}_output"
    option = "--json_path" if name == "model_evaluator" else "--output_path"
    arguments = [name, *arguments, option]

    def remove(path):
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def write(path, options=()):
        result = run([*arguments, path, *options])
        assert result.returncode == 0, result.stderr
        return files_of(path)

    new = write(folder / "new")
    start = folder / "old"
    old = write(start, old_options)
    if start.is_file():
        new = {output.name: new["new"]}
        old = {output.name: old["old"]}
        parts = [output.name]
    # The project file names the folder.
    new.pop("project.ini", None)
    assert old != new
    num_calls = 0
    while True:
        num_calls += 1
        for kind in ("kill", "fail"):
            remove(output)
            shutil.copytree(start, output) if start.is_dir() else shutil.copyfile(
                start, output
            )
            result = run([*arguments, output], f"{kind}:{num_calls}")
            case = f"{name} {kind}:{num_calls}: {result.stderr}"
            assert result.returncode in ((0, SIGKILL) if kind == "kill" else (0, 1)), case
            if result.returncode == 1:
                assert "ERROR: " in result.stderr, case
                assert str(folder) in result.stderr, case
            check_parts(output, parts, old, new)
            if kind == "kill":
                is_over = result.returncode == 0
        write(output)
        check_parts(output, parts, new, new)
        if is_over:
            break
    for path in (folder / "new", start, output):
        remove(path)
    return num_calls - 1


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        scene = folder / "scene"
        result = run(
            ["depth_scene_synthesizer", "--output_path", scene, "--database_only", 1,
             "--num_images", 6, "--num_points_per_image", 100]
        )  # fmt: skip
        assert result.returncode == 0, result.stderr
        database = ["--database_path", scene / "database.db", "--num_threads", 1]
        truth = ["--input_path", scene / "gt"]
        names = [f"image{i:04}.jpg.npy" for i in range(6)]
        for command, arguments, old_options, parts in (
            ("model_renderer", truth, ["--width", 200], []),
            ("model_evaluator", truth + ["--ground_truth_path", scene / "gt"],
             ["--thresholds", 7], []),
            ("depth_exporter", database + truth,
             ["--DepthAlignment.model", "scale"], names),
            ("depth_global_mapper", database, ["--DepthGlobalMapper.ba_loss_scale", 0.1], ["0/"]),
        ):  # fmt: skip
            num_calls = check_command(folder, command, arguments, old_options, parts)
            assert num_calls > 2, command
            print(f"{command}: {num_calls} calls")

        for count in (1, 2):
            result = run(
                ["depth_global_mapper", *database[:2], "--num_threads", 4,
                 "--output_path", folder / "few_threads"], f"threads:{count}",
            )  # fmt: skip
            assert result.returncode == 0, result.stderr


if __name__ == "__main__":
    main()
