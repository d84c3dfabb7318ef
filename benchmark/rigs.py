#!/usr/bin/env python3
"""What rigs are worth: pairwise AUC at 1, 3 and 5 degrees of synthetic rigs with
the rig, with the same images without it, and by COLMAP 4.2.1's global mapper
with the rig, on the same matches; and with the rig whose second camera is
turned, by --turns in degrees.

usage: rigs.py [stereo] [cube] [vehicle] --colmap PROGRAM [-- SYNTHESIZER OPTIONS]
"""

import argparse
import json
import pathlib
import shutil
import sqlite3
import tempfile

import numpy as np
import pycolmap
from positions import Scene, auc, center, pair_errors, poses_of

NUM_CAMERAS = {"stereo": 2, "cube": 6, "vehicle": 4}


def their_poses(folder):
    database_path = folder / "colmap.db"
    shutil.copyfile(folder / "database.db", database_path)
    with sqlite3.connect(database_path) as connection:
        for (table,) in connection.execute(
            "SELECT name FROM sqlite_master WHERE name LIKE 'dgsfm%' AND type = 'table'"
        ).fetchall():
            connection.execute(f"DROP TABLE {table}")
    with pycolmap.Database.open(database_path) as database:
        config = pycolmap.read_rig_config(folder / "rig_config.json")
        pycolmap.apply_rig_config(config, database)
    output = folder / "theirs"
    output.mkdir()
    models = pycolmap.global_mapping(database_path, folder, output).values()
    return poses_of(max(models, key=lambda m: m.num_reg_images())) if models else {}


def turn_second_camera(config_path, angle_deg):
    """Writes the configuration with another rotation of the second camera."""
    config = json.loads(config_path.read_text())
    camera = config[0]["cameras"][1]
    w, *xyz = camera["cam_from_rig_rotation"]
    half = np.deg2rad(angle_deg) / 2
    axis = np.array([1, 2, 3]) / np.sqrt(14)
    turn = pycolmap.Rigid3d(
        pycolmap.Rotation3d(np.append(np.sin(half) * axis, np.cos(half))), np.zeros(3)
    )
    pose = turn * pycolmap.Rigid3d(
        pycolmap.Rotation3d(np.array([*xyz, w])), camera["cam_from_rig_translation"]
    )
    x, y, z, w = pose.rotation.quat
    camera["cam_from_rig_rotation"] = [w, x, y, z]
    camera["cam_from_rig_translation"] = list(pose.translation)
    turned_path = config_path.with_name("turned.json")
    turned_path.write_text(json.dumps(config))
    return turned_path


def baseline(poses):
    """Median distance of the first two cameras of a frame."""
    distances = [
        np.linalg.norm(center(pose) - center(poses["cam1" + name[4:]]))
        for name, pose in poses.items()
        if name.startswith("cam0") and "cam1" + name[4:] in poses
    ]
    return np.median(distances)


def measure(colmap, work, rig, num_frames, seed, turns, more):
    scene = Scene(colmap, work / rig, "--family", "street", "--rig", rig,
                  "--num_images", num_frames * NUM_CAMERAS[rig],
                  "--random_seed", seed, *more)  # fmt: skip
    names = sorted(scene.truth)
    config = ("--rig_config_path", scene.folder / "rig_config.json")
    with_rig = poses_of(scene.map(*config))
    unit = scene.report["models"][0]
    found = {
        "rig": with_rig,
        "no rig": poses_of(scene.map()),
        "COLMAP": their_poses(scene.folder),
    }
    for angle_deg in turns:
        turned = turn_second_camera(scene.folder / "rig_config.json", angle_deg)
        found[f"turned {angle_deg}"] = poses_of(
            scene.map("--rig_config_path", turned)
        )
    for name, poses in found.items():
        errors = pair_errors(poses, scene.truth, names)
        print(f"{rig} {seed} {name:10}", *(f"{auc(errors, t):5.1f}" for t in (1, 3, 5)),
              f"{len(poses)}/{len(names)} images", flush=True)  # fmt: skip
    if rig != "cube":
        print(f"{rig} {seed} baseline over truth "
              f"{baseline(with_rig) / baseline(scene.truth):.5f}, scale "
              f"by depth over that of the rig {unit['depth_scale_median']:.4f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rigs", nargs="*", help="stereo cube vehicle")
    parser.add_argument("--colmap", default="build/release/bin/colmap")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--turns", type=float, nargs="*", default=[])
    options, more = parser.parse_known_args()
    pycolmap.logging.minloglevel = 2
    for rig in options.rigs or NUM_CAMERAS:
        for seed in range(options.seeds):
            with tempfile.TemporaryDirectory() as work:
                measure(options.colmap, pathlib.Path(work), rig, options.frames, seed,
                        options.turns, [word for word in more if word != "--"])  # fmt: skip


if __name__ == "__main__":
    main()
