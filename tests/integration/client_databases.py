"""Databases that COLMAP of each version made, extended by our tables.

Usage: COLMAP=PATH client_databases.py

databases/ has what feature extraction and exhaustive matching of COLMAP 3.8
(program) and of pycolmap 3.10.0 to 4.2.1 wrote for three images of 320 x 240
pixels. Each is read, extended by depth and pair geometries, left as it was
otherwise, and opened again by pycolmap. Databases that are not supported are
refused by name, and depth that is out of date is noticed. Exit code 77 without
NumPy and pycolmap.
"""

import gzip
import os
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ.get("COLMAP", "build/release/bin/colmap")
FIXTURES = sorted((pathlib.Path(__file__).parent / "databases").glob("*.db.gz"))


def run(*arguments):
    """Exit code and all output."""
    result = subprocess.run(
        [COLMAP, *map(str, arguments)], capture_output=True, text=True
    )
    return result.returncode, result.stdout + result.stderr


def execute(path, sql):
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA foreign_keys = ON")
    rows = connection.execute(sql).fetchall()
    connection.commit()
    connection.close()
    return rows


def dump(path):
    """All tables but ours, with their definitions, and the version."""
    tables = execute(
        path,
        "SELECT name, sql FROM sqlite_master WHERE type = 'table' "
        "AND name NOT LIKE 'dgsfm%' ORDER BY name",
    )
    content = {name: execute(path, f"SELECT * FROM {name}") for name, _ in tables}
    return tables, content, execute(path, "PRAGMA user_version")


class ClientDatabases(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = pathlib.Path(self.folder.name)
        self.depth = self.path / "depth"
        self.depth.mkdir()
        for i in range(3):
            depth = np.full((24, 32), 2 + i, np.float32)
            np.save(self.depth / f"{i}.png.npy", depth)

    def tearDown(self):
        self.folder.cleanup()

    def unpack(self, fixture):
        path = self.path / fixture.name[: -len(".gz")]
        path.write_bytes(gzip.decompress(fixture.read_bytes()))
        return path

    def importer(self, path):
        return run(
            "depth_importer", "--database_path", path, "--depth_path", self.depth
        )

    def newest(self):
        path = self.unpack(FIXTURES[-1])
        code, output = self.importer(path)
        self.assertEqual(code, 0, output)
        return path

    def verify(self, path):
        return run("depth_geometric_verifier", "--database_path", path)

    def mapper(self, path, *options):
        return run(
            "depth_global_mapper", "--database_path", path,
            "--output_path", self.path / "models", *options,
        )  # fmt: skip

    def test_every_version_is_extended(self):
        self.assertEqual(len(FIXTURES), 7)
        for fixture in FIXTURES:
            with self.subTest(fixture.name):
                path = self.unpack(fixture)
                before = dump(path)
                code, output = self.importer(path)
                self.assertEqual(code, 0, output)
                self.assertIn("imported 3 of 3 images", output)
                code, output = self.verify(path)
                self.assertEqual(code, 0, output)
                self.assertIn("verified 3 pairs, 3 valid", output)
                self.assertEqual(dump(path), before)
                self.assertEqual(execute(path, "PRAGMA integrity_check"), [("ok",)])
                # pycolmap opens it and brings older ones up to date, which is
                # no reason to import or verify again. It fails at those of 3.10,
                # ours or not.
                if "3.10" not in fixture.name:
                    with pycolmap.Database.open(path) as database:
                        self.assertEqual(database.num_images(), 3)
                        self.assertEqual(database.num_matched_image_pairs(), 3)
                self.assertIn("3 images were imported", self.importer(path)[1])
                code, output = self.verify(path)
                self.assertEqual(code, 0, output)

    def test_camera_models_are_refused_by_name(self):
        known = {
            "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV",
            "OPENCV_FISHEYE", "FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE",
            "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE",
        }  # fmt: skip
        num_refused = 0
        for name, model in pycolmap.CameraModelId.__members__.items():
            if name in ("INVALID", "UNDEFINED"):
                continue
            path = self.path / f"{name}.db"
            with pycolmap.Database.open(path) as database:
                camera = pycolmap.Camera.create_from_model_id(1, model, 300, 320, 240)
                camera_id = database.write_camera(camera)
                for i in range(3):
                    image = pycolmap.Image(name=f"{i}.png", camera_id=camera_id)
                    database.write_image(image)
            code, output = self.importer(path)
            if name in known:
                self.assertEqual(code, 0, f"{name}: {output}")
            else:
                self.assertEqual(code, 1, name)
                self.assertIn(name, output)
                num_refused += 1
        self.assertGreater(num_refused, 0)

    def make_rigs(self, path, are_joined):
        """Two cameras, of one rig or each of its own, and 3 frames."""
        with pycolmap.Database.open(path) as database:
            cameras = []
            for _ in range(2):
                camera = pycolmap.Camera(
                    model="PINHOLE", width=320, height=240, params=[300, 300, 160, 120]
                )
                camera.camera_id = database.write_camera(camera)
                cameras.append(camera)
            rigs = [pycolmap.Rig()]
            rigs[0].add_ref_sensor(cameras[0].sensor_id)
            if are_joined:
                rigs[0].add_sensor(cameras[1].sensor_id, pycolmap.Rigid3d())
            else:
                rigs.append(pycolmap.Rig())
                rigs[1].add_ref_sensor(cameras[1].sensor_id)
            rig_ids = [database.write_rig(rig) for rig in rigs]
            for i in range(3):
                images = []
                for camera, side in zip(cameras, ("left", "right")):
                    image = pycolmap.Image(
                        name=f"{side}/{i}.png", camera_id=camera.camera_id
                    )
                    image.image_id = database.write_image(image)
                    images.append(image)
                groups = [images] if are_joined else [[image] for image in images]
                for rig_id, group in zip(rig_ids, groups):
                    frame = pycolmap.Frame()
                    frame.rig_id = rig_id
                    for image in group:
                        frame.add_data_id(image.data_id)
                    database.write_frame(frame)
        return rig_ids, cameras

    def test_rigs_of_cameras_are_read(self):
        path = self.path / "rigs.db"
        self.make_rigs(path, are_joined=True)
        # Without key points there is no model, but the run gets that far.
        code, output = self.mapper(path)
        self.assertIn("1 rigs, 3 frames of several images", output)
        self.assertIn("no model could be reconstructed", output)
        code, output = self.mapper(path, "--ignore_rigs", 1)
        self.assertNotIn("frames of several images", output)
        self.assertIn("no model could be reconstructed", output)

    def test_rigs_of_one_camera_are_read(self):
        path = self.path / "rigs.db"
        self.make_rigs(path, are_joined=False)
        for i, side in ((0, "left"), (1, "right"), (2, "left")):
            (self.depth / side).mkdir(exist_ok=True)
            (self.depth / f"{i}.png.npy").rename(self.depth / side / f"{i}.png.npy")
        code, output = self.importer(path)
        self.assertEqual(code, 0, output)
        self.assertIn("imported 3 of 6 images", output)
        with pycolmap.Database.open(path) as database:
            self.assertEqual(len(database.read_all_rigs()), 2)
            self.assertEqual(len(database.read_all_frames()), 6)

    def test_other_features_are_noticed(self):
        # Others of the same number: extracted again with other options.
        path = self.newest()
        with pycolmap.Database.open(path) as database:
            keypoints = database.read_keypoints(1)
            database.clear_keypoints()
            for image in database.read_all_images():
                database.write_keypoints(image.image_id, keypoints[::-1].copy())
        code, output = self.verify(path)
        self.assertEqual(code, 1)
        self.assertIn("run depth_importer again", output)
        code, output = self.importer(path)
        self.assertEqual(code, 0)
        self.assertIn("imported 3 of 3 images", output)

    def test_deleted_images_take_their_depth_along(self):
        path = self.newest()
        self.assertEqual(self.verify(path)[0], 0)
        execute(path, "DELETE FROM matches WHERE pair_id != 2147483647 + 2")
        execute(path, "DELETE FROM two_view_geometries WHERE pair_id != 2147483649")
        if execute(path, "SELECT 1 FROM sqlite_master WHERE name = 'frame_data'"):
            execute(path, "DELETE FROM frame_data WHERE data_id = 3")
        execute(path, "DELETE FROM images WHERE image_id = 3")
        self.assertEqual(
            execute(path, "SELECT image_id FROM dgsfm_keypoint_depths"), [(1,), (2,)]
        )
        code, output = self.verify(path)
        self.assertEqual(code, 0, output)

    def test_merged_databases_ask_for_depth(self):
        # COLMAP copies its own tables alone, under new ids.
        path = self.newest()
        empty = self.path / "empty.db"
        merged = self.path / "merged.db"
        with pycolmap.Database.open(path) as first, pycolmap.Database.open(
            empty
        ) as second, pycolmap.Database.open(merged) as target:
            pycolmap.Database.merge(first, second, target)
        code, output = self.verify(merged)
        self.assertIn("has no depth priors (import them with depth_importer)", output)
        self.assertEqual(self.importer(merged)[0], 0)
        code, output = self.verify(merged)
        self.assertEqual(code, 0, output)
        self.assertNotIn("has no depth priors", output)


if __name__ == "__main__":
    unittest.main()
