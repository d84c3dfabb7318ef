"""Verification on local clusters, with workers and drivers that are killed."""

import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import time

import pytest
from conftest import query, synthesize

import dgsfm

pytest.importorskip("distributed", reason="no package distributed (Dask)")

TABLE = "SELECT * FROM dgsfm_pair_geometries ORDER BY pair_id"
# A killed driver takes its workers with it; what it started may take a while.
TIMEOUT = float(os.environ.get("DGSFM_CLUSTER_TIMEOUT", "300"))
# Factor of the times between kills, for scenes whose shards take longer.
PACE = float(os.environ.get("DGSFM_CLUSTER_PACE", "1"))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A database of some seconds of work, and its table of pairs by one run.

    DGSFM_CLUSTER_SCENE is a folder with the database and gt of another scene.
    """
    folder = tmp_path_factory.mktemp("cluster") / "scene"
    if given := os.environ.get("DGSFM_CLUSTER_SCENE"):
        folder.mkdir()
        shutil.copy(pathlib.Path(given) / "database.db", folder)
        query(folder / "database.db", "DELETE FROM dgsfm_pair_geometries")
        (folder / "gt").symlink_to(pathlib.Path(given).resolve() / "gt")
    else:
        synthesize(
            folder, "--database_only", 1, "--family", "street", "--num_images", 40,
            "--num_points_per_image", 300, "--outlier_match_ratio", 0.3,
        )  # fmt: skip
    single = pathlib.Path(shutil.copy(folder / "database.db", folder / "single.db"))
    dgsfm.verify_pairs(single)
    return folder / "database.db", query(single, TABLE)


@pytest.fixture
def database(scene, tmp_path):
    return pathlib.Path(shutil.copy(scene[0], tmp_path))


class Driver:
    """A driver with two workers, whose messages go to a file."""

    def __init__(self, database, *arguments):
        self.log = database.with_suffix(".log")
        with open(self.log, "w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "dgsfm.cluster", "--database_path", database,
                 "--local", "2", *map(str, arguments)],
                stderr=log, start_new_session=True,
            )  # fmt: skip

    def wait_for_workers(self):
        """A worker that dies before the cluster is complete ends the driver."""
        while "Verifying shards" not in self.log.read_text():
            assert self.process.poll() is None, self.log.read_text()
            time.sleep(0.05)

    def workers(self):
        """Processes of the workers; nannies start others in their place."""
        found = []
        for path in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                command = (path / "cmdline").read_bytes()
                if os.getsid(int(path.name)) != self.process.pid:
                    continue
            except (OSError, ProcessLookupError):
                continue
            if b"spawn_main" in command:
                found.append(int(path.name))
        return found

    def wait(self):
        code = self.process.wait(timeout=TIMEOUT)
        return code, self.log.read_text()


def run_driver(database, *arguments):
    return Driver(database, *arguments).wait()


def test_shards_on_workers_give_the_table_of_one_run(scene, database):
    code, error = run_driver(database, "--num_shards", 7)
    assert code == 0, error
    assert "Verifying shards: 7 of 7 done" in error
    assert query(database, TABLE) == scene[1]
    assert len(scene[1]) > 100
    code, error = run_driver(database, "--num_shards", 7)
    assert code == 0, error
    assert "verified already" in error
    assert "shards" not in error


def test_killed_workers_change_nothing(scene, database):
    driver = Driver(database, "--num_shards", 60)
    driver.wait_for_workers()
    rng = random.Random(0)
    num_killed = 0
    while driver.process.poll() is None and num_killed < 20:
        time.sleep(PACE * rng.uniform(0.1, 1))
        workers = driver.workers()
        if not workers:
            continue
        try:
            os.kill(rng.choice(workers), signal.SIGKILL)
            num_killed += 1
        except ProcessLookupError:
            pass
    code, error = driver.wait()
    assert code == 0, error
    assert num_killed > 3
    assert query(database, TABLE) == scene[1]


def test_killed_drivers_go_on(scene, database):
    rng = random.Random(1)
    num_done = []
    for _ in range(5):
        driver = Driver(database, "--num_shards", 60)
        driver.wait_for_workers()
        time.sleep(PACE * rng.uniform(0.2, 2))
        driver.process.kill()
        driver.wait()
        shards = database.with_name(database.name + ".cluster") / "shards"
        num_done.append(len(list(shards.glob("*.db"))))
    code, error = run_driver(database, "--num_shards", 60)
    assert code == 0, error
    assert "done before" in error
    assert query(database, TABLE) == scene[1]
    assert num_done == sorted(num_done)


def failing_program(folder, failing_shard):
    """A program that fails for a shard and counts its calls."""
    program = folder / "program.sh"
    program.write_text(
        f"""#!/bin/sh
case "$*" in
  *"--shard_index {failing_shard} "*) echo "ERROR: a broken disk" >&2; exit 1;;
esac
echo x >> {folder}/calls
exec {sys.executable} -m dgsfm "$@"
"""
    )
    program.chmod(0o755)
    return program


def test_a_failing_shard_is_named_and_the_others_are_kept(scene, database, tmp_path):
    program = failing_program(tmp_path, 2)
    arguments = "--num_shards", 5, "--max_attempts", 2, "--program", program
    code, error = run_driver(database, *arguments)
    assert code == 1
    assert "shard 2 failed; all others are done and kept" in error
    assert "ERROR: a broken disk" in error
    assert "00002.log" in error
    assert len((tmp_path / "calls").read_text().split()) == 4
    failing_program(tmp_path, 99)
    code, error = run_driver(database, *arguments)
    assert code == 0, error
    # One shard, and the merger.
    assert len((tmp_path / "calls").read_text().split()) == 6
    assert query(database, TABLE) == scene[1]


def test_parts_are_mapped_and_joined(scene, database, tmp_path):
    arguments = "--num_shards", 3, "--output_path", tmp_path / "model"
    code, error = run_driver(database, *arguments, "--max_part_size", 25)
    assert code == 0, error
    assert "Mapping parts: " in error
    result = dgsfm.evaluate(tmp_path / "model", scene[0].parent / "gt")
    assert (result["num_models"], result["num_registered"]) == (1, 40)
    single = database.with_name("single.db")
    shutil.copy(scene[0], single)
    dgsfm.global_depth_mapping(single, tmp_path / "single")
    expected = dgsfm.evaluate(tmp_path / "single", scene[0].parent / "gt")
    assert result["auc"]["5"] > expected["auc"]["5"] - 1
    code, error = run_driver(database, *arguments, "--max_part_size", 25)
    assert code == 0, error
    assert "verified already" in error
    assert f"Models are in {tmp_path / 'model'} already" in error


def test_wrong_usage_and_missing_files_are_named(database, tmp_path):
    code, error = run_driver(tmp_path / "no.db")
    assert (code, "no such database" in error) == (1, True)
    code, error = run_driver(database, "--max_attempts", 0)
    assert code == 2
