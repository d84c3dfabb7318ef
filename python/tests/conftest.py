"""Scenes that tests share. The package is that of the build folder, or the
installed one."""

import pathlib
import shutil
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

import dgsfm

SHARED = pathlib.Path(__file__).parents[2] / ".." / "shared" / "data"


def run_program(*arguments):
    """The program of the package: exit code, standard output and error."""
    result = subprocess.run(
        [sys.executable, "-m", "dgsfm", *map(str, arguments)],
        capture_output=True,
        text=True,
    )
    return result.returncode, result.stdout, result.stderr


def synthesize(folder, *arguments):
    code, _, error = run_program(
        "depth_scene_synthesizer", "--output_path", folder, *arguments
    )
    assert code == 0, error


@pytest.fixture(scope="session")
def synthetic(tmp_path_factory):
    """Folder of a small database with depth at the key points, and its truth."""
    folder = tmp_path_factory.mktemp("synthetic") / "scene"
    synthesize(folder, "--database_only", 1, "--num_images", 10)
    return folder


@pytest.fixture
def database(synthetic, tmp_path):
    """A copy of the small database for one test."""
    return pathlib.Path(shutil.copy(synthetic / "database.db", tmp_path))


@pytest.fixture(scope="session")
def photos(tmp_path_factory):
    """Folder with a few small images, their depth maps and their truth."""
    folder = tmp_path_factory.mktemp("photos") / "scene"
    synthesize(
        folder, "--family", "facade", "--num_images", 8, "--width", 480,
        "--height", 360, "--focal_length", 420,
    )  # fmt: skip
    return folder


@pytest.fixture
def fountain(tmp_path):
    """A copy of a database of real photos, and depth by names of images."""
    folder = SHARED / "fountain-P11"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    depths = {p.name[: -len(".npy")]: np.load(p) for p in folder.glob("depth/*.npy")}
    return pathlib.Path(shutil.copy(folder / "database.db", tmp_path)), depths


def query(database_path, statement):
    with sqlite3.connect(database_path) as connection:
        return connection.execute(statement).fetchall()


def image_names(database_path):
    return [name for (name,) in query(database_path, "SELECT name FROM images")]


def image_size(database_path):
    """Height and width of the first camera's images."""
    return query(database_path, "SELECT height, width FROM cameras")[0]


def flat_depths(database_path, depth=2.0):
    """A map for each image."""
    height, width = image_size(database_path)
    shape = height // 10, width // 10
    return {
        name: np.full(shape, depth, np.float32) for name in image_names(database_path)
    }


def model_bytes(folder):
    names = "cameras.bin", "images.bin", "points3D.bin"
    return [(pathlib.Path(folder) / name).read_bytes() for name in names]


assert dgsfm.__all__
