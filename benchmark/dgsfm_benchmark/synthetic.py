"""Synthetic scenes with exact truth, as data sets of an experiment.

    [[dataset]]
    name = "synthetic"
    layout = "synthetic"
    families = ["ring", "street"]        # of depth_scene_synthesizer
    options = { num_images = 30 }        # its options, without dashes
    levels_change = "depth"              # levels differ only in their depth:
                                         # engines without it run on the first

    [[dataset.level]]                    # each family at each level
    name = "3 %"
    x = 0.03                             # place on a plot's axis
    options = { depth_noise = 0.03 }
"""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from .datasets import load_plain
from .files import empty_folder, file_digest, slug, value_digest
from .process import run_program
from .scene import Scene


# What engines may call the depth of synthetic scenes: theirs emulates a strong
# network, as "depth" of real scenes.
SYNTHETIC_DEPTHS = ("database", "depth")


def create_scenes(
    dataset: dict, seed: int, folder: Path, program: Path
) -> list[Scene]:
    """The scenes of all families and levels with one seed."""
    scenes = []
    for family in dataset["families"]:
        for i, level in enumerate(dataset.get("level", [{"name": ""}])):
            options = {
                "family": family,
                **dataset.get("options", {}),
                **level.get("options", {}),
                "random_seed": seed,
                "database_only": 1,
            }
            name = f"{family}/{level['name']}".rstrip("/")
            scene_folder = _create(options, name, folder, program)
            (scene,) = load_plain(scene_folder, {})
            parameters = {
                "family": family,
                "level": level["name"],
                "x": level.get("x"),
                "depth_only": i > 0
                and dataset.get("levels_change") == "depth",
            }
            scenes.append(
                dataclasses.replace(
                    scene,
                    name=name,
                    parameters=parameters,
                    database_depths=SYNTHETIC_DEPTHS,
                )
            )
    return scenes


def _create(options: dict, name: str, folder: Path, program: Path) -> Path:
    key = value_digest([options, file_digest(program)])
    scene_folder = folder / f"{slug(name)}-{key}"
    if not scene_folder.exists():
        temporary = empty_folder(folder / f"{slug(name)}-{key}.new")
        arguments = [str(program), "depth_scene_synthesizer"]
        for option, value in options.items():
            arguments += [f"--{option}", str(value)]
        run_program(
            [*arguments, "--output_path", str(temporary)], folder / "log.txt"
        )
        # COLMAP's mappers insist on a folder of images, if an empty one.
        (temporary / "images").mkdir()
        os.replace(temporary, scene_folder)
    return scene_folder
