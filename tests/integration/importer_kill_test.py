"""Kills a command that writes a database and lets it go on.

Usage: COLMAP=PATH FAULT_LIBRARY=PATH importer_kill_test.py COMMAND [NUM_KILLS]

COMMAND is depth_importer, dense_match_importer or depth_geometric_verifier.
It is killed at random moments (50) and at calls that write. After every kill
the database passes SQLite's integrity check, and in the end it holds what an
undisturbed run gives. Exit code 77 without NumPy and
pycolmap.
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


def make_images(path, num_images, num_keypoints):
    """A database of images of one camera; returns their names."""
    rng = np.random.default_rng(0)
    names = [f"{i:03}.jpg" for i in range(num_images)]
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera(
            model="PINHOLE", width=640, height=480, params=[500, 500, 320, 240]
        )
        camera.camera_id = database.write_camera(camera)
        for name in names:
            image = pycolmap.Image(name=name, camera_id=camera.camera_id)
            image_id = database.write_image(image)
            if num_keypoints > 0:
                keypoints = rng.uniform(0, 480, (num_keypoints, 2)).astype(np.float32)
                database.write_keypoints(image_id, keypoints)
    return names


class DepthImporter:
    """Each image as a whole or not at all."""

    total = 60

    def __init__(self, folder):
        rng = np.random.default_rng(0)
        (folder / "depth").mkdir()
        for name in make_images(folder / "start.db", self.total, 200):
            depth = rng.uniform(1, 9, (240, 320)).astype(np.float16)
            np.save(folder / "depth" / f"{name}.npy", depth)
        self.options = ["--depth_path", folder / "depth"]

    def count(self, rows):
        maps = rows.get("dgsfm_depth_maps", [])
        samples = rows.get("dgsfm_keypoint_depths", [])
        assert [row[0] for row in maps] == [row[0] for row in samples]
        return len(maps)


class DenseMatchImporter:
    """All pairs or none."""

    total = 105

    def __init__(self, folder):
        rng = np.random.default_rng(0)
        names = make_images(folder / "start.db", 15, 0)
        (folder / "matches").mkdir()
        for i, name1 in enumerate(names):
            for name2 in names[i + 1 :]:
                matches = rng.uniform(0, 480, (2000, 4)).astype(np.float32)
                file = folder / "matches" / f"{name1}_{name2}.npz"
                np.savez(file, matches=matches)
        self.options = ["--match_path", folder / "matches"]

    def count(self, rows):
        assert len(rows["matches"]) in (0, self.total)
        assert len(rows["keypoints"]) == (15 if rows["matches"] else 0)
        return len(rows["matches"])


class DepthGeometricVerifier:
    """Each pair as a whole or not at all."""

    def __init__(self, folder):
        subprocess.run(
            [
                COLMAP, "depth_scene_synthesizer", "--output_path", folder / "scene",
                "--database_only", "1", "--num_images", "16",
            ],
            check=True, capture_output=True,
        )  # fmt: skip
        shutil.copyfile(folder / "scene" / "database.db", folder / "start.db")
        connection = sqlite3.connect(folder / "start.db")
        (self.total,) = connection.execute("SELECT count(*) FROM matches").fetchone()
        connection.close()
        self.options = ["--checkpoint_interval", "0"]

    def count(self, rows):
        return len(rows.get("dgsfm_pair_geometries", []))


COMMANDS = {
    "depth_importer": DepthImporter,
    "dense_match_importer": DenseMatchImporter,
    "depth_geometric_verifier": DepthGeometricVerifier,
}


def read_all(path):
    """The rows of all tables."""
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


def start_anew(folder):
    for file in folder.glob("killed.db*"):
        file.unlink()
    shutil.copyfile(folder / "start.db", folder / "killed.db")


def main():
    name = sys.argv[1]
    num_kills = int(sys.argv[2]) if len(sys.argv) > 2 else 50
    random.seed(0)
    with tempfile.TemporaryDirectory() as temporary_name:
        folder = pathlib.Path(temporary_name)
        task = COMMANDS[name](folder)

        def command(database):
            return [COLMAP, name, "--database_path", folder / database, *task.options]

        shutil.copyfile(folder / "start.db", folder / "whole.db")
        begin = time.monotonic()
        subprocess.run(command("whole.db"), check=True, capture_output=True)
        duration = time.monotonic() - begin
        expected = read_all(folder / "whole.db")
        assert task.count(expected) == task.total

        num_partial = 0
        start_anew(folder)
        for _ in range(num_kills):
            process = subprocess.Popen(
                command("killed.db"),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            time.sleep(random.uniform(0, duration))
            process.kill()
            process.wait()
            rows = read_all(folder / "killed.db")
            num_partial += 0 < task.count(rows) < task.total
            if task.count(rows) == task.total:
                assert rows == expected
                start_anew(folder)
        result = subprocess.run(command("killed.db"), capture_output=True, text=True)
        if result.returncode != 0:
            # Dense matches are complete already, and not replaced unasked.
            assert "has keypoints of" in result.stderr, result.stderr
        assert read_all(folder / "killed.db") == expected
        print(f"{num_kills} kills, {num_partial} of them left a part")

        # The first calls one by one, later ones in growing steps.
        call = 0
        is_killed = True
        while is_killed:
            call += 1 + call // 3
            start_anew(folder)
            environment = {
                "LD_PRELOAD": os.environ["FAULT_LIBRARY"],
                "DGSFM_FAULT": f"kill:{call}",
            }
            process = subprocess.run(
                command("killed.db"), capture_output=True, check=False,
                env={**os.environ, **environment},
            )  # fmt: skip
            is_killed = process.returncode != 0
            rows = read_all(folder / "killed.db")
            if is_killed and task.count(rows) < task.total:
                subprocess.run(command("killed.db"), check=True, capture_output=True)
                rows = read_all(folder / "killed.db")
            assert rows == expected
        print(f"killed up to call {call}")
        assert call > 10
        if num_kills >= 20 and name != "dense_match_importer":
            assert num_partial > 0, "no kill hit the work"


if __name__ == "__main__":
    main()
