#!/usr/bin/env python3
"""How much closer to the truth depth_exporter's aligned maps are.

usage: depth_alignment.py FOLDER... [--depth depth] [--models field multi_view]

Each FOLDER holds images, database.db, gt (a COLMAP model) and a folder of depth
maps as .npy. The maps are imported and mapped, and aligned to one half of the
model's points. They are compared with points that are triangulated at the true
poses (in 3 images or more, below 1 px), at key points that are not among those
of the fit: the median relative error of all, of the input maps each with its
best single scale for these very points, and of the aligned ones with the one
scale of the whole model. Where FOLDER has depth_true, exact maps, all pixels are
compared with these instead.

multi_view is field, refined by the neighbours. The last column is the share of
the points with depth in the input that have aligned depth.
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


def samples_by_points(model, truth):
    """Per image its name, true depths, and what takes the same of a map."""
    truth_images = {image.name: image for image in truth.images.values()}
    for image in model.images.values():
        if not image.has_pose or image.name not in truth_images:
            continue
        points = true_depths(truth, truth_images[image.name], image)
        if len(points) < MIN_NUM_POINTS:
            continue
        camera = model.cameras[image.camera_id]
        yield image.name, points[:, 2], (
            lambda depth, points=points, camera=camera: sample(depth, points, camera)
        )


def samples_by_pixels(folder, model):
    for image in model.images.values():
        if not image.has_pose:
            continue
        expected = np.load(folder / "depth_true" / f"{image.name}.npy")
        expected = expected.astype(float).ravel()
        known = np.isfinite(expected) & (expected > 0)
        yield image.name, expected[known], (
            lambda depth, known=known: depth.astype(float).ravel()[known]
        )


def compare(input_path, aligned_path, samples, scale):
    """Relative errors of input and aligned maps, and how many are known."""
    input_errors, aligned_errors, num_given = [], [], 0
    for name, expected, depths_of in samples:
        aligned_file = aligned_path / f"{name}.npy"
        if not aligned_file.exists():
            continue
        given = depths_of(np.load(input_path / f"{name}.npy"))
        aligned = scale * depths_of(np.load(aligned_file))
        num_given += np.count_nonzero(np.isfinite(given) & (given > 0))
        known = np.isfinite(given) & (given > 0) & (aligned > 0)
        best_scale = np.median(expected[known] / given[known])
        input_errors.extend(np.abs(best_scale * given[known] / expected[known] - 1))
        aligned_errors.extend(np.abs(aligned[known] / expected[known] - 1))
    return np.array(input_errors), np.array(aligned_errors), num_given


def evaluate(folder, options, work):
    has_true_maps = (folder / "depth_true").exists()
    if has_true_maps:
        truth = pycolmap.Reconstruction(folder / "gt")
    else:
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
    if has_true_maps:
        samples = list(samples_by_pixels(folder, model))
    else:
        samples = list(samples_by_points(model, truth))
    for alignment in options.models:
        output = work / alignment
        is_multi_view = alignment == "multi_view"
        run(
            options.colmap, "depth_exporter", "--database_path", database,
            "--input_path", work / "half", "--output_path", output,
            "--DepthAlignment.model", "field" if is_multi_view else alignment,
            "--multi_view", int(is_multi_view),
        )  # fmt: skip
        before, after, num_given = compare(depth_path, output, samples, scale)
        print(
            f"| {folder.name} | {options.depth} | {alignment} | {len(after)} "
            f"| {100 * np.median(before):.2f} % | {100 * np.median(after):.2f} % "
            f"| {100 * np.quantile(after, 0.95):.2f} % "
            f"| {100 * len(after) / num_given:.1f} % |",
            flush=True,
        )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=pathlib.Path, nargs="+")
    parser.add_argument("--colmap", default="build/release/bin/colmap")
    parser.add_argument("--depth", default="depth", help="folder of the maps")
    parser.add_argument(
        "--models", nargs="+", default=["scale", "scale_shift", "field", "multi_view"]
    )
    options = parser.parse_args()
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    print("| set | maps | alignment | points | input, best scale | aligned | 95 % | kept |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |", flush=True)
    for folder in options.folder:
        with tempfile.TemporaryDirectory() as work:
            evaluate(folder, options, pathlib.Path(work))


if __name__ == "__main__":
    main()
