"""Kills depth_importer at random moments and lets it go on.

Usage: COLMAP=PATH importer_kill_test.py [NUM_KILLS]

After every kill the database passes SQLite's integrity check, and in the end it
holds what an undisturbed import gives. Exit code 77 without NumPy and pycolmap.
"""

import os
import pathlib
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ["COLMAP"]
NUM_IMAGES = 60


def make_inputs(folder):
    rng = np.random.default_rng(0)
    (folder / "depth").mkdir()
    with pycolmap.Database.open(folder / "start.db") as database:
        camera = pycolmap.Camera(
            model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240]
        )
        camera.camera_id = database.write_camera(camera)
        for i in range(NUM_IMAGES):
            name = f"{i:03}.jpg"
            image = pycolmap.Image(name=name, camera_id=camera.camera_id)
            image_id = database.write_image(image)
            keypoints = rng.uniform(0, 480, (200, 2)).astype(np.float32)
            database.write_keypoints(image_id, keypoints)
            depth = rng.uniform(1, 9, (240, 320)).astype(np.float16)
            np.save(folder / "depth" / f"{name}.npy", depth)


def command(folder, database):
    return [
        COLMAP, "depth_importer", "--database_path", folder / database,
        "--depth_path", folder / "depth",
    ]  # fmt: skip


def dump(path):
    connection = sqlite3.connect(path)
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


def num_imported(path):
    rows = dump(path)
    maps = rows.get("dgsfm_depth_maps", [])
    samples = rows.get("dgsfm_keypoint_depths", [])
    # Each image as a whole or not at all.
    assert [row[0] for row in maps] == [row[0] for row in samples]
    return len(maps)


def main():
    num_kills = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    random.seed(0)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        make_inputs(folder)
        shutil.copyfile(folder / "start.db", folder / "whole.db")
        begin = time.monotonic()
        subprocess.run(command(folder, "whole.db"), check=True, capture_output=True)
        duration = time.monotonic() - begin
        expected = dump(folder / "whole.db")

        num_partial = 0
        shutil.copyfile(folder / "start.db", folder / "killed.db")
        for _ in range(num_kills):
            process = subprocess.Popen(
                command(folder, "killed.db"),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            time.sleep(random.uniform(0, duration))
            process.kill()
            process.wait()
            count = num_imported(folder / "killed.db")
            num_partial += 0 < count < NUM_IMAGES
            if count == NUM_IMAGES:
                assert dump(folder / "killed.db") == expected
                for file in folder.glob("killed.db*"):
                    file.unlink()
                shutil.copyfile(folder / "start.db", folder / "killed.db")
        subprocess.run(command(folder, "killed.db"), check=True, capture_output=True)
        assert dump(folder / "killed.db") == expected
        print(f"{num_kills} kills, {num_partial} of them amid the import")
        assert num_kills < 20 or num_partial > 0, "no kill hit the import"


if __name__ == "__main__":
    main()
