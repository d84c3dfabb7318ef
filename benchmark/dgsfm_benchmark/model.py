"""Models of COLMAP as plain values."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pycolmap

from .geometry import Pose


@dataclasses.dataclass(frozen=True)
class Model:
    """What the metrics need of a reconstruction."""

    poses: dict[str, Pose]  # of registered images, by name
    points: np.ndarray  # N x 3
    mean_track_length: float
    mean_reprojection_error_px: float


def read_model(path: Path) -> Model:
    """Reads a COLMAP model, binary or text, of any version."""
    reconstruction = pycolmap.Reconstruction(str(path))
    poses = {}
    for image_id in reconstruction.reg_image_ids():
        image = reconstruction.image(image_id)
        cam_from_world = image.cam_from_world()
        poses[image.name] = Pose(
            cam_from_world.rotation.matrix(),
            np.array(cam_from_world.translation),
        )
    points = [point.xyz for point in reconstruction.points3D.values()]
    return Model(
        poses,
        np.array(points).reshape(-1, 3),
        reconstruction.compute_mean_track_length() if points else 0.0,
        reconstruction.compute_mean_reprojection_error() if points else 0.0,
    )


def read_focal_lengths(path: Path) -> dict[str, float]:
    """Mean focal lengths of a COLMAP model's images [px], by name."""
    reconstruction = pycolmap.Reconstruction(str(path))
    return {
        image.name: reconstruction.cameras[image.camera_id].mean_focal_length()
        for image in reconstruction.images.values()
    }


def read_models(folder: Path) -> list[Model]:
    """All models in the numbered folders of a mapper's output, the one with
    most images (and then points) first."""
    models = [
        read_model(path)
        for path in sorted(folder.iterdir())
        if any((path / f"images.{kind}").exists() for kind in ("bin", "txt"))
    ]
    return sorted(models, key=lambda m: (-len(m.poses), -len(m.points)))
