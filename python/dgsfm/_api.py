"""The functions of the package."""

from __future__ import annotations

import json
import os
import pathlib
from typing import Any, Callable, Mapping, Optional, Sequence, Tuple, TypeVar, Union

import numpy as np

from . import _core
from .options import (
    DenseMatchImporterOptions,
    DepthExporterOptions,
    DepthGeometricVerifierOptions,
    DepthGlobalMapperOptions,
    DepthImporterOptions,
)

DatabasePath = Union[str, "os.PathLike[str]"]
"""File of a COLMAP database."""

Path = Union[str, "os.PathLike[str]"]
Progress = Optional[Callable[[str, int, int], Any]]
Options = TypeVar("Options")


def _merge(cls: type, options: Any, fields: Mapping[str, Any]) -> dict:
    """The options that have not their default, by names of the command line."""
    merged = cls()
    if isinstance(options, cls):
        merged.mergedict(options.todict())
    elif isinstance(options, Mapping):
        merged.mergedict(options)
    elif options is not None:
        raise TypeError(f"options must be {cls.__name__}, not {type(options).__name__}")
    merged.mergedict(fields)
    return {name: _plain(value) for name, value in merged.changed().items()}


def _plain(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.item() if isinstance(value, np.generic) else value


def _array(value: Any, what: str) -> np.ndarray:
    """Real numbers in C order and the machine's byte order."""
    if hasattr(value, "detach"):  # A tensor of PyTorch.
        value = value.detach().cpu()
    array = np.asarray(value)
    if array.dtype.kind not in "fiub":
        raise TypeError(f"{what}: an array of {array.dtype} has no real numbers")
    if array.dtype.kind == "f" and array.dtype.itemsize > 8:
        array = array.astype(np.float64)
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _arrays(value: Any, name: str, what: str) -> dict:
    """Arrays by name, those of a mapping or the only one."""
    if not isinstance(value, Mapping):
        value = {name: value}
    return {
        key: _array(array, f"{what}, {key}")
        for key, array in value.items()
        if array is not None
    }


def import_depth(
    database_path: DatabasePath,
    depths: Union[Path, Mapping[str, Any]],
    options: Union[DepthImporterOptions, Mapping[str, Any], None] = None,
    *,
    progress: Progress = None,
    **fields: Any,
) -> dict:
    """Stores depth maps and their values at the key points in the database.

    depths is
    - a folder of depth maps named after the images, or an HDF5 file, as for the
      command depth_importer, or
    - a mapping of the names of images in the database to, for each, an array,
      the path of a file, or a mapping of arrays with the names that .npz files
      have.

    Arrays are height x width numbers of any real type: z-depth in metres unless
    the options depth_type ("z", "range", "inverse"), depth_scale and depth_unit
    ("metric", "relative") say otherwise. Unknown depth is 0, negative, infinite
    or NaN. A map covers the whole image at any resolution and has its aspect.
    The names of a mapping are those of MoGe-2's output: depth (height x width) or
    points (height x width x 3, in the camera frame), mask, confidence or conf,
    uncertainty (height x width each), and intrinsics (3 x 3, in units of the
    map's sides, of its pixels or of the image's). PyTorch tensors will do.

    Options can be given as an object, as a mapping, or as keywords, as in
    import_depth(path, depths, depth_unit="relative").

    progress(label, done, total), if given, is called with the number of images.

    Returns a dict: "imported" (a dict for each image, with coverage and
    median_depth), "failed" (empty), "num_unchanged" (stored before, from the
    same numbers), "num_keypoints_with_depth", "images_without_depth",
    "depths_without_image".

    Raises RuntimeError naming the image or file if a map cannot be read or has
    the wrong shape; the others are stored. Raises TypeError for what is no array
    of real numbers.
    """
    values = _merge(DepthImporterOptions, options, fields)
    if isinstance(depths, Mapping):
        given: Any = {
            str(name): os.fspath(depth)
            if isinstance(depth, (str, os.PathLike))
            else _arrays(depth, "depth", f"depth of {name}")
            for name, depth in depths.items()
        }
    else:
        given = os.fspath(depths)
    return _core.import_depth(os.fspath(database_path), given, values, progress)


def import_dense_matches(
    database_path: DatabasePath,
    matches: Union[Path, Mapping[Tuple[str, str], Any]],
    options: Union[DenseMatchImporterOptions, Mapping[str, Any], None] = None,
    *,
    progress: Progress = None,
    **fields: Any,
) -> dict:
    """Stores correspondences of dense matchers as key points and matches.

    matches is
    - an HDF5 file, .npz archive or folder of these, as for the command
      dense_match_importer, or
    - a mapping of pairs of names of images to, for each pair, N x 4 numbers
      (x and y in the first image, x and y in the second) or a mapping of
      keypoints0 (N x 2), keypoints1 (N x 2) and confidence (N).

    Coordinates are in pixels; the centre of the first pixel is (0.5, 0.5), or
    (0, 0) with coordinate_offset=0.5.

    Options can be given as an object, as a mapping, or as keywords.

    Returns a dict of counts: "num_pairs", "num_matches", "num_keypoints",
    "num_points" (before they were merged), "num_matches_left_out", and
    "groups_without_images".

    Raises RuntimeError naming pair or database; nothing is stored then.
    """
    values = _merge(DenseMatchImporterOptions, options, fields)
    if isinstance(matches, Mapping):
        given: Any = {
            f"{name1}<>{name2}": _arrays(
                value, "matches", f"matches of {name1} and {name2}"
            )
            for (name1, name2), value in matches.items()
        }
    else:
        given = os.fspath(matches)
    return _core.import_dense_matches(os.fspath(database_path), given, values, progress)


def verify_pairs(
    database_path: DatabasePath,
    options: Union[DepthGeometricVerifierOptions, Mapping[str, Any], None] = None,
    *,
    progress: Progress = None,
    **fields: Any,
) -> dict:
    """Verifies image pairs with depth and stores the results in the database.

    Pairs whose stored result still holds are not verified again, so a run that
    was broken off, by Ctrl-C too, goes on where it stopped.

    With output_path, shard_index and num_shards a part of the pairs is verified,
    and the result goes to that file, for merge_shards; the database is not
    written.

    Options can be given as an object, as a mapping, or as keywords.
    progress(label, done, total), if given, is called with the number of pairs.

    Returns a dict: "pairs" (number of pairs by status), "num_kept" and
    "num_deleted" (stored results that still held, and that did not).
    """
    values = _merge(DepthGeometricVerifierOptions, options, fields)
    return _core.verify_pairs(os.fspath(database_path), values, progress)


def merge_shards(
    database_path: DatabasePath,
    shard_paths: Union[Path, Sequence[Path]],
    *,
    num_threads: int = -1,
    progress: Progress = None,
) -> dict:
    """Stores the results of all shards of a verification in the database.

    Shards are files that verify_pairs wrote with the options output_path,
    shard_index and num_shards; shard_paths are these, or folders of them (*.db).
    The database then holds what verify_pairs without these options stores.

    progress(label, done, total), if given, is called with the number of shards.

    Returns a dict as that of verify_pairs.

    Raises RuntimeError, and leaves the database as it was, if shards are missing,
    damaged, of other data or do not belong together.
    """
    if isinstance(shard_paths, (str, os.PathLike)):
        shard_paths = [shard_paths]
    paths = [os.fspath(path) for path in shard_paths]
    if any("," in path for path in paths):
        raise ValueError("paths of shards must have no commas")
    return _core.merge_shards(
        os.fspath(database_path), ",".join(paths), num_threads, progress
    )


class Model(os.PathLike):
    """A model in a folder, as COLMAP writes it; usable as its path."""

    def __init__(self, path: Path, report: Mapping[str, Any]):
        self.path = pathlib.Path(path)
        """Folder of cameras.bin, images.bin and points3D.bin."""
        self.num_images: int = report["images"]
        """Images with a pose."""
        self.num_points: int = report["points"]
        """Points of the sparse cloud."""
        self.unit: str = report["unit"]
        """What lengths are measured in, as in report.json."""

    def __fspath__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return (
            f"Model('{self.path}', {self.num_images} images, "
            f"{self.num_points} points, unit {self.unit})"
        )

    @property
    def reconstruction(self) -> Any:
        """The model as a pycolmap.Reconstruction, read anew each time.

        Raises ImportError without pycolmap.
        """
        import pycolmap

        return pycolmap.Reconstruction(str(self.path))


class Models(list):
    """Models, largest first, with the report of the run."""

    def __init__(self, models: Sequence[Model], report: dict):
        super().__init__(models)
        self.report = report
        """report.json: stages, warnings, cameras, images, pairs."""

    @property
    def reconstructions(self) -> list:
        """The models as pycolmap.Reconstruction objects.

        Raises ImportError without pycolmap.
        """
        return [model.reconstruction for model in self]


def read_report(output_path: Path) -> dict:
    """The report.json that global_depth_mapping wrote to that folder."""
    path = pathlib.Path(output_path) / "report.json"
    return json.loads(path.read_text(encoding="utf-8"))


def global_depth_mapping(
    database_path: DatabasePath,
    output_path: Path,
    image_path: Optional[Path] = None,
    options: Union[DepthGlobalMapperOptions, Mapping[str, Any], None] = None,
    *,
    progress: Progress = None,
    **fields: Any,
) -> Models:
    """Reconstructs a database, with depth where it has been imported.

    Writes models to the folders 0, 1, ... of output_path, report.json and
    project.ini beside them; those of an earlier run are replaced. Pairs that
    verify_pairs has not verified are verified first. With image_path, the folder
    of the images, points get colours and cameras EXIF data.

    Options can be given as an object, as a mapping, or as keywords. With paper=1
    the preset of the paper sets the defaults of the others.
    progress(label, done, total), if given, is called with the number of pairs.

    Returns a list of Model, largest first, with the report as its attribute
    `report`. Poses are cam_from_world, in metres if the model's unit is "metres".

    Raises RuntimeError if no model came out of it; read_report has the reasons.
    """
    values = _merge(DepthGlobalMapperOptions, options, fields)
    result = _core.global_depth_mapping(
        os.fspath(database_path),
        os.fspath(output_path),
        "" if image_path is None else os.fspath(image_path),
        values,
        progress,
    )
    report = read_report(output_path)
    return Models(
        [Model(*model) for model in zip(result["models"], report["models"])], report
    )


def export_depth(
    database_path: DatabasePath,
    output_path: Path,
    input_path: Optional[Path] = None,
    options: Union[DepthExporterOptions, Mapping[str, Any], None] = None,
    *,
    progress: Progress = None,
    **fields: Any,
) -> dict:
    """Writes the depth maps of the database as files, named after the images.

    With input_path, the folder of a model, they are fitted to its points and in
    its unit; without, as they were imported. format is "npy", "png", "exr",
    "bin" (COLMAP's dense maps) or "3dgs" (16-bit inverse depth and
    depth_params.json, for 3D Gaussian splatting).

    Options can be given as an object, as a mapping, or as keywords.

    Returns a dict: "exported" (by image: file and, with a model, scale, shift,
    num_points and residual), "images_without_map", "images_without_model",
    "images_with_few_points".

    Raises RuntimeError naming file or image.
    """
    values = _merge(DepthExporterOptions, options, fields)
    return _core.export_depth(
        os.fspath(database_path),
        os.fspath(output_path),
        "" if input_path is None else os.fspath(input_path),
        values,
        progress,
    )


def evaluate(
    input_path: Path,
    ground_truth_path: Path,
    thresholds_deg: Sequence[float] = (1, 3, 5, 10),
) -> dict:
    """Compares the camera poses of a model with ground truth.

    Paths are folders of models, or of several, of which the one with most images
    counts; images are matched by name.

    Returns what the command model_evaluator writes to --json_path: "auc" by
    threshold [per cent], median errors [deg], centre errors [unit of the truth],
    "truth_from_model_scale", "num_images" and "num_registered".

    Raises RuntimeError if one of the models cannot be read.
    """
    thresholds = [float(threshold) for threshold in thresholds_deg]
    if not thresholds or not all(threshold > 0 for threshold in thresholds):
        raise ValueError("thresholds_deg must be positive numbers")
    return json.loads(
        _core.evaluate(os.fspath(input_path), os.fspath(ground_truth_path), thresholds)
    )
