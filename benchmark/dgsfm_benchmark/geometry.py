"""Poses and similarity transforms.

Frames: ``cam_from_world`` takes world points to the camera,
``x_cam = R @ x_world + t``.
"""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Pose:
    """A rigid transform; cam_from_world where no frames are named."""

    rotation: np.ndarray  # 3x3
    translation: np.ndarray  # 3

    def center(self) -> np.ndarray:
        """The camera centre in the world."""
        return -self.rotation.T @ self.translation

    def inverse(self) -> Pose:
        return Pose(self.rotation.T, self.center())

    def __matmul__(self, other: Pose) -> Pose:
        return Pose(
            self.rotation @ other.rotation,
            self.rotation @ other.translation + self.translation,
        )


def rotation_from_quaternion(wxyz: np.ndarray) -> np.ndarray:
    """Rotation matrix of a quaternion w, x, y, z of any length but zero."""
    w, x, y, z = np.asarray(wxyz, float) / np.linalg.norm(wxyz)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


@dataclasses.dataclass(frozen=True)
class Similarity:
    """x_target = scale * R @ x_source + t."""

    scale: float
    rotation: np.ndarray  # 3x3
    translation: np.ndarray  # 3

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transforms points, N x 3."""
        return self.scale * points @ self.rotation.T + self.translation


def align_points(
    source: np.ndarray, target: np.ndarray, with_scale: bool = True
) -> Similarity | None:
    """Least-squares similarity (Umeyama 1991), or rigid, between N x 3 points.

    None where fewer than three points, or points on one line, leave it open.
    """
    if len(source) < 3:
        return None
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    source_offsets = source - source_mean
    target_offsets = target - target_mean
    u, singular, vt = np.linalg.svd(
        target_offsets.T @ source_offsets / len(source)
    )
    # The second singular value is zero for collinear points.
    if not singular[1] > 1e-12 * singular[0] > 0:
        return None
    signs = np.ones(3)
    signs[2] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = u @ np.diag(signs) @ vt
    scale = 1.0
    if with_scale:
        scale = singular @ signs / (source_offsets**2).sum() * len(source)
    return Similarity(
        scale, rotation, target_mean - scale * rotation @ source_mean
    )
