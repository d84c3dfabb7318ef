"""Verification across two hosts, of which one is cut off for a while.

The hosts are network namespaces with a cable between them, which need root.
"""

import os
import pathlib
import shutil
import subprocess
import sys
import time

import pytest
from conftest import query, synthesize

import dgsfm

pytest.importorskip("distributed", reason="no package distributed (Dask)")

TABLE = "SELECT * FROM dgsfm_pair_geometries ORDER BY pair_id"
SCHEDULER = "tcp://10.77.0.1:8786"
# How long the second host is cut off. Connections that carry nothing for 30
# seconds are closed, which the default does not wait for.
CUT_S = float(os.environ.get("DGSFM_CUT_S", "3"))
TIMEOUT = 200 + CUT_S


def call(command):
    subprocess.run(command.split(), check=True, capture_output=True)


class Hosts:
    """Two hosts that share their files."""

    def __init__(self):
        self.names = [f"dgsfm{os.getpid()}_{i}" for i in range(2)]
        self.processes = []
        try:
            self.create()
        except Exception:
            self.close()
            raise

    def create(self):
        first, second = self.names
        for name in self.names:
            call(f"ip netns add {name}")
            call(f"ip -n {name} link set lo up")
        call(f"ip -n {first} link add cable type veth peer name cable netns {second}")
        for i, name in enumerate(self.names):
            call(f"ip -n {name} address add 10.77.0.{i + 1}/24 dev cable")
        self.join()

    def join(self):
        for name in self.names:
            call(f"ip -n {name} link set cable up")

    def cut(self):
        call(f"ip -n {self.names[1]} link set cable down")

    def start(self, host, log, *arguments):
        with open(log, "w", encoding="utf-8") as file:
            process = subprocess.Popen(
                ["ip", "netns", "exec", self.names[host], sys.executable, "-m",
                 *map(str, arguments)],
                stdout=file, stderr=file,
            )  # fmt: skip
        self.processes.append(process)
        return process

    def close(self):
        if not shutil.which("ip"):
            return
        for process in self.processes:
            process.terminate()
        for process in self.processes:
            process.wait()
        for name in self.names:
            subprocess.run(
                ["ip", "netns", "delete", name], check=False, capture_output=True
            )


@pytest.fixture
def hosts():
    try:
        hosts = Hosts()
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("network namespaces need root and iproute2")
    yield hosts
    hosts.close()


def wait_for(condition, log, process):
    end = time.monotonic() + TIMEOUT
    while not condition():
        assert process.poll() is None, log.read_text()
        assert time.monotonic() < end, log.read_text()
        time.sleep(0.05)


def wait_for_text(text, log, process):
    wait_for(lambda: text in log.read_text(), log, process)


def test_a_host_that_is_cut_off_loses_nothing(hosts, tmp_path):
    synthesize(
        tmp_path / "scene", "--database_only", 1, "--family", "street",
        "--num_images", 30, "--num_points_per_image", 300,
        "--outlier_match_ratio", 0.3,
    )  # fmt: skip
    database = tmp_path / "scene" / "database.db"
    single = pathlib.Path(shutil.copy(database, tmp_path / "single.db"))
    dgsfm.verify_pairs(single)
    scheduler_log = tmp_path / "scheduler.log"
    scheduler = hosts.start(
        0, scheduler_log, "distributed.cli.dask_scheduler",
        "--host", SCHEDULER, "--no-dashboard",
    )  # fmt: skip
    wait_for_text("Scheduler at", scheduler_log, scheduler)
    for i in range(2):
        log = tmp_path / f"worker{i}.log"
        worker = hosts.start(
            i, log, "distributed.cli.dask_worker", SCHEDULER,
            "--nthreads", 1, "--local-directory", tmp_path / f"worker{i}",
        )  # fmt: skip
        wait_for_text("Registered to", log, worker)
    log = tmp_path / "driver.log"
    driver = hosts.start(
        0, log, "dgsfm.cluster", "--database_path", database,
        "--scheduler", SCHEDULER, "--num_shards", 40,
    )  # fmt: skip
    shards = tmp_path / "scene" / "database.db.cluster" / "shards"
    wait_for(lambda: len(list(shards.glob("*.db"))) > 4, log, driver)
    hosts.cut()
    # What ran there is done once more here if the cut is noticed.
    time.sleep(CUT_S)
    hosts.join()
    assert driver.wait(timeout=TIMEOUT) == 0, log.read_text()
    assert query(database, TABLE) == query(single, TABLE)
