"""Laser scans in PLY files."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .errors import BenchmarkError
from .metrics import thin_points
from .scene import Scan

_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4",
    "uint": "u4", "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_FORMATS = {"binary_little_endian": "<", "binary_big_endian": ">"}


@functools.lru_cache(maxsize=1)
def read_scans(scans: Sequence[Scan]) -> np.ndarray:
    """Points of all scans in the world, thinned, N x 3."""
    clouds = []
    for scan in scans:
        points = read_ply_points(scan.path)
        matrix = scan.world_from_scan
        clouds.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return thin_points(np.concatenate(clouds))


def read_ply_points(path: Path) -> np.ndarray:
    """The vertices' x, y, z, N x 3, of an ASCII or binary PLY file whose
    vertices come first and have no lists."""
    with path.open("rb") as file:
        file_format, num_vertices, properties = _read_header(path, file)
        columns = [name for name, _ in properties]
        if any(axis not in columns for axis in "xyz"):
            raise BenchmarkError(f"'{path}' has vertices without x, y, z")
        if file_format == "ascii":
            table = np.loadtxt(file, max_rows=num_vertices, ndmin=2)
            return table[:, [columns.index(axis) for axis in "xyz"]]
        order = _FORMATS[file_format]
        dtype = np.dtype([(name, order + kind) for name, kind in properties])
        vertices = np.fromfile(file, dtype, num_vertices)
    if len(vertices) != num_vertices:
        raise BenchmarkError(f"'{path}' is cut off")
    return np.stack([vertices[axis].astype(float) for axis in "xyz"], axis=1)


def _read_header(path, file):
    file_format, num_vertices, properties = None, None, []
    in_vertices = False
    for line in iter(file.readline, b""):
        words = line.decode("ascii", "replace").split()
        if not words or words[0] in ("ply", "comment", "obj_info"):
            continue
        if words[0] == "end_header":
            break
        if words[0] == "format":
            file_format = words[1]
        elif words[0] == "element":
            in_vertices = words[1] == "vertex"
            if in_vertices:
                num_vertices = int(words[2])
            elif num_vertices is None:
                raise BenchmarkError(f"'{path}' has no vertices at its start")
        elif words[0] == "property" and in_vertices:
            if words[1] not in _TYPES:
                raise BenchmarkError(f"'{path}' has vertices with lists")
            properties.append((words[2], _TYPES[words[1]]))
    if file_format not in ("ascii", *_FORMATS) or num_vertices is None:
        raise BenchmarkError(f"'{path}' is no PLY file of points")
    return file_format, num_vertices, properties
