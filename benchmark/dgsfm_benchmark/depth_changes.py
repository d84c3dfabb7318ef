"""Depth maps changed into what users get wrong, or what other networks give.

The maps of a folder are read as they are, changed, and written as .npy files
named after the images; unknown depth is 0.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from .errors import BenchmarkError

Maps = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class DepthChange:
    """A change of all maps of a scene, and how they are imported then."""

    apply: Callable[[Maps], Maps]
    importer_options: tuple[str, ...] = ()


def _permuted(maps: Maps) -> Maps:
    """Each image gets the map of another one, half of the images away."""
    names = list(maps)
    shift = (len(names) + 1) // 2
    return {
        name: maps[names[(i + shift) % len(names)]]
        for i, name in enumerate(names)
    }


def _each(function: Callable[[np.ndarray], np.ndarray], step: int = 1):
    def change(maps: Maps) -> Maps:
        return {
            name: function(depth) if i % step == 0 else depth
            for i, (name, depth) in enumerate(maps.items())
        }

    return change


def _constant(depth: np.ndarray) -> np.ndarray:
    known = depth[depth > 0]
    return np.full_like(depth, np.median(known) if known.size else 1.0)


def _inverse(depth: np.ndarray) -> np.ndarray:
    return np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0)


def _first_maps(maps: Maps) -> Maps:
    return dict(list(maps.items())[:3])


def _relative_disparity(maps: Maps) -> Maps:
    """Disparity of 8 bits: the least one is 0 to 100 % of what it was above
    zero, by image, and what is unknown or far is 0."""
    changed = {}
    for name, depth in maps.items():
        seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
        disparity = _inverse(depth)
        known = disparity > 0
        if known.any():
            offset = np.random.default_rng(seed).uniform() * disparity[known].min()
            values = disparity - offset
            disparity = np.where(
                known, np.rint(255 * values / values[known].max()), 0
            )
        changed[name] = disparity
    return changed


CHANGES = {
    "permuted": DepthChange(_permuted),
    "a third mirrored": DepthChange(_each(np.fliplr, 3)),
    "mirrored": DepthChange(_each(np.fliplr)),
    "half-turned": DepthChange(_each(lambda depth: np.rot90(depth, 2))),
    "inverse": DepthChange(_each(_inverse)),
    "constant": DepthChange(_each(_constant)),
    "millimetres": DepthChange(_each(lambda depth: 1000.0 * depth)),
    "first three": DepthChange(_first_maps),
    "relative disparity": DepthChange(
        _relative_disparity, ("--depth_type", "relative_disparity")
    ),
}


def change_depth(source: Path, target: Path, change: str) -> None:
    """Writes the changed maps of ``source`` to the new folder ``target``.

    Raises BenchmarkError if the change is not known or there are no maps.
    """
    if change not in CHANGES:
        raise BenchmarkError(
            f"change of depth '{change}' must be one of {', '.join(CHANGES)}"
        )
    maps = {
        str(path.relative_to(source).with_suffix("")): _read_depth(path)
        for path in sorted(source.rglob("*"))
        if path.suffix in (".npy", ".png")
    }
    if not maps:
        raise BenchmarkError(f"'{source}' has no depth maps (.npy or .png)")
    for name, depth in CHANGES[change].apply(maps).items():
        path = target / f"{name}.npy"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, np.ascontiguousarray(depth, np.float32))


def _read_depth(path: Path) -> np.ndarray:
    if path.suffix == ".npy":
        depth = np.load(path).astype(np.float32)
    else:
        depth = np.array(Image.open(path)).astype(np.float32)
        depth[depth >= 65535] = 0
    return np.where(np.isfinite(depth) & (depth > 0), depth, 0)
