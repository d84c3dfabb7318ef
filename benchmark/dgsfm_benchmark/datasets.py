"""Loaders of data sets in the layouts in which they are published.

Each loader takes the folder of the data set and the options of its entry in
an experiment, and returns its scenes in the order of names. A scene folder
may also hold, in every layout,

    database.db   key points and matches, taken instead of own ones
    pairs.txt     image pairs to match, lines "name1 name2"
    depth*/       depth maps, named after the images (a.jpg.npy)

For IMC 2021, where scenes are lists in a common folder, and LaMAR they are
looked for in the folder of the images' list.
"""

from __future__ import annotations

import csv
import re
import xml.etree.ElementTree
from collections.abc import Callable, Mapping
from pathlib import Path

import h5py
import numpy as np

from .errors import BenchmarkError
from .files import value_digest
from .geometry import Pose, rotation_from_quaternion
from .model import read_focal_lengths, read_model
from .scene import Scan, Scene

Options = Mapping[str, object]

# Positions are known to a millimetre from laser scans, and to two centimetres
# from large collections (the values of COLMAP's own benchmark).
LASER_ACCURACY = 0.001
COLLECTION_ACCURACY = 0.02

# The scenes of the papers; ETH3D has more.
ETH3D_SCENES = (
    "botanical_garden boulders bridge courtyard delivery_area door electro "
    "exhibition_hall facade kicker lecture_room living_room lounge meadow "
    "office old_computer pipes playground statue terrace terrace_2 terrains"
).split()


def load_plain(path: Path, options: Options) -> list[Scene]:
    """Folders with images/ and gt/, a COLMAP model. ``path`` holds them, or
    is one.

    Options: scenes = names (default: all folders). Of the set or of a scene:
    folder (default: the scene's name, so that a folder can be several
    scenes), database and truth = names in the folder, position_accuracy,
    images = places in the order of names, as "0:5,9:12", exif_error = 0.03:
    the database gets focal lengths as of EXIF data, with relative errors of
    up to this, the same one for all images of a single camera.
    """
    if (path / "gt").is_dir():
        return [_plain_scene(path, path.name, options)]
    folders = [folder.name for folder in _folders_with(path, "gt")]
    return [
        _plain_scene(path / str(own.get("folder", name)), name, own)
        for name in options.get("scenes", folders)
        for own in [scene_options(options, name)]
    ]


def load_strecha(path: Path, options: Options) -> list[Scene]:
    """Strecha et al. 2008: images/NAME and gt_dense_cameras/NAME.camera."""
    del options
    scenes = []
    for folder in _folders_with(path, "gt_dense_cameras"):
        truth = {
            file.name.removesuffix(".camera"): _read_strecha_camera(file)
            for file in sorted((folder / "gt_dense_cameras").glob("*.camera"))
        }
        scenes.append(
            _scene(
                folder,
                image_folder=folder / "images",
                truth=truth,
                position_accuracy=LASER_ACCURACY,
            )
        )
    return scenes


def load_eth3d(path: Path, options: Options) -> list[Scene]:
    """ETH3D high-resolution multi-view, undistorted: SCENE/images/
    dslr_images_undistorted/*.JPG, SCENE/dslr_calibration_undistorted/*.txt
    and, for training scenes, SCENE/dslr_scan_eval/scan_alignment.mlp.

    Options: scenes = names, by default the 22 of the papers.
    """
    names = options.get("scenes", ETH3D_SCENES)
    scenes = []
    for folder in _folders_with(path, "dslr_calibration_undistorted"):
        if folder.name not in names:
            continue
        alignment = folder / "dslr_scan_eval" / "scan_alignment.mlp"
        scenes.append(
            _scene(
                folder,
                image_folder=folder / "images",
                truth=read_model(folder / "dslr_calibration_undistorted").poses,
                position_accuracy=LASER_ACCURACY,
                scans=_read_scan_alignment(alignment)
                if alignment.exists()
                else (),
            )
        )
    return scenes


def load_imc2021(path: Path, options: Options) -> list[Scene]:
    """IMC 2021 phototourism: SCENE/set_100/images, calibration/
    calibration_IMAGE.h5 (K, R, T) and sub_set/*bag_*.txt, lists of images
    relative to set_100. Each bag is a scene, named SCENE/BAG.

    Depth maps are looked for in set_100/depth*. Options: bags = a regular
    expression of bag names (default: all).
    """
    pattern = re.compile(str(options.get("bags", "")))
    scenes = []
    for folder in _folders_with(path, "set_100"):
        image_set = folder / "set_100"
        for bag in sorted((image_set / "sub_set").glob("*bag_*.txt")):
            # Archives made on a Mac hold "._" copies of files.
            if bag.name.startswith("._") or not pattern.search(bag.stem):
                continue
            truth = {
                Path(line).name: _read_imc_calibration(image_set, Path(line))
                for line in bag.read_text().split("\n")
                if line.strip()
            }
            scenes.append(
                _scene(
                    image_set,
                    name=f"{folder.name}/{bag.stem}",
                    image_folder=image_set / "images",
                    truth=truth,
                    position_accuracy=COLLECTION_ACCURACY,
                    is_metric=False,
                    database=None,
                )
            )
    return scenes


def load_lamar(path: Path, options: Options) -> list[Scene]:
    """LaMAR: LOCATION/sessions/SESSION with sensors.txt, images.txt,
    trajectories.txt and, for devices with several cameras, rigs.txt; images
    in raw_data.

    Options: session (default "map"), sensors = a regular expression of the
    ids of cameras that take part (default: all).
    """
    pattern = re.compile(str(options.get("sensors", "")))
    scenes = []
    for folder in _folders_with(path, "sessions"):
        session = folder / "sessions" / str(options.get("session", "map"))
        scenes.append(
            _scene(
                session,
                name=folder.name,
                image_folder=session / "raw_data",
                truth=_read_capture_poses(session, pattern),
                position_accuracy=COLLECTION_ACCURACY,
            )
        )
    return scenes


LOADERS: dict[str, Callable[[Path, Options], list[Scene]]] = {
    "plain": load_plain,
    "strecha": load_strecha,
    "eth3d": load_eth3d,
    "imc2021": load_imc2021,
    "lamar": load_lamar,
}


def scene_options(options: Options, name: str) -> dict:
    """Options of a data set with those of one of its scenes over them."""
    scene = options.get("scene", {}).get(name.split("/")[0], {})
    return {**options, **scene}


def load_scenes(layout: str, path: Path, options: Options) -> list[Scene]:
    """Scenes of a data set; raises BenchmarkError if there are none."""
    if layout not in LOADERS:
        raise BenchmarkError(
            f"layout '{layout}' must be one of {', '.join(LOADERS)}, synthetic"
        )
    if not path.is_dir():
        raise BenchmarkError(f"data set folder '{path}' does not exist")
    scenes = LOADERS[layout](path, options)
    if not scenes:
        raise BenchmarkError(f"'{path}' has no scene in the {layout} layout")
    for scene in scenes:
        _check_images(scene)
    return sorted(scenes, key=lambda scene: scene.name)


def _plain_scene(folder: Path, name: str, options: Options) -> Scene:
    truth = folder / str(options.get("truth", "gt"))
    if not truth.is_dir():
        raise BenchmarkError(f"truth '{truth}' does not exist")
    values = {}
    if "database" in options:
        values["database"] = folder / str(options["database"])
        if not values["database"].exists():
            raise BenchmarkError(f"'{values['database']}' does not exist")
    if "exif_error" in options:
        values["prior_focal_lengths"] = _exif_focal_lengths(
            read_focal_lengths(truth), name, options
        )
    poses = read_model(truth).poses
    return _scene(
        folder,
        name=name,
        image_folder=folder / "images",
        truth={n: poses[n] for n in _places(sorted(poses), options)},
        position_accuracy=options.get("position_accuracy", LASER_ACCURACY),
        **values,
    )


def _exif_focal_lengths(truth, scene_name, options):
    def error(key):
        seed = int(value_digest(key)[:8], 16)
        bound = options["exif_error"]
        return np.random.default_rng(seed).uniform(-bound, bound)

    single = options.get("single_camera", False)
    return {
        name: focal * (1 + error([scene_name, "" if single else name]))
        for name, focal in truth.items()
    }


def _places(names: list[str], options: Options) -> list[str]:
    kept = []
    for places in str(options.get("images", ":")).split(","):
        first, last = places.split(":")
        kept += names[int(first or 0) : int(last or len(names))]
    return kept


def _folders_with(path: Path, name: str) -> list[Path]:
    return sorted(parent for parent in path.iterdir() if (parent / name).is_dir())


def _scene(folder: Path, **values) -> Scene:
    database, pairs = folder / "database.db", folder / "pairs.txt"
    defaults = {
        "name": folder.name,
        "database": database if database.exists() else None,
        "pairs": pairs if pairs.exists() else None,
        "depth_folders": {
            depth.name: depth
            for depth in sorted(folder.glob("depth*"))
            if depth.is_dir()
        },
    }
    return Scene(**{**defaults, **values})


def _check_images(scene: Scene) -> None:
    if len(scene.truth) < 2:
        raise BenchmarkError(f"scene '{scene.name}' has less than two images")
    # Mappers do not need the images where key points are given.
    if scene.database is not None and not scene.image_folder.is_dir():
        return
    for name in scene.truth:
        if not (scene.image_folder / name).exists():
            raise BenchmarkError(
                f"image '{scene.image_folder / name}' of scene "
                f"'{scene.name}' does not exist"
            )


def _read_strecha_camera(path: Path) -> Pose:
    # K by rows, three zeros, world_from_cam rotation by rows, centre, size.
    values = np.array(path.read_text().split(), float)
    if len(values) < 24:
        raise BenchmarkError(f"'{path}' has {len(values)} of 24 numbers")
    rotation = values[12:21].reshape(3, 3).T
    return Pose(rotation, -rotation @ values[21:24])


def _read_scan_alignment(path: Path) -> tuple[Scan, ...]:
    # A MeshLab project; matrices take scans to the world.
    scans = []
    for mesh in xml.etree.ElementTree.parse(path).iter("MLMesh"):
        matrix = np.array((mesh.findtext("MLMatrix44") or "").split(), float)
        if matrix.size != 16:
            raise BenchmarkError(f"'{path}' has a matrix without 16 numbers")
        scans.append(Scan(path.parent / mesh.get("filename"), matrix.reshape(4, 4)))
    return tuple(scans)


def _read_imc_calibration(image_set: Path, image: Path) -> Pose:
    path = image_set / "calibration" / f"calibration_{image.stem}.h5"
    if not path.exists():
        raise BenchmarkError(f"calibration '{path}' does not exist")
    with h5py.File(path) as file:
        return Pose(
            np.array(file["R"], float), np.array(file["T"], float).reshape(3)
        )


def _read_capture_table(path: Path) -> list[list[str]]:
    if not path.exists():
        raise BenchmarkError(f"'{path}' does not exist")
    with path.open(newline="") as file:
        rows = csv.reader(file, skipinitialspace=True)
        return [
            [cell.strip() for cell in row]
            for row in rows
            if row and not row[0].startswith("#")
        ]


def _pose_from_cells(cells: list[str]) -> Pose:
    values = np.array(cells[:7], float)
    return Pose(rotation_from_quaternion(values[:4]), values[4:7])


def _read_capture_poses(session: Path, pattern: re.Pattern) -> dict[str, Pose]:
    # Unlike kapture's, poses of trajectories and rigs point to the world.
    cameras = {
        row[0]
        for row in _read_capture_table(session / "sensors.txt")
        if row[2] == "camera" and pattern.search(row[0])
    }
    world_from_device = {
        (row[0], row[1]): _pose_from_cells(row[2:])
        for row in _read_capture_table(session / "trajectories.txt")
    }
    rigs = {}
    if (session / "rigs.txt").exists():
        for row in _read_capture_table(session / "rigs.txt"):
            rigs[row[1]] = (row[0], _pose_from_cells(row[2:]))
    poses = {}
    for timestamp, sensor, name in _read_capture_table(session / "images.txt"):
        if sensor not in cameras:
            continue
        world_from_cam = world_from_device.get((timestamp, sensor))
        if world_from_cam is None and sensor in rigs:
            rig, rig_from_cam = rigs[sensor]
            world_from_rig = world_from_device.get((timestamp, rig))
            if world_from_rig is not None:
                world_from_cam = world_from_rig @ rig_from_cam
        # Images without pose are no part of the benchmark.
        if world_from_cam is not None:
            poses[name] = world_from_cam.inverse()
    return poses
