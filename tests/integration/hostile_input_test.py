"""Damaged databases and models through every command.

Usage: COLMAP=PATH hostile_input_test.py [NUM_DATABASES [NUM_MODELS]]

Commands end with exit code 0, 1 or 2, change no file outside their output
folder, and write no number that is not finite. Exit code 77 without NumPy and
pycolmap.
"""

import os
import pathlib
import random
import shutil
import sqlite3
import struct
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
NAMES = ["", "..", "../up.jpg", "/tmp/dgsfm_abs.jpg", "a/../../b.jpg", "a\nb", "a\0b",
         "x" * 300, "a/" * 200 + "b", "é.jpg", "image0000.jpg", "./image0000.jpg"]  # fmt: skip
NUMBERS = [0, -1, 1, 2**31 - 1, 2**31, 2**32, 2**63 - 1, -(2**63), 7]
DOUBLES = [0.0, -1.0, 1e-310, 1e12, 1e38, 1e200, 1e308, float("inf"), float("nan")]


def mutate_blob(blob):
    data = bytearray(blob or b"")
    kind = random.randrange(4)
    if kind == 0 and data:
        for _ in range(random.randrange(1, 9)):
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    elif kind == 1:
        del data[random.randrange(len(data) + 1) :]
    elif kind == 2 and len(data) >= 8:
        at = random.randrange(len(data) // 8) * 8
        data[at : at + 8] = struct.pack("<d", random.choice(DOUBLES))
    elif len(data) >= 4:
        at = random.randrange(len(data) // 4) * 4
        with np.errstate(over="ignore"):
            value = np.float32(random.choice(DOUBLES))
        data[at : at + 4] = value.tobytes()
    return bytes(data)


def mutate_value(value):
    if isinstance(value, bytes):
        return mutate_blob(value)
    if isinstance(value, str):
        return random.choice(NAMES)
    if isinstance(value, float):
        return random.choice(DOUBLES)
    return random.choice(NUMBERS + ["text", None])


def double_row(connection, table):
    """Puts a row twice into a table, which a copy without unique ids allows."""
    connection.execute(f"CREATE TABLE copy AS SELECT * FROM {table}")
    connection.execute(f"DROP TABLE {table}")
    connection.execute(f"ALTER TABLE copy RENAME TO {table}")
    (num_rows,) = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
    connection.execute(
        f"INSERT INTO {table} SELECT * FROM {table} WHERE rowid = ?",
        (random.randrange(num_rows + 1),),
    )


def mutate_database(path):
    connection = sqlite3.connect(path)
    tables = [
        name
        for (name,) in connection.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table' "
            "AND name NOT LIKE 'sqlite%'"
        )
    ]
    for _ in range(random.randrange(1, 4)):
        table = random.choice(tables)
        if random.random() < 0.05:
            double_row(connection, table)
            continue
        rows = connection.execute(f"SELECT rowid, * FROM {table}").fetchall()
        if not rows:
            continue
        columns = [c[1] for c in connection.execute(f"PRAGMA table_info({table})")]
        row = random.choice(rows)
        i = random.randrange(len(columns))
        try:
            connection.execute(
                f"UPDATE {table} SET {columns[i]} = ? WHERE rowid = ?",
                (mutate_value(row[i + 1]), row[0]),
            )
        except (sqlite3.Error, OverflowError):
            pass
    connection.commit()
    connection.close()
    if random.random() < 0.1:
        data = bytearray(path.read_bytes())
        for _ in range(20):
            data[random.randrange(len(data))] ^= 1 << random.randrange(8)
        path.write_bytes(data)


def snapshot(folder):
    return {
        file: file.read_bytes() if file.is_file() else None
        for file in folder.rglob("*")
        if "out" not in file.relative_to(folder).parts[:1]
    }


def check_numbers(folder):
    for file in folder.rglob("*.npy"):
        depth = np.load(file)
        assert np.isfinite(depth).all(), file
    for file in folder.rglob("images.bin"):
        model = pycolmap.Reconstruction(file.parent)
        for image in model.images.values():
            assert np.isfinite(image.cam_from_world().matrix()).all(), file
        for point in model.points3D.values():
            assert np.isfinite(point.xyz).all(), file
    for file in folder.rglob("*.json"):
        assert "NaN" not in file.read_text(), file


def run(folder, command, *arguments):
    out = folder / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    before = snapshot(folder)
    result = subprocess.run(
        [COLMAP, command, *map(str, arguments)],
        capture_output=True, cwd=out, check=False, timeout=600,
    )  # fmt: skip
    message = f"{command}: {result.returncode}\n{result.stderr.decode(errors='replace')}"
    assert result.returncode in (0, 1, 2), message
    # Sanitizers end a program with exit code 1 by default, as errors do.
    for report in ("check failed", "Check failed", "Sanitizer", "runtime error:"):
        assert report not in message, message
    after = snapshot(folder)
    # SQLite's own files beside a database come and go.
    changed = {
        file
        for file in before.keys() | after.keys()
        if before.get(file) != after.get(file) and "mutated.db" not in file.name
    }
    assert not changed, changed
    check_numbers(out)
    return result.returncode


def main():
    num_databases = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    num_models = int(sys.argv[2]) if len(sys.argv) > 2 else 500
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    random.seed(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        scene = folder / "scene"
        command = [COLMAP, "depth_scene_synthesizer", "--output_path", scene]
        options = ["--database_only", "1", "--num_images", "6"]
        options += ["--num_points_per_image", "100"]
        subprocess.run([*command, *options], check=True, capture_output=True)
        subprocess.run(
            [COLMAP, "depth_geometric_verifier", "--database_path", scene / "database.db"],
            check=True, capture_output=True,
        )  # fmt: skip
        depth = folder / "depth"
        depth.mkdir()
        for i in range(6):
            np.save(depth / f"image{i:04}.jpg.npy", np.full((30, 40), 2, np.float32))
        database = folder / "mutated.db"
        at = ("--database_path", database, "--num_threads", 1)
        codes = {}
        kept = pathlib.Path(os.environ.get("KEEP_FAILING", folder)) / "failing"
        for i in range(num_databases):
            for file in folder.glob("mutated.db*"):
                file.unlink()
            shutil.copyfile(scene / "database.db", database)
            mutate_database(database)
            shutil.copyfile(database, kept)
            for command, *arguments in (
                ("depth_global_mapper", *at, "--output_path", folder / "out"),
                ("depth_exporter", *at, "--output_path", folder / "out",
                 "--input_path", scene / "gt"),
                ("depth_exporter", *at, "--output_path", folder / "out",
                 "--format", "3dgs"),
                ("depth_geometric_verifier", *at),
                ("depth_importer", *at, "--depth_path", depth),
            ):  # fmt: skip
                code = run(folder, command, *arguments)
                codes[command, code] = codes.get((command, code), 0) + 1
        for i in range(num_models):
            model = folder / "model"
            shutil.rmtree(model, ignore_errors=True)
            shutil.copytree(scene / "gt", model)
            file = random.choice(sorted(model.glob("*.bin")))
            file.write_bytes(mutate_blob(file.read_bytes()))
            for command, *arguments in (
                ("model_evaluator", "--ground_truth_path", scene / "gt",
                 "--json_path", folder / "out" / "result.json"),
                ("model_reporter", "--output_path", folder / "out" / "a.html"),
                ("model_renderer", "--output_path", folder / "out" / "a.png",
                 "--width", 160, "--height", 90),
                ("depth_exporter", "--database_path", scene / "database.db",
                 "--output_path", folder / "out"),
                ("depth_exporter", "--database_path", scene / "database.db",
                 "--output_path", folder / "out", "--undistorted_path", model),
            ):  # fmt: skip
                code = run(folder, command, "--input_path", model, *arguments)
                codes[command, code] = codes.get((command, code), 0) + 1
        print(codes)


if __name__ == "__main__":
    main()
