"""Figures of a model against the truth."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy import spatial

from .geometry import Pose, Similarity, align_points

Poses = Mapping[str, Pose]  # by image name


def relative_pose_error_deg(
    truth1: Pose,
    truth2: Pose,
    estimate1: Pose,
    estimate2: Pose,
    position_accuracy: float = 0.0,
) -> float:
    """Larger one of the errors of rotation and direction of translation.

    Both are of cam2_from_cam1. The direction counts in full, from 0 to 180
    degrees; it is exempt where the true baseline is below the accuracy of
    true positions, and 180 degrees where the estimated one is zero.
    """
    truth = truth2 @ truth1.inverse()
    estimate = estimate2 @ estimate1.inverse()
    # The chord, which is exact near zero, where the trace is not.
    chord = np.linalg.norm(truth.rotation - estimate.rotation) / np.sqrt(8)
    rotation_deg = np.degrees(2 * np.arcsin(min(chord, 1.0)))
    baseline = np.linalg.norm(truth.translation)
    estimated_baseline = np.linalg.norm(estimate.translation)
    if baseline <= position_accuracy:
        direction_deg = 0.0
    elif estimated_baseline == 0:
        direction_deg = 180.0
    else:
        direction_deg = np.degrees(
            np.arctan2(
                np.linalg.norm(
                    np.cross(truth.translation, estimate.translation)
                ),
                truth.translation @ estimate.translation,
            )
        )
    return float(max(rotation_deg, direction_deg))


def paper_pose_errors_deg(truth: Poses, estimate: Poses) -> np.ndarray:
    """Errors of all unordered pairs of true images, as DF-SfM and the paper.

    Pairs with a missing image have an infinite error. Pairs are formed in the
    order of names, which matters: the direction of cam2_from_cam1 is that of
    cam1_from_cam2 only where the rotation is right.
    """
    errors = [
        relative_pose_error_deg(
            truth[a], truth[b], estimate[a], estimate[b], 1e-9
        )
        if a in estimate and b in estimate
        else np.inf
        for a, b in itertools.combinations(sorted(truth), 2)
    ]
    return np.array(errors)


def colmap_pose_errors_deg(
    truth: Poses, models: Iterable[Poses], position_accuracy: float
) -> np.ndarray:
    """Errors as in COLMAP 4.x's benchmark: all ordered pairs in one model.

    A pair in several models counts for each; pairs of true images together in
    no model, and pairs with an image that has no truth, have 180 degrees.
    """
    errors = []
    found = set()
    for model in models:
        for a, b in itertools.permutations(sorted(model), 2):
            if a not in truth or b not in truth:
                errors.append(180.0)
                continue
            found.add((a, b))
            errors.append(
                relative_pose_error_deg(
                    truth[a], truth[b], model[a], model[b], position_accuracy
                )
            )
    num_pairs = len(truth) * (len(truth) - 1)
    errors += [180.0] * (num_pairs - len(found))
    return np.array(errors or [180.0])


def paper_auc(
    errors: np.ndarray, thresholds: Sequence[float]
) -> list[float]:
    """Area under the recall of errors, in per cent, by the exact trapezoid.

    Recall rises linearly between sorted errors from (0, 0) and stays level
    from the last error below the threshold.
    """
    errors = np.sort(errors)
    recall = np.arange(len(errors) + 1) / max(len(errors), 1)
    return _areas(np.r_[0, errors], recall, thresholds, side="left")


def colmap_auc(
    errors: np.ndarray, thresholds: Sequence[float], min_error: float
) -> list[float]:
    """As ``paper_auc``, but errors up to ``min_error`` count as none."""
    errors = np.sort(errors)
    recall = np.arange(1, len(errors) + 1) / max(len(errors), 1)
    num_small = int(np.searchsorted(errors, min_error, side="right"))
    if min_error > 0:
        plateau = num_small / max(len(errors), 1)
        errors = np.r_[0, min_error, errors[num_small:]]
        recall = np.r_[plateau, plateau, recall[num_small:]]
    else:
        errors, recall = np.r_[0, errors], np.r_[0, recall]
    return _areas(errors, recall, thresholds, side="right")


def _areas(errors, recall, thresholds, side):
    areas = []
    for threshold in thresholds:
        end = int(np.searchsorted(errors, threshold, side=side))
        x = np.r_[errors[:end], threshold]
        y = np.r_[recall[:end], recall[end - 1]]
        area = ((x[1:] - x[:-1]) * (y[1:] + y[:-1])).sum() / 2
        areas.append(float(100 * area / threshold))
    return areas


def align_centers(
    truth: Poses, estimate: Poses, with_scale: bool = True
) -> Similarity | None:
    """truth_from_estimate on the camera centres of common images."""
    names = sorted(set(truth) & set(estimate))
    if not names:
        return None
    return align_points(
        np.array([estimate[name].center() for name in names]),
        np.array([truth[name].center() for name in names]),
        with_scale,
    )


def position_metrics(truth: Poses, estimate: Poses) -> dict[str, float]:
    """``scale``: what the model is multiplied with to fit the truth (1 is
    metric); ``rms_center``: of camera centres after alignment [truth unit].

    Empty where fewer than three common images leave the alignment open.
    """
    similarity = align_centers(truth, estimate)
    if similarity is None:
        return {}
    names = sorted(set(truth) & set(estimate))
    centers = np.array([estimate[name].center() for name in names])
    true_centers = np.array([truth[name].center() for name in names])
    distances = np.linalg.norm(similarity.apply(centers) - true_centers, axis=1)
    return {
        "scale": float(similarity.scale),
        "rms_center": float(np.sqrt((distances**2).mean())),
    }


def thin_points(
    points: np.ndarray, voxel_size: float = 0.01
) -> np.ndarray:
    """The mean point of each occupied cell of a grid, so that density, which
    differs between methods and over a scan, does not weigh."""
    if len(points) == 0:
        return points
    cells = np.floor(points / voxel_size).astype(np.int64)
    cells -= cells.min(axis=0)
    sizes = cells.max(axis=0) + 1
    # One number a cell: unique is much slower on rows.
    cells = (cells[:, 0] * sizes[1] + cells[:, 1]) * sizes[2] + cells[:, 2]
    _, cell_idxs, counts = np.unique(
        cells, return_inverse=True, return_counts=True
    )
    means = np.empty((len(counts), 3))
    for k in range(3):
        means[:, k] = np.bincount(cell_idxs, points[:, k]) / counts
    return means


def point_cloud_metrics(
    points: np.ndarray,
    scan: np.ndarray,
    tolerances: Sequence[float] = (0.01, 0.02, 0.05),
) -> dict[str, float]:
    """Accuracy and completeness in per cent for N x 3 points in the scan's
    frame [m]: the shares of points, and of the scan, that have a point of the
    other within the tolerance. The clouds should be thinned by
    ``thin_points``, as ETH3D's own program does; that also leaves out points
    that the laser could not see, which count as inaccurate here.
    """
    metrics = {}
    for tolerance in tolerances:
        suffix = f"_{round(100 * tolerance)}cm"
        metrics["accuracy" + suffix] = _share_near(points, scan, tolerance)
        metrics["completeness" + suffix] = _share_near(scan, points, tolerance)
    return metrics


def _share_near(points, targets, tolerance):
    if len(points) == 0 or len(targets) == 0:
        return 0.0
    distances, _ = spatial.cKDTree(targets).query(
        points, distance_upper_bound=tolerance
    )
    return float(100 * np.isfinite(distances).mean())
