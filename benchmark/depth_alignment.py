#!/usr/bin/env python3
"""How much closer to the truth depth_exporter's aligned maps are.

usage: depth_alignment.py FOLDER... [--depth depth] [--models scale field]

Each FOLDER holds images, database.db, gt (a COLMAP model) and a folder of depth
maps as .npy. The maps are imported and mapped, and aligned to one half of the
model's points. They are compared with points that are triangulated at the true
poses (in 3 images or more, below 1 px), at key points that are not among those
of the fit: the median relative error of all, of the input maps each with its
best single scale for these very points, and of the aligned ones with the one
scale of the whole model.
"""

import argparse
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile

import numpy as np
import pycolmap

MIN_NUM_POINTS = 20


def run(colmap, *arguments):
    result = subprocess.run(
        [colmap, *map(str, arguments)], capture_output=True, text=True
    )
    if result.returncode != 0:
        sys.exit(result.stdout + result.stderr)


def triangulate_truth(folder, work):
    """The true model with points of the database's matches."""
    truth = pycolmap.Reconstruction(folder / "gt")
    database = work / "truth.db"
    shutil.copyfile(folder / "database.db", database)
    connection = sqlite3.connect(database)
    for camera in truth.cameras.values():
        connection.execute(
            "UPDATE cameras SET model = ?, params = ?, width = ?, height = ? "
            "WHERE camera_id = ?",
            (
                int(camera.model.value), np.array(camera.params).tobytes(),
                camera.width, camera.height, camera.camera_id,
            ),
        )  # fmt: skip
    connection.commit()
    connection.close()
    output = work / "truth"
    output.mkdir()
    pycolmap.triangulate_points(truth, database, folder / "images", output)
    return pycolmap.Reconstruction(output)


def scale_to_truth(model, truth):
    """From the distances of all pairs of camera centres."""
    true_centers = {
        image.name: image.projection_center() for image in truth.images.values()
    }
    images = [image for image in model.images.values() if image.has_pose]
    pairs = [
        (image.projection_center(), true_centers[image.name])
        for image in images
        if image.name in true_centers
    ]
    centers, expected = (np.array(side) for side in zip(*pairs))
    first, second = np.triu_indices(len(pairs), 1)
    distances = np.linalg.norm(centers[first] - centers[second], axis=1)
    true_distances = np.linalg.norm(expected[first] - expected[second], axis=1)
    return np.median(true_distances / distances)


def halve_points(model, path):
    """Writes the model with every second point and returns it."""
    rng = np.random.default_rng(0)
    for point_id in list(model.points3D):
        if rng.random() < 0.5:
            model.delete_point3D(point_id)
    path.mkdir()
    model.write(path)
    return model


def true_depths(truth, truth_image, image):
    """Rows x, y, z of key points without a point in `image`."""
    used = {tuple(np.round(p.xy, 2)) for p in image.points2D if p.has_point3D()}
    cam_from_world = truth_image.cam_from_world()
    rows = []
    for point in truth_image.points2D:
        if not point.has_point3D() or tuple(np.round(point.xy, 2)) in used:
            continue
        point3D = truth.points3D[point.point3D_id]
        if point3D.track.length() >= 3 and point3D.error < 1:
            rows.append((*point.xy, (cam_from_world * point3D.xyz)[2]))
    return np.array(rows)


def sample(depth, points, camera):
    """Depth of the pixel of the map that each point lies in."""
    height, width = depth.shape
    x = np.clip((points[:, 0] * width / camera.width).astype(int), 0, width - 1)
    y = np.clip((points[:, 1] * height / camera.height).astype(int), 0, height - 1)
    return depth[y, x].astype(float)


def compare(input_path, aligned_path, model, truth, scale):
    """Relative errors of input and aligned maps at all points."""
    truth_images = {image.name: image for image in truth.images.values()}
    input_errors, aligned_errors = [], []
    for image in model.images.values():
        aligned_file = aligned_path / f"{image.name}.npy"
        if not image.has_pose or not aligned_file.exists():
            continue
        points = true_depths(truth, truth_images[image.name], image)
        if len(points) < MIN_NUM_POINTS:
            continue
        camera = model.cameras[image.camera_id]
        given = sample(np.load(input_path / f"{image.name}.npy"), points, camera)
        aligned = scale * sample(np.load(aligned_file), points, camera)
        known = np.isfinite(given) & (given > 0) & (aligned > 0)
        given, aligned, expected = given[known], aligned[known], points[known, 2]
        best_scale = np.median(expected / given)
        input_errors.extend(np.abs(best_scale * given / expected - 1))
        aligned_errors.extend(np.abs(aligned / expected - 1))
    return np.median(input_errors), np.median(aligned_errors), len(input_errors)


def evaluate(folder, options, work):
    truth = triangulate_truth(folder, work)
    database = work / "database.db"
    shutil.copyfile(folder / "database.db", database)
    depth_path = folder / options.depth
    run(
        options.colmap, "depth_importer", "--database_path", database,
        "--depth_path", depth_path,
    )  # fmt: skip
    run(
        options.colmap, "depth_global_mapper", "--database_path", database,
        "--output_path", work / "models",
    )  # fmt: skip
    model = pycolmap.Reconstruction(work / "models" / "0")
    scale = scale_to_truth(model, truth)
    model = halve_points(model, work / "half")
    for alignment in options.models:
        output = work / alignment
        run(
            options.colmap, "depth_exporter", "--database_path", database,
            "--input_path", work / "half", "--output_path", output,
            "--DepthAlignment.model", alignment,
        )  # fmt: skip
        before, after, count = compare(depth_path, output, model, truth, scale)
        print(
            f"| {folder.name} | {options.depth} | {alignment} | {count} "
            f"| {100 * before:.2f} % | {100 * after:.2f} % | {after / before:.2f} |",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=pathlib.Path, nargs="+")
    parser.add_argument("--colmap", default="build/release/bin/colmap")
    parser.add_argument("--depth", default="depth", help="folder of the maps")
    parser.add_argument("--models", nargs="+", default=["scale", "scale_shift", "field"])
    options = parser.parse_args()
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    print("| set | maps | alignment | points | input, best scale | aligned | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- |", flush=True)
    for folder in options.folder:
        with tempfile.TemporaryDirectory() as work:
            evaluate(folder, options, pathlib.Path(work))


if __name__ == "__main__":
    main()
