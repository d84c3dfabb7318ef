"""What a data set gives to the benchmark."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from .geometry import Pose


@dataclasses.dataclass(frozen=True, eq=False)
class Scan:
    """A laser scan: a PLY file and the transform into the world."""

    path: Path
    world_from_scan: np.ndarray  # 4x4


@dataclasses.dataclass(frozen=True)
class Scene:
    """Images with true poses."""

    name: str  # unique in the data set; may have slashes
    # Images are image_folder / name, with the names of the true poses.
    image_folder: Path
    truth: dict[str, Pose]
    # Accuracy of true positions [truth unit], for COLMAP's metrics.
    position_accuracy: float
    # Whether the truth is in the unit of metric depth maps.
    is_metric: bool = True
    # Key points and matches as given; None = extracted by the benchmark.
    database: Path | None = None
    # Image pairs to match, lines of two names; None = all pairs.
    pairs: Path | None = None
    # Folders of depth maps, by the names that engines ask for.
    depth_folders: dict[str, Path] = dataclasses.field(default_factory=dict)
    scans: tuple[Scan, ...] = ()
    # Kinds of depth that the database already has.
    database_depths: tuple[str, ...] = ()
    # Truth units per unit of a kind of depth, where that is not is_metric's.
    depth_units: dict[str, float] = dataclasses.field(default_factory=dict)
    # "fit": constants may be chosen on it; "report": it is only looked at.
    role: str = "report"
    # Poses are true to about this [deg]: the AUC up to less says nothing.
    min_threshold_deg: float = 0.0
    # Whether one camera took all images, whatever the database says ...
    single_camera: bool = False
    # ... and whether the database gets one camera entry for all of them.
    merge_cameras: bool = False
    # Focal lengths by image [px] that the database gets as if from EXIF data.
    prior_focal_lengths: dict[str, float] = dataclasses.field(
        default_factory=dict
    )
    # What a synthetic scene was made with, for tables and plots.
    parameters: dict = dataclasses.field(default_factory=dict)

    def has_depth(self, kind: str) -> bool:
        return kind in self.depth_folders or kind in self.database_depths

    def depth_unit(self, kind: str) -> float | None:
        """Truth units per unit of a kind of depth; None where unknown."""
        return self.depth_units.get(kind, 1.0 if self.is_metric else None)
