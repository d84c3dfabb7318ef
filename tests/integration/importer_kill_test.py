"""Kills a command that writes a database and lets it go on.

Usage: COLMAP=PATH FAULT_LIBRARY=PATH importer_kill_test.py COMMAND
           [NUM_KILLS [all]]

COMMAND is depth_importer, dense_match_importer or depth_geometric_verifier.
It is killed at random moments (50), and in a run with less data at calls that
change files: at a sample of them, or with "all" at each. After every kill the database passes SQLite's
integrity check and is read by pycolmap, and in the end it holds what an
undisturbed run gives. Exit code 77 without NumPy and pycolmap.
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

    def __init__(self, folder, is_small):
        self.total = 6 if is_small else 60
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

    def __init__(self, folder, is_small):
        self.num_images = 4 if is_small else 15
        self.total = self.num_images * (self.num_images - 1) // 2
        num_matches = 200 if is_small else 2000
        rng = np.random.default_rng(0)
        names = make_images(folder / "start.db", self.num_images, 0)
        (folder / "matches").mkdir()
        for i, name1 in enumerate(names):
            for name2 in names[i + 1 :]:
                matches = rng.uniform(0, 480, (num_matches, 4)).astype(np.float32)
                file = folder / "matches" / f"{name1}_{name2}.npz"
                np.savez(file, matches=matches)
        self.options = ["--match_path", folder / "matches"]

    def count(self, rows):
        assert len(rows["matches"]) in (0, self.total)
        assert len(rows["keypoints"]) == (self.num_images if rows["matches"] else 0)
        return len(rows["matches"])


class DepthGeometricVerifier:
    """Each pair as a whole or not at all."""

    def __init__(self, folder, is_small):
        subprocess.run(
            [
                COLMAP, "depth_scene_synthesizer", "--output_path", folder / "scene",
                "--database_only", "1", "--num_images", "6" if is_small else "16",
                "--num_points_per_image", "100" if is_small else "1000",
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


def check_pycolmap_reads(path, folder):
    """Reads a copy, as opening a database may convert it."""
    for file in folder.glob("copy.db*"):
        file.unlink()
    for file in folder.glob(path.name + "*"):
        shutil.copyfile(file, folder / file.name.replace(path.stem, "copy"))
    with pycolmap.Database.open(folder / "copy.db") as database:
        for image in database.read_all_images():
            database.read_keypoints(image.image_id)
        database.read_all_matches()


class Run:
    """A command on a database of its own, and what it gives undisturbed."""

    def __init__(self, name, folder, is_small):
        folder.mkdir()
        self.name = name
        self.folder = folder
        self.killed = folder / "killed.db"
        self.task = COMMANDS[name](folder, is_small)
        shutil.copyfile(folder / "start.db", folder / "whole.db")
        begin = time.monotonic()
        subprocess.run(self.command("whole.db"), check=True, capture_output=True)
        self.duration = time.monotonic() - begin
        self.expected = read_all(folder / "whole.db")
        assert self.task.count(self.expected) == self.task.total

    def command(self, database):
        database = self.folder / database
        return [COLMAP, self.name, "--database_path", database, *self.task.options]

    def start_anew(self):
        for file in self.folder.glob("killed.db*"):
            file.unlink()
        shutil.copyfile(self.folder / "start.db", self.killed)

    def run_with_fault(self, fault):
        environment = {
            "LD_PRELOAD": os.environ["FAULT_LIBRARY"],
            "DGSFM_FAULT": fault,
        }
        return subprocess.run(
            self.command("killed.db"), capture_output=True, check=False,
            env={**os.environ, **environment},
        )  # fmt: skip

    def kill_at_random(self, num_kills):
        """Returns how many of the kills left a part of the work."""
        num_partial = 0
        self.start_anew()
        for _ in range(num_kills):
            process = subprocess.Popen(
                self.command("killed.db"),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            time.sleep(random.uniform(0, self.duration))
            process.kill()
            process.wait()
            rows = read_all(self.killed)
            num_partial += 0 < self.task.count(rows) < self.task.total
            if self.task.count(rows) == self.task.total:
                assert rows == self.expected
                self.start_anew()
        result = subprocess.run(
            self.command("killed.db"), capture_output=True, text=True
        )
        if result.returncode != 0:
            # Dense matches are complete already, and not replaced unasked.
            assert "has keypoints of" in result.stderr, result.stderr
        assert read_all(self.killed) == self.expected
        return num_partial

    def kill_at_calls(self, is_all):
        """Returns the numbers of kills and of calls."""
        self.start_anew()
        result = self.run_with_fault(f"count:{self.folder / 'count'}")
        assert result.returncode == 0, result.stderr
        num_calls = int((self.folder / "count").read_text())
        assert num_calls > 10
        calls = list(range(1, num_calls + 1))
        if not is_all:
            # The first ones one by one, later ones in growing steps.
            calls = [1]
            while calls[-1] + 1 + calls[-1] // 3 <= num_calls:
                calls.append(calls[-1] + 1 + calls[-1] // 3)
        num_killed = 0
        for call in calls:
            self.start_anew()
            process = self.run_with_fault(f"kill:{call}")
            # Threads may make the number of calls differ between runs.
            assert process.returncode in (-9, 0), process.stderr
            num_killed += process.returncode != 0
            check_pycolmap_reads(self.killed, self.folder)
            rows = read_all(self.killed)
            if process.returncode != 0 and self.task.count(rows) < self.task.total:
                subprocess.run(
                    self.command("killed.db"), check=True, capture_output=True
                )
                rows = read_all(self.killed)
            assert rows == self.expected, f"kill:{call}"
        assert num_killed > 0.9 * len(calls)
        return num_killed, num_calls


def main():
    name = sys.argv[1]
    num_kills = int(sys.argv[2]) if len(sys.argv) > 2 else 50
    is_all = sys.argv[3:4] == ["all"]
    random.seed(0)
    with tempfile.TemporaryDirectory() as temporary_name:
        folder = pathlib.Path(temporary_name)
        num_partial = Run(name, folder / "large", False).kill_at_random(num_kills)
        print(f"{num_kills} kills, {num_partial} of them left a part")
        if num_kills >= 20 and name != "dense_match_importer":
            assert num_partial > 0, "no kill hit the work"
        num_killed, num_calls = Run(name, folder / "small", True).kill_at_calls(is_all)
        print(f"killed at {num_killed} of {num_calls} calls")


if __name__ == "__main__":
    main()
