#!/usr/bin/env python3
"""What gravity of images is worth: median error of averaged rotations over all
pairs, and pairwise AUC at 1, 3 and 5 degrees of the models, of synthetic scenes
without gravity, with noise of 1 and 3 degrees, and where that of 30 % of the
images is random.

usage: gravity.py [SCENE...] --colmap PROGRAM [-- OPTIONS OF THE MAPPER]
"""

import argparse
import multiprocessing
import pathlib
import sys
import tempfile

import numpy as np
import pycolmap
from positions import Scene, auc, pair_errors, poses_of

SCENES = {
    "street": ["--family", "street", "--num_images", 100],
    "few matches, false pairs": [
        "--family", "street", "--num_images", 100, "--num_points_per_image", 60,
        "--max_num_neighbors", 4, "--outlier_match_ratio", 0.3,
        "--image_noise", 1, "--num_false_pairs", 100],
    "loop, false pairs": [
        "--family", "ring", "--num_images", 100, "--num_false_pairs", 300],
    "long street, unknown cameras": [
        "--family", "street", "--num_images", 200, "--num_points_per_image", 100,
        "--max_num_neighbors", 4, "--known_focal_length", 0,
        "--max_distortion_offset", 0.1],
}  # fmt: skip
GRAVITY = {
    "none": None,
    "1 deg": ["--gravity_noise", 1],
    "3 deg": ["--gravity_noise", 3],
    "1 deg, 30 % wrong": ["--gravity_noise", 1, "--gravity_outlier_ratio", 0.3],
    "3 deg, 30 % wrong": ["--gravity_noise", 3, "--gravity_outlier_ratio", 0.3],
}
# Models of these have the averaged rotations.
ROTATIONS_ONLY = [
    argument
    for stage in (
        "one_center_start", "bundle_adjustment", "self_calibration",
        "loss_adaptation", "retriangulation", "image_resection", "pair_judging")
    for argument in (f"--DepthGlobalMapper.skip_{stage}", 1)
]  # fmt: skip


def rotation_errors(poses, truth):
    """Of all pairs of images of the model [deg]."""
    names = sorted(poses)
    found, true = (
        np.array([p[n].rotation.matrix() for n in names]) for p in (poses, truth)
    )
    errors = []
    for i in range(len(names)):
        a, b = (r[i + 1:] @ r[i].T for r in (found, true))
        cosines = (np.einsum("nij,nij->n", a, b) - 1) / 2
        errors.extend(np.rad2deg(np.arccos(np.clip(cosines, -1, 1))))
    return errors


def measure(job):
    colmap, name, gravity, seed, more = job
    pycolmap.logging.minloglevel = 2
    with tempfile.TemporaryDirectory() as work:
        noise = GRAVITY[gravity]
        given = [] if noise is None else ["--gravity", 1, *noise]
        scene = Scene(colmap, pathlib.Path(work) / "scene", *SCENES[name], *given,
                      "--random_seed", seed, "--num_threads", 1)  # fmt: skip
        names = sorted(scene.truth)
        more = [*more, "--num_threads", 1]
        rotations = poses_of(scene.map(*ROTATIONS_ONLY, *more))
        error = np.median(rotation_errors(rotations, scene.truth))
        errors = pair_errors(poses_of(scene.map(*more)), scene.truth, names)
        return [error, *(auc(errors, threshold) for threshold in (1, 3, 5))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", help=", ".join(SCENES))
    parser.add_argument("--colmap", default="build/release/bin/colmap")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--processes", type=int, default=2)
    arguments, more = sys.argv[1:], []
    if "--" in arguments:
        more = arguments[arguments.index("--") + 1 :]
        arguments = arguments[: arguments.index("--")]
    options = parser.parse_args(arguments)
    jobs = [
        (options.colmap, name, gravity, seed, more)
        for name in options.what or SCENES
        for gravity in GRAVITY
        for seed in range(options.seeds)
    ]
    with multiprocessing.Pool(options.processes) as pool:
        results = pool.imap(measure, jobs)
        for _, name, gravity, seed, _ in jobs:
            error, *aucs = next(results)
            print(f"{name}; {gravity}; {seed}: rotations {error:.3f} deg, AUC "
                  + ", ".join(f"{value:.2f}" for value in aucs), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
