"""Kills depth_global_mapper and lets it go on.

Usage: FAULT_LIBRARY=PATH mapper_kill_test.py COLMAP [NUM_IMAGES NUM_KILLS]

The mapper of a scene of three parts is killed at a sample of the calls that
change files. With numbers it is killed that often at random moments of mapping a
street of so many images. After every kill a second run writes the models of an
undisturbed run, byte by byte, and leaves no check-point.
"""

import os
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

COLMAP = pathlib.Path(sys.argv[1]).resolve()
PARTS = ["--num_images", "30", "--num_points_per_image", "150", "--num_components",
         "3", "--gps", "1", "--gps_noise", "0.1"]  # fmt: skip
GOES_ON = "were mapped by the run that was broken off"


def read_models(folder):
    """The content of the files of all models."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.glob("[0-9]*/*"))
    }


class Mapper:
    """A database that verified pairs are stored in, and its undisturbed models."""

    def __init__(self, folder, scene_options):
        self.database = folder / "scene" / "database.db"
        self.output = folder / "models"
        subprocess.run(
            [COLMAP, "depth_scene_synthesizer", "--output_path", folder / "scene",
             "--database_only", "1", *scene_options],
            check=True, capture_output=True,
        )  # fmt: skip
        self.run()
        begin = time.monotonic()
        self.run()
        self.duration = time.monotonic() - begin
        self.models = read_models(self.output)
        assert self.models

    def command(self, options=()):
        return [COLMAP, "depth_global_mapper", "--database_path", self.database,
                "--output_path", self.output, *options]  # fmt: skip

    def run(self, fault=None, options=()):
        environment = dict(os.environ)
        if fault:
            environment["LD_PRELOAD"] = os.environ["FAULT_LIBRARY"]
            environment["DGSFM_FAULT"] = fault
        return subprocess.run(
            self.command(options), capture_output=True, text=True, env=environment
        )

    def go_on(self, options=()):
        """Runs to the end; returns the number of parts that need not be mapped."""
        result = self.run(options=options)
        assert result.returncode == 0, result.stderr
        assert not (self.output / ".dgsfm_checkpoints").exists()
        return result.stderr.count(GOES_ON)

    def start_anew(self):
        shutil.rmtree(self.output, ignore_errors=True)


def kill_at_calls(mapper, folder):
    """Returns how many parts the runs after each kill went on from."""
    mapper.start_anew()
    result = mapper.run(f"count:{folder / 'count'}")
    assert result.returncode == 0, result.stderr
    num_calls = int((folder / "count").read_text())
    num_parts = []
    for call in range(1, num_calls + 1, max(1, num_calls // 12)):
        mapper.start_anew()
        result = mapper.run(f"kill:{call}")
        assert result.returncode in (-9, 0), result.stderr
        num_parts.append(mapper.go_on())
        assert read_models(mapper.output) == mapper.models, f"kill:{call}"
    assert max(num_parts) == 3, num_parts
    # Models of other options are no part of the result.
    mapper.start_anew()
    mapper.run(f"kill:{num_calls // 2}")
    assert (mapper.output / ".dgsfm_checkpoints").exists()
    options = ["--DepthGlobalMapper.ba_loss_scale", "0.4"]
    assert mapper.go_on(options) == 0
    assert read_models(mapper.output) != mapper.models
    return num_parts


def kill_at_random(mapper, num_kills):
    """Returns how many kills hit a run."""
    num_killed = 0
    for _ in range(num_kills):
        mapper.start_anew()
        process = subprocess.Popen(
            mapper.command(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        time.sleep(random.uniform(0, mapper.duration))
        process.kill()
        num_killed += process.wait() != 0
        mapper.go_on()
        assert read_models(mapper.output) == mapper.models
    return num_killed


def main():
    random.seed(0)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        if len(sys.argv) > 2:
            street = ["--family", "street", "--num_images", sys.argv[2]]
            num_killed = kill_at_random(Mapper(folder, street), int(sys.argv[3]))
            print(f"killed {num_killed} runs, all went on to the same models")
        else:
            num_parts = kill_at_calls(Mapper(folder, PARTS), folder)
            print(f"parts that runs after kills went on from: {num_parts}")


if __name__ == "__main__":
    main()
