"""Loaders on miniature data sets in the published layouts."""

import tempfile
import unittest
from pathlib import Path

import support
import h5py
import numpy as np
from dgsfm_benchmark import datasets
from dgsfm_benchmark.errors import BenchmarkError
from dgsfm_benchmark.scans import read_scans

# Text files of these layouts have at least ten digits.
DIGITS = 1e-9


class LoadersTest(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.path = Path(self._folder.name)
        self.poses = support.random_poses(4)

    def assert_truth(self, scene, expected):
        self.assertEqual(set(scene.truth), set(expected))
        for name, pose in expected.items():
            for value in ("rotation", "translation"):
                np.testing.assert_allclose(
                    getattr(scene.truth[name], value),
                    getattr(pose, value),
                    atol=DIGITS,
                )

    def test_plain(self):
        for name in ("b", "a"):
            support.write_text_model(self.path / name / "gt", self.poses)
            support.write_images(self.path / name / "images", self.poses)
        (self.path / "a" / "depth").mkdir()
        (self.path / "a" / "database.db").touch()
        (self.path / "a" / "pairs.txt").touch()
        scenes = datasets.load_scenes("plain", self.path, {})
        self.assertEqual([scene.name for scene in scenes], ["a", "b"])
        self.assert_truth(scenes[0], self.poses)
        self.assertEqual(list(scenes[0].depth_folders), ["depth"])
        self.assertIsNotNone(scenes[0].database)
        self.assertIsNotNone(scenes[0].pairs)
        self.assertIsNone(scenes[1].database)
        (scene,) = datasets.load_scenes("plain", self.path / "b", {})
        self.assertEqual(scene.name, "b")

    def test_plain_folder_as_several_scenes(self):
        folder = self.path / "a"
        other = support.random_poses(4, seed=1)
        support.write_text_model(folder / "gt", self.poses)
        support.write_text_model(folder / "gt_other", other)
        # Key points are given: images are not needed.
        for name in ("database.db", "database_aliked.db"):
            (folder / name).touch()
        ends = {"folder": "a", "images": "0:1,2:4", "truth": "gt_other"}
        whole, part = datasets.load_scenes(
            "plain",
            self.path,
            {
                "database": "database_aliked.db",
                "scenes": ["a", "a, two ends"],
                "scene": {"a, two ends": ends},
            },
        )
        self.assert_truth(whole, self.poses)
        self.assertEqual(whole.database, folder / "database_aliked.db")
        self.assertEqual(part.name, "a, two ends")
        del other["0001.jpg"]
        self.assert_truth(part, other)
        for option in ("database", "truth"):
            with self.assertRaisesRegex(BenchmarkError, "/missing"):
                datasets.load_scenes("plain", self.path, {option: "missing"})

    def test_strecha(self):
        folder = self.path / "fountain-P11"
        support.write_images(folder / "images", self.poses)
        cameras = folder / "gt_dense_cameras"
        cameras.mkdir()
        for name, pose in self.poses.items():
            # K, distortion, world_from_cam rotation, centre, image size.
            rows = [
                "2759.48 0 1520.69", "0 2764.16 1006.81", "0 0 1", "0 0 0",
                *(" ".join(map(repr, map(float, row)))
                  for row in pose.rotation.T),
                " ".join(map(repr, map(float, pose.center()))),
                "3072 2048",
            ]  # fmt: skip
            (cameras / f"{name}.camera").write_text("\n".join(rows) + "\n")
        (scene,) = datasets.load_scenes("strecha", self.path, {})
        self.assert_truth(scene, self.poses)
        (cameras / "0000.jpg.camera").write_text("1 2 3\n")
        with self.assertRaisesRegex(BenchmarkError, "0000.jpg.camera"):
            datasets.load_scenes("strecha", self.path, {})

    def test_eth3d(self):
        poses = {
            f"dslr_images_undistorted/DSC_{i:04d}.JPG": pose
            for i, pose in enumerate(self.poses.values())
        }
        for name in ("office", "relief"):
            folder = self.path / name
            support.write_text_model(
                folder / "dslr_calibration_undistorted", poses
            )
            support.write_images(folder / "images", poses)
        evaluation = self.path / "office" / "dslr_scan_eval"
        evaluation.mkdir()
        (evaluation / "scan_alignment.mlp").write_text(
            "<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n <MeshGroup>\n"
            '  <MLMesh label="scan1" filename="scan1.ply">\n'
            "   <MLMatrix44>\n0 -1 0 5 \n1 0 0 0 \n0 0 1 0 \n0 0 0 1 \n"
            "</MLMatrix44>\n  </MLMesh>\n </MeshGroup>\n</MeshLabProject>\n"
        )
        header = (
            "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
            "property float x\nproperty float y\nproperty float z\n"
            "property uchar red\nend_header\n"
        )
        vertices = np.array(
            [(1, 2, 3, 9), (4, 5, 6, 9)], "<f4,<f4,<f4,u1"
        )
        (evaluation / "scan1.ply").write_bytes(
            header.encode() + vertices.tobytes()
        )
        # relief is not among the 22 scenes of the papers.
        (scene,) = datasets.load_scenes("eth3d", self.path, {})
        self.assertEqual(scene.name, "office")
        self.assert_truth(scene, poses)
        points = read_scans(scene.scans)
        points = points[np.argsort(points[:, 2])]
        np.testing.assert_allclose(points, [[3, 1, 3], [0, 4, 6]], atol=1e-6)
        scenes = datasets.load_scenes(
            "eth3d", self.path, {"scenes": ["relief"]}
        )
        self.assertEqual([s.name for s in scenes], ["relief"])

    def test_imc2021(self):
        image_set = self.path / "british_museum" / "set_100"
        support.write_images(image_set / "images", self.poses)
        (image_set / "calibration").mkdir()
        (image_set / "sub_set").mkdir()
        for name, pose in self.poses.items():
            path = (
                image_set
                / "calibration"
                / f"calibration_{Path(name).stem}.h5"
            )
            with h5py.File(path, "w") as file:
                file["K"] = np.eye(3)
                file["R"] = pose.rotation
                file["T"] = pose.translation
        names = list(self.poses)
        for bag, images in (("5bag_000", names[:3]), ("10bag_000", names)):
            (image_set / "sub_set" / f"{bag}.txt").write_text(
                "".join(f"images/{name}\n" for name in images)
            )
        (image_set / "sub_set" / "._5bag_000.txt").write_bytes(b"\x00\x05")
        (image_set / "depth_moge").mkdir()
        scenes = datasets.load_scenes("imc2021", self.path, {})
        self.assertEqual(
            [scene.name for scene in scenes],
            ["british_museum/10bag_000", "british_museum/5bag_000"],
        )
        self.assert_truth(scenes[0], self.poses)
        self.assertEqual(len(scenes[1].truth), 3)
        self.assertFalse(scenes[0].is_metric)
        self.assertEqual(list(scenes[0].depth_folders), ["depth_moge"])
        scenes = datasets.load_scenes("imc2021", self.path, {"bags": "^5bag"})
        self.assertEqual(len(scenes), 1)
        (image_set / "calibration" / "calibration_0000.h5").unlink()
        with self.assertRaisesRegex(BenchmarkError, "calibration_0000.h5"):
            datasets.load_scenes("imc2021", self.path, {})

    def test_lamar(self):
        session = self.path / "LIN" / "sessions" / "map"
        names = [f"nav/cam{i}/00{i}.jpg" for i in range(4)]
        support.write_images(session / "raw_data", names)
        (session / "sensors.txt").write_text(
            "# sensor_id, name, sensor_type, [sensor_params]+\n"
            "nav/cam0, cam 0, camera, PINHOLE, 64, 48, 50, 50, 32, 24\n"
            "nav/cam1, cam 1, camera, PINHOLE, 64, 48, 50, 50, 32, 24\n"
            "nav/wifi, wifi, wifi\n"
            "nav/rig, rig, rig\n"
        )
        poses = list(self.poses.values())
        rig_from_cam = poses[3]

        def cells(pose):
            values = [*support.quaternion(pose.rotation), *pose.translation]
            return ", ".join(f"{value:.17g}" for value in values)

        (session / "rigs.txt").write_text(
            "# rig_id, sensor_id, qw, qx, qy, qz, tx, ty, tz\n"
            f"nav/rig, nav/cam1, {cells(rig_from_cam)}\n"
        )
        # Poses to the world, unlike those of kapture; with a covariance.
        (session / "trajectories.txt").write_text(
            "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz, *covar\n"
            f"10, nav/cam0, {cells(poses[0])}, 1, 0\n"
            f"20, nav/cam0, {cells(poses[1])}\n"
            f"10, nav/rig, {cells(poses[2])}\n"
        )
        (session / "images.txt").write_text(
            "# timestamp, sensor_id, image_path\n"
            f"10, nav/cam0, {names[0]}\n20, nav/cam0, {names[1]}\n"
            f"10, nav/cam1, {names[2]}\n30, nav/cam1, {names[3]}\n"
        )
        (scene,) = datasets.load_scenes("lamar", self.path, {})
        self.assertEqual(scene.name, "LIN")
        expected = {
            names[0]: poses[0].inverse(),
            names[1]: poses[1].inverse(),
            # The last image has no pose.
            names[2]: (poses[2] @ rig_from_cam).inverse(),
        }
        self.assert_truth(scene, expected)
        (scene,) = datasets.load_scenes(
            "lamar", self.path, {"sensors": "cam0$"}
        )
        self.assertEqual(set(scene.truth), set(names[:2]))

    def test_unusable_data_is_named(self):
        with self.assertRaisesRegex(BenchmarkError, "layout 'x'"):
            datasets.load_scenes("x", self.path, {})
        with self.assertRaisesRegex(BenchmarkError, "nowhere"):
            datasets.load_scenes("plain", self.path / "nowhere", {})
        with self.assertRaisesRegex(BenchmarkError, "no scene"):
            datasets.load_scenes("eth3d", self.path, {})
        support.write_text_model(self.path / "a" / "gt", self.poses)
        with self.assertRaisesRegex(BenchmarkError, "0000.jpg"):
            datasets.load_scenes("plain", self.path, {})


if __name__ == "__main__":
    unittest.main()
