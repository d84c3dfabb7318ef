"""Import this first: finds the benchmark, or skips the test."""

import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
SHARED = PROJECT.parent / "shared"

sys.path.insert(0, str(PROJECT / "benchmark"))

try:
    import h5py  # noqa: F401
    import matplotlib  # noqa: F401
    import numpy as np
    import pycolmap  # noqa: F401
    import scipy  # noqa: F401
except ImportError as error:
    print(f"SKIPPED: {error}; scripts/python_env.sh installs the packages")
    sys.exit(77)

from dgsfm_benchmark.geometry import Pose  # noqa: E402


def random_rotation(random: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q = q @ np.diag(np.sign(np.diag(r)))
    return q * np.sign(np.linalg.det(q))


def small_rotation(random: np.random.Generator, angle_rad: float) -> np.ndarray:
    x, y, z = random.normal(size=3) * angle_rad
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    u, _, vt = np.linalg.svd(np.eye(3) + cross)
    return u @ vt


def random_poses(num_images: int, seed: int = 0) -> dict[str, Pose]:
    """Cameras in any direction, named 0000.jpg and on."""
    random = np.random.default_rng(seed)
    return {
        f"{i:04d}.jpg": Pose(random_rotation(random), random.normal(size=3))
        for i in range(num_images)
    }


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """w, x, y, z."""
    values = pycolmap.Rotation3d(rotation).quat  # x, y, z, w
    return np.r_[values[3], values[:3]]


def write_text_model(folder: Path, poses: dict[str, Pose]) -> None:
    """A COLMAP text model without points."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("1 PINHOLE 64 48 50 50 32 24\n")
    (folder / "points3D.txt").write_text("")
    lines = []
    for i, (name, pose) in enumerate(poses.items()):
        values = [*quaternion(pose.rotation), *pose.translation]
        numbers = " ".join(f"{value:.17g}" for value in values)
        lines += [f"{i + 1} {numbers} 1 {name}", ""]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")


def write_images(folder: Path, names) -> None:
    """Grey images of 64 x 48 pixels."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        array = np.full((48, 64), 128, np.uint8)
        pycolmap.Bitmap.from_array(array).write(str(path))
