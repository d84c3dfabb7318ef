"""Models of depth_global_mapper under the rules of other programs' loaders.

Usage: COLMAP=PATH model_loaders.py

Maps a synthetic scene and reads the binary model as nerfstudio (a copy of
COLMAP's read_write_model.py) and gsplat (the scene manager of an older
pycolmap) do, with pycolmap, and after conversion to text and PLY. Exit code 77
without NumPy and pycolmap.
"""

import os
import pathlib
import struct
import subprocess
import sys
import tempfile

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ["COLMAP"]
# What both loaders turn into a camera of their own, with the number of its
# parameters.
NUM_PARAMS = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8, 5: 8}
NO_POINT = 0xFFFFFFFFFFFFFFFF


class Reader:
    """Packed little-endian numbers up to the very end of a file."""

    def __init__(self, path):
        self.data = path.read_bytes()
        self.pos = 0

    def read(self, form):
        values = struct.unpack_from("<" + form, self.data, self.pos)
        self.pos += struct.calcsize("<" + form)
        return values if len(values) > 1 else values[0]

    def read_name(self):
        end = self.data.index(b"\0", self.pos)
        name = self.data[self.pos : end].decode("utf-8")
        self.pos = end + 1
        return name

    def check_end(self):
        assert self.pos == len(self.data), "bytes behind the last record"


def read_model(folder):
    cameras, images, points = {}, {}, {}
    file = Reader(folder / "cameras.bin")
    for _ in range(file.read("Q")):
        camera_id, model, width, height = file.read("iiQQ")
        assert model in NUM_PARAMS, f"camera model {model}"
        cameras[camera_id] = (width, height, file.read("d" * NUM_PARAMS[model]))
    file.check_end()
    file = Reader(folder / "images.bin")
    for _ in range(file.read("Q")):
        image_id = file.read("i")
        pose = file.read("7d")
        camera_id = file.read("i")
        name = file.read_name()
        points2d = [file.read("ddQ") for _ in range(file.read("Q"))]
        images[image_id] = (pose, camera_id, name, points2d)
    file.check_end()
    file = Reader(folder / "points3D.bin")
    for _ in range(file.read("Q")):
        point_id = file.read("Q")
        xyz, rgb, error = file.read("3d"), file.read("3B"), file.read("d")
        track = [file.read("ii") for _ in range(file.read("Q"))]
        points[point_id] = (xyz, rgb, error, track)
    file.check_end()
    return cameras, images, points


def check_model(folder):
    """What the loaders take for granted."""
    cameras, images, points = read_model(folder)
    assert images and points
    names = [name for _, _, name, _ in images.values()]
    assert len(set(names)) == len(names)
    for pose, camera_id, name, points2d in images.values():
        assert camera_id in cameras
        assert abs(np.linalg.norm(pose[:4]) - 1) < 1e-9
        assert np.isfinite(pose).all()
        for x, y, point_id in points2d:
            assert point_id == NO_POINT or point_id in points
    for xyz, rgb, error, track in points.values():
        assert np.isfinite(xyz).all() and np.isfinite(error) and error >= 0
        assert len(track) >= 2
        for image_id, idx in track:
            assert image_id in images
    # gsplat numbers the points by their ids and looks up track elements.
    for point_id, (_, _, _, track) in points.items():
        for image_id, idx in track:
            assert images[image_id][3][idx][2] == point_id
    # nerfstudio's cameras need a positive focal length; the first parameter.
    assert all(params[0] > 0 for _, _, params in cameras.values())
    return cameras, images, points


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        run = lambda *arguments: subprocess.run(
            [COLMAP, *map(str, arguments)], check=True, capture_output=True
        )
        run(
            "depth_scene_synthesizer", "--database_only", 1, "--num_images", 10,
            "--output_path", folder / "scene",
        )  # fmt: skip
        database = folder / "scene" / "database.db"
        # The layout that both loaders look for.
        sparse = folder / "sparse"
        run("depth_global_mapper", "--database_path", database, "--output_path", sparse)
        cameras, images, points = check_model(sparse / "0")

        model = pycolmap.Reconstruction(sparse / "0")
        assert model.num_reg_images() == len(images)
        assert model.num_points3D() == len(points)

        for kind in ("TXT", "PLY"):
            out = folder / kind
            out.mkdir()
            target = out if kind == "TXT" else out / "points.ply"
            result = subprocess.run(
                [COLMAP, "model_converter", "--input_path", sparse / "0",
                 "--output_path", target, "--output_type", kind],
                capture_output=True,
            )  # fmt: skip
            if result.returncode != 0:
                print("no COLMAP to convert the model")
                return
        text = pycolmap.Reconstruction(folder / "TXT")
        assert text.num_points3D() == len(points)
        header = (folder / "PLY" / "points.ply").read_bytes()[:200]
        assert f"element vertex {len(points)}".encode() in header
        print(f"{len(images)} images, {len(points)} points read by every loader")


if __name__ == "__main__":
    main()
