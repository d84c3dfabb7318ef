"""All figures of one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from . import metrics
from .model import Model, read_models
from .scans import read_scans
from .scene import Scene

# As in COLMAP's benchmark.
COLMAP_THRESHOLDS_DEG = (0.5, 1.0, 5.0, 10.0)


def evaluate(
    scene: Scene,
    output: Path,
    thresholds_deg: Sequence[float],
    succeeded: bool = True,
) -> dict:
    """Evaluates the models in a mapper's output; without models, or if the
    mapper failed, poses count as missing."""
    models = read_models(output) if succeeded else []
    largest = models[0] if models else Model({}, np.empty((0, 3)), 0.0, 0.0)
    errors = metrics.paper_pose_errors_deg(scene.truth, largest.poses)
    colmap_errors = metrics.colmap_pose_errors_deg(
        scene.truth, [m.poses for m in models], scene.position_accuracy
    )
    figures = {
        "auc": metrics.paper_auc(errors, thresholds_deg),
        "colmap_auc": metrics.colmap_auc(
            colmap_errors, COLMAP_THRESHOLDS_DEG, scene.position_accuracy
        ),
        "num_images": len(scene.truth),
        "num_registered": len(set(scene.truth) & set(largest.poses)),
        "num_models": len(models),
        "num_points": len(largest.points),
        "mean_track_length": largest.mean_track_length,
        "mean_reprojection_error_px": largest.mean_reprojection_error_px,
        **metrics.position_metrics(scene.truth, largest.poses),
    }
    if scene.scans and len(largest.points):
        figures["points"] = _evaluate_points(scene, largest)
    return figures


def _evaluate_points(scene: Scene, model: Model) -> dict:
    # In metric units: after a similarity, and as the model is, moved rigidly.
    scan = read_scans(scene.scans)
    figures = {}
    for name, with_scale in (("aligned", True), ("metric", False)):
        alignment = metrics.align_centers(
            scene.truth, model.poses, with_scale
        )
        if alignment is not None:
            figures[name] = metrics.point_cloud_metrics(
                metrics.thin_points(alignment.apply(model.points)), scan
            )
    return figures
