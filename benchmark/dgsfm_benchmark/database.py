"""Databases of COLMAP 3.8 to 4.x with some of their images."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pycolmap

from .errors import BenchmarkError

# pair_id = image_id1 * kMaxNumImages + image_id2, in every COLMAP.
MAX_NUM_IMAGES = 2147483647


def copy_with_images(
    source: Path, target: Path, names: Collection[str]
) -> None:
    """Copies a database without other images and all that belongs to them.

    Raises BenchmarkError if an image is missing.
    """
    shutil.copyfile(source, target)
    with contextlib.closing(sqlite3.connect(target)) as connection:
        connection.execute("PRAGMA foreign_keys = OFF")
        with connection:
            _delete_other_images(connection, source, set(names))
        connection.execute("VACUUM")


def _delete_other_images(connection, source, names):
    ids = {
        image_id: name
        for image_id, name in connection.execute(
            "SELECT image_id, name FROM images"
        )
    }
    missing = names - set(ids.values())
    if missing:
        raise BenchmarkError(
            f"database '{source}' has no image '{min(missing)}'"
        )
    others = [(i,) for i, name in ids.items() if name not in names]
    if not others:
        return
    connection.execute("CREATE TEMP TABLE others (id INTEGER PRIMARY KEY)")
    connection.executemany("INSERT INTO others VALUES (?)", others)
    tables = {
        name
        for (name,) in connection.execute(
            "SELECT name FROM sqlite_master WHERE type = 'table'"
        )
    }
    for table in ("images", "keypoints", "descriptors"):
        if table in tables:
            connection.execute(
                f"DELETE FROM {table} WHERE image_id IN others"
            )
    for table in ("matches", "two_view_geometries"):
        if table in tables:
            connection.execute(
                f"DELETE FROM {table} WHERE"
                f" pair_id / {MAX_NUM_IMAGES} IN others"
                f" OR pair_id % {MAX_NUM_IMAGES} IN others"
            )
    if "frame_data" in tables:
        connection.execute("DELETE FROM frame_data WHERE data_id IN others")
        connection.execute(
            "DELETE FROM frames WHERE frame_id NOT IN"
            " (SELECT frame_id FROM frame_data)"
        )


def merge_cameras(path: Path) -> None:
    """Gives all images the camera entry of the first one.

    Raises BenchmarkError if their models or sizes differ.
    """
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA foreign_keys = OFF")
        kinds = connection.execute(
            "SELECT DISTINCT model, width, height, prior_focal_length"
            " FROM cameras WHERE camera_id IN (SELECT camera_id FROM images)"
        ).fetchall()
        if len(kinds) != 1:
            raise BenchmarkError(f"'{path}' has images of different cameras")
        with connection:
            _merge_cameras(connection)


def _merge_cameras(connection):
    (camera,) = connection.execute(
        "SELECT camera_id FROM images ORDER BY image_id LIMIT 1"
    ).fetchone()
    connection.execute("UPDATE images SET camera_id = ?", (camera,))
    connection.execute("DELETE FROM cameras WHERE camera_id != ?", (camera,))
    # COLMAP 4.x: each image is a frame of the rig that its camera is.
    rig = None
    if connection.execute(
        "SELECT 1 FROM sqlite_master WHERE name = 'rigs'"
    ).fetchone():
        rig = connection.execute(
            "SELECT rig_id FROM rigs WHERE ref_sensor_id = ?"
            " AND ref_sensor_type = 0",
            (camera,),
        ).fetchone()
    if rig is not None:
        connection.execute("UPDATE frames SET rig_id = ?", rig)
        connection.execute("UPDATE frame_data SET sensor_id = ?", (camera,))
        connection.execute("DELETE FROM rigs WHERE rig_id != ?", rig)


def set_prior_focal_lengths(path: Path, focal_lengths: dict[str, float]) -> None:
    """Sets the focal length of each image's camera [px], and says that it is
    a prior, as COLMAP's extractor does where an image has EXIF data."""
    with contextlib.closing(sqlite3.connect(path)) as connection, connection:
        rows = connection.execute(
            "SELECT name, camera_id, model, params FROM images"
            " JOIN cameras USING (camera_id)"
        ).fetchall()
        for name, camera_id, model, params in rows:
            camera = pycolmap.Camera(
                model=model, params=np.frombuffer(params, float)
            )
            for i in camera.focal_length_idxs():
                camera.params[i] = focal_lengths[name]
            connection.execute(
                "UPDATE cameras SET params = ?, prior_focal_length = 1"
                " WHERE camera_id = ?",
                (np.asarray(camera.params).tobytes(), camera_id),
            )


def drop_descriptors(path: Path) -> None:
    """Mappers do not need them, and they are most of a database."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        with connection:
            connection.execute("DELETE FROM descriptors")
        connection.execute("VACUUM")
