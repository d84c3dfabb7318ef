"""Changed depth maps and focal lengths as of EXIF data."""

import tempfile
import unittest
from pathlib import Path

import support
import numpy as np
import pycolmap
from dgsfm_benchmark import datasets
from dgsfm_benchmark.database import set_prior_focal_lengths
from dgsfm_benchmark.depth_changes import CHANGES, change_depth
from dgsfm_benchmark.errors import BenchmarkError


class DepthChangesTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        random = np.random.default_rng(0)
        self.maps = {
            f"{i}.jpg": random.uniform(1, 5, (3, 4)).astype(np.float32)
            for i in range(4)
        }
        self.maps["0.jpg"][0, 0] = np.inf
        (self.path / "depth").mkdir()
        for name, depth in self.maps.items():
            np.save(self.path / "depth" / f"{name}.npy", depth)
        self.maps["0.jpg"][0, 0] = 0

    def changed(self, change):
        folder = self.path / change
        change_depth(self.path / "depth", folder, change)
        return {
            path.name.removesuffix(".npy"): np.load(path)
            for path in sorted(folder.glob("*.npy"))
        }

    def test_maps_change_as_they_are_named(self):
        permuted = self.changed("permuted")
        for name, other in (("0.jpg", "2.jpg"), ("3.jpg", "1.jpg")):
            np.testing.assert_array_equal(permuted[name], self.maps[other])
        mirrored = self.changed("a third mirrored")
        for name in ("0.jpg", "3.jpg"):
            np.testing.assert_array_equal(
                mirrored[name], self.maps[name][:, ::-1]
            )
        np.testing.assert_array_equal(mirrored["1.jpg"], self.maps["1.jpg"])
        self.assertEqual(list(self.changed("first three")), list(self.maps)[:3])
        self.assertEqual(np.ptp(self.changed("constant")["0.jpg"]), 0)
        self.assertEqual(self.changed("inverse")["0.jpg"][0, 0], 0)

    def test_relative_disparity_is_affine_in_inverse_depth(self):
        for name, values in self.changed("relative disparity").items():
            known = self.maps[name] > 0
            self.assertTrue((values[~known] == 0).all())
            self.assertEqual(values.max(), 255)
            inverse = 1 / self.maps[name][known]
            fit = np.polyfit(inverse, values[known], 1)
            # Values are whole numbers.
            self.assertLess(
                np.abs(np.polyval(fit, inverse) - values[known]).max(), 1
            )

    def test_names_what_it_cannot_do(self):
        with self.assertRaisesRegex(BenchmarkError, "'upside down'"):
            change_depth(self.path / "depth", self.path / "x", "upside down")
        (self.path / "empty").mkdir()
        with self.assertRaisesRegex(BenchmarkError, "no depth maps"):
            change_depth(self.path / "empty", self.path / "x", "permuted")
        self.assertIn("permuted", CHANGES)


class PriorFocalLengthsTest(unittest.TestCase):
    def test_database_has_the_truth_with_an_error(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "a"
            support.write_text_model(path / "gt", support.random_poses(3))
            support.write_images(path / "images", support.random_poses(3))
            options = {"exif_error": 0.03, "single_camera": True}
            (scene,) = datasets.load_scenes("plain", path, options)
            (focal_length,) = set(scene.prior_focal_lengths.values())
            self.assertNotEqual(focal_length, 50)
            self.assertAlmostEqual(focal_length / 50, 1, delta=0.03)
            (scene,) = datasets.load_scenes("plain", path, {"exif_error": 0.03})
            self.assertEqual(len(set(scene.prior_focal_lengths.values())), 3)

            database = pycolmap.Database.open(str(path / "database.db"))
            camera = pycolmap.Camera.create_from_model_name(
                0, "OPENCV", 70, 64, 48
            )
            camera_id = database.write_camera(camera)
            database.write_image(
                pycolmap.Image(name="a.jpg", camera_id=camera_id)
            )
            database.close()
            set_prior_focal_lengths(path / "database.db", {"a.jpg": 55.0})
            database = pycolmap.Database.open(str(path / "database.db"))
            camera = database.read_camera(camera_id)
            database.close()
            self.assertTrue(camera.has_prior_focal_length)
            np.testing.assert_array_equal(camera.params[:4], [55, 55, 32, 24])


if __name__ == "__main__":
    unittest.main()
