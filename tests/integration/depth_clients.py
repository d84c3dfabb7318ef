"""Depth files of real tools: written by them and read by us, and the reverse.

Usage: COLMAP=PATH depth_clients.py [DepthClients.test_CELL ...]

Each test is a cell of the table in docs/depth_formats.md. Exit code 77 if the
tools of a cell are not installed.
"""

import importlib
import json
import os
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import unittest
import zlib

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ.get("COLMAP", "build/release/bin/colmap")
WIDTH, HEIGHT = 60, 40
# Half floats hold these exactly: 0.5 to 6.25 in quarters.
DEPTH = 0.5 + 0.25 * (np.arange(24) % 24).reshape(4, 6).astype(np.float32)


def need(module):
    """Imports a module or skips the test."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise unittest.SkipTest(str(error))


def run(*arguments):
    result = subprocess.run(
        [COLMAP, *map(str, arguments)], capture_output=True, text=True
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def make_database(path, names=("a.jpg",)):
    """A database of pycolmap with three key points per image."""
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera(
            model="PINHOLE", width=WIDTH, height=HEIGHT, params=[50, 50, 30, 20]
        )
        camera.camera_id = database.write_camera(camera)
        for name in names:
            image = pycolmap.Image(name=name, camera_id=camera.camera_id)
            image_id = database.write_image(image)
            # Two pixel centres of the map, and a corner.
            keypoints = np.array([[5, 5], [35, 25], [60, 40]], np.float32)
            database.write_keypoints(image_id, keypoints)


def read_map(path, name="a.jpg"):
    """The stored map, by docs of the tables alone, and the focal length."""
    connection = sqlite3.connect(path)
    row = connection.execute(
        "SELECT width, height, maps.data, samples.data, focal_length FROM "
        "images JOIN dgsfm_depth_maps maps USING (image_id) "
        "JOIN dgsfm_keypoint_depths samples USING (image_id) WHERE name = ?",
        (name,),
    ).fetchone()
    connection.close()
    assert row is not None, f"no depth of {name}"
    width, height, data, samples, focal_length = row
    planes = np.frombuffer(zlib.decompress(data), np.uint8).astype(np.uint16)
    codes = planes[: width * height] | planes[width * height :] << 8
    differences = (codes >> 1) ^ np.where(codes & 1, 0xFFFF, 0)
    bits = np.cumsum(differences, dtype=np.uint64).astype(np.uint16)
    depth = bits.view(np.float16).astype(np.float32).reshape(height, width)
    return depth, np.frombuffer(samples, np.float32), focal_length


class DepthClients(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = pathlib.Path(self.folder.name)
        self.database = self.path / "database.db"
        self.depth = self.path / "depth"
        self.depth.mkdir()
        make_database(self.database)

    def tearDown(self):
        self.folder.cleanup()

    def check_import(self, *options, expected=DEPTH, depth_path=None):
        """Imports and compares map and samples; returns the focal length."""
        run(
            "depth_importer", "--database_path", self.database,
            "--depth_path", depth_path or self.depth, *options,
        )  # fmt: skip
        depth, samples, focal_length = read_map(self.database)
        np.testing.assert_array_equal(depth, expected)
        # Pixel centres (0, 0) and (3, 2), and the last pixel at the corner.
        at = expected[[0, 2, 3], [0, 3, 5]]
        np.testing.assert_array_equal(samples, at)
        return focal_length

    def export(self, *options):
        np.save(self.depth / "a.jpg.npy", DEPTH)
        self.check_import()
        out = self.path / "out"
        run(
            "depth_exporter", "--database_path", self.database,
            "--output_path", out, *options,
        )  # fmt: skip
        return out

    # Written by the tool, read by us.

    def test_npy_from_numpy(self):
        np.save(self.depth / "a.npy", DEPTH.astype(np.float16))
        self.check_import()

    def test_npz_from_numpy(self):
        # The layout of MoGe: intrinsics in units of the size, NaN outside.
        depth = DEPTH.copy()
        depth[0, 1] = np.inf
        depth[1, 1] = 99
        mask = np.ones(DEPTH.shape, bool)
        mask[1, 1] = False
        expected = DEPTH.copy()
        expected[0, 1] = expected[1, 1] = 0
        intrinsics = np.array([[0.75, 0, 0.5], [0, 1.125, 0.5], [0, 0, 1]])
        np.savez_compressed(
            self.depth / "a.npz", depth=depth, mask=mask, intrinsics=intrinsics
        )
        self.assertEqual(self.check_import(expected=expected), 45)

    def test_npz_points_from_numpy(self):
        points = np.stack([DEPTH + 7, DEPTH - 7, DEPTH], axis=-1)
        np.savez(self.depth / "a.npz", points=points)
        self.check_import()

    def test_exr_from_openexr(self):
        exr = need("OpenEXR")
        imath = need("Imath")
        for pixel_type, dtype in ((exr.FLOAT, np.float32), (exr.HALF, np.float16)):
            header = exr.Header(6, 4)
            channel = imath.Channel(imath.PixelType(pixel_type))
            # As Blender's layers: colour beside depth.
            header["channels"] = {"L.R": channel, "L.G": channel, "L.Depth.Z": channel}
            file = exr.OutputFile(str(self.depth / "a.exr"), header)
            pixels = DEPTH.astype(dtype).tobytes()
            zeros = bytes(len(pixels))
            file.writePixels({"L.R": zeros, "L.G": zeros, "L.Depth.Z": pixels})
            file.close()
            self.check_import("--overwrite", 1)

    def test_tiff_from_pillow(self):
        image = need("PIL.Image")
        for compression in ("raw", "tiff_lzw", "tiff_deflate"):
            image.fromarray(DEPTH).save(
                self.depth / "a.tif", compression=compression
            )
            self.check_import("--overwrite", 1)

    def test_tiff_16_bits_from_pillow(self):
        image = need("PIL.Image")
        steps = np.round(DEPTH * 1024).astype(np.uint16)
        image.fromarray(steps).save(self.depth / "a.tiff")
        self.check_import("--depth_scale", 1 / 1024)

    def test_pfm_from_pillow(self):
        image = need("PIL.Image")
        image.fromarray(DEPTH).save(self.depth / "a.pfm")
        self.check_import()

    def test_png_from_pillow(self):
        image = need("PIL.Image")
        steps = np.round(DEPTH * 1024).astype(np.uint16)
        steps[0, 1] = 65535
        expected = DEPTH.copy()
        expected[0, 1] = 0
        image.fromarray(steps).save(self.depth / "a.png")
        self.check_import("--depth_scale", 1 / 1024, expected=expected)

    def test_confidence_from_pillow(self):
        image = need("PIL.Image")
        np.save(self.depth / "a.npy", DEPTH)
        confidence = np.full(DEPTH.shape, 2, np.uint8)
        confidence[0, 1] = 1
        folder = self.path / "confidence"
        folder.mkdir()
        image.fromarray(confidence).save(folder / "a.png")
        expected = DEPTH.copy()
        expected[0, 1] = 0
        self.check_import(
            "--confidence_path", folder, "--min_confidence", 2, expected=expected
        )

    def test_exif_from_pillow(self):
        image = need("PIL.Image")
        images = self.path / "images"
        images.mkdir()
        photo = image.fromarray(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        exif = photo.getexif()
        ops = need("PIL.ImageOps")
        for orientation in range(1, 9):
            exif[0x0112] = orientation
            photo.save(images / "a.jpg", exif=exif)
            # As a depth model does it that gets what a viewer shows.
            stored = image.fromarray(DEPTH)
            stored.getexif()[0x0112] = orientation
            shown = ops.exif_transpose(stored)
            np.save(self.depth / "a.npy", np.asarray(shown))
            self.check_import("--displayed_image_path", images, "--overwrite", 1)
            self.check_turned_warning(images, is_expected=False)
            if orientation > 4:
                continue
            # The mapper warns of what the shape of the map does not show.
            run(
                "depth_importer", "--database_path", self.database,
                "--depth_path", self.depth, "--overwrite", 1,
            )  # fmt: skip
            self.check_turned_warning(images, is_expected=orientation > 1)

    def check_turned_warning(self, images, is_expected):
        result = subprocess.run(
            [
                COLMAP, "depth_global_mapper", "--database_path", self.database,
                "--image_path", images, "--output_path", self.path / "model",
            ],
            capture_output=True, text=True,
        )  # fmt: skip
        is_warned = "--displayed_image_path" in result.stderr
        self.assertEqual(is_warned, is_expected, result.stderr)

    def test_bin_from_pycolmap(self):
        depth_map = pycolmap.DepthMap.from_array(DEPTH, 0.1, 10)
        depth_map.write(self.depth / "a.jpg.geometric.bin")
        self.check_import()

    def test_hdf5_from_h5py(self):
        h5py = need("h5py")
        path = self.path / "MoGe2.h5"
        with h5py.File(path, "w") as file:
            group = file.create_group("a.jpg")
            depth = DEPTH.astype(np.float16)
            depth[0, 1] = np.inf
            depth[1, 1] = 9
            confidence = np.ones(DEPTH.shape, np.float16)
            confidence[1, 1] = 0
            # 5 pixels of the map, 50 of the image.
            intrinsic = np.array([[5, 0, 3], [0, 5, 2], [0, 0, 1]], np.float16)
            for name, array in (("depth", depth), ("conf", confidence)):
                group.create_dataset(
                    name, data=array, compression="gzip", compression_opts=4
                )
            group.create_dataset("intrinsic", data=intrinsic)
        expected = DEPTH.copy()
        expected[0, 1] = expected[1, 1] = 0
        focal_length = self.check_import(expected=expected, depth_path=path)
        self.assertEqual(focal_length, 50)

    # Correspondences of dense matchers.

    def check_matches(self, write, *options):
        """Three pairs in the forms of `write(group, points1, points2, conf)`;
        points come back as they are, merged only across pairs."""
        database = self.path / "matches.db"
        names = ("a.jpg", "b.jpg", "c.jpg")
        with pycolmap.Database.open(database) as db:
            camera = pycolmap.Camera(
                model="PINHOLE", width=60, height=40, params=[50, 50, 30, 20]
            )
            camera.camera_id = db.write_camera(camera)
            ids = [
                db.write_image(pycolmap.Image(name=name, camera_id=camera.camera_id))
                for name in names
            ]
        rng = np.random.default_rng(1)
        points = {}
        for i, j in ((0, 1), (2, 0), (1, 2)):
            size = np.array([60, 40])
            first = (rng.uniform(0, 1, (50, 2)) * size).astype(np.float32)
            second = (rng.uniform(0, 1, (50, 2)) * size).astype(np.float32)
            if (i, j) == (2, 0):
                # Of image a, within the radius of the pair before.
                second[7] = points[0, 1][0][3] + np.float32([0.1, 0.1])
            confidence = rng.uniform(0.5, 1, 50).astype(np.float32)
            confidence[4] = 0.1
            second[5] = [61, 3]
            points[i, j] = first, second
            write((names[i], names[j]), first, second, confidence)
        run(
            "dense_match_importer", "--database_path", database, "--match_path",
            self.path / options[0], "--min_confidence", 0.3, "--merge_radius", 0.2,
        )  # fmt: skip
        kept = np.setdiff1d(np.arange(50), [4, 5])
        with pycolmap.Database.open(database) as db:
            keypoints = [db.read_keypoints(image_id) for image_id in ids]
            for (i, j), (first, second) in points.items():
                matches = db.read_matches(ids[i], ids[j])
                self.assertEqual(matches.shape, (48, 2))
                found1 = keypoints[i][matches[:, 0], :2]
                found2 = keypoints[j][matches[:, 1], :2]
                # Bit by bit, or moved by a merge.
                for found, given in ((found1, first[kept]), (found2, second[kept])):
                    moved = (found != given).any(axis=1)
                    self.assertLess(np.abs(found - given).max(), 0.2)
                    self.assertLess(moved.sum(), 10)
            # Image a: points 3 and 7 are one key point.
            of_b = db.read_matches(ids[0], ids[1])
            of_c = db.read_matches(ids[2], ids[0])
            self.assertEqual(of_b[3, 0], of_c[kept.tolist().index(7), 1])

    def test_matches_npz_from_numpy(self):
        arrays = {}

        def write(names, points1, points2, confidence):
            group = "<>".join(names)
            arrays[f"{group}/mkpts0"] = points1
            arrays[f"{group}/mkpts1"] = points2
            arrays[f"{group}/mconf"] = confidence
            np.savez_compressed(self.path / "loftr.npz", **arrays)

        self.check_matches(write, "loftr.npz")

    def test_matches_npz_folder_from_numpy(self):
        (self.path / "roma").mkdir()

        def write(names, points1, points2, confidence):
            matches = np.concatenate([points1, points2], axis=1).astype(np.float64)
            np.savez(
                self.path / "roma" / ("_".join(names) + ".npz"),
                matches=matches, certainty=confidence,
            )  # fmt: skip

        self.check_matches(write, "roma")

    def test_matches_hdf5_from_h5py(self):
        h5py = need("h5py")

        def write(names, points1, points2, confidence):
            with h5py.File(self.path / "mast3r.h5", "a") as file:
                group = file.create_group("/".join(names))
                group["keypoints0"] = points1
                group["keypoints1"] = points2
                group["scores"] = confidence.astype(np.float16)

        self.check_matches(write, "mast3r.h5")

    # Written by us, read by the tool.

    def test_npy_to_numpy(self):
        out = self.export()
        np.testing.assert_array_equal(np.load(out / "a.jpg.npy"), DEPTH)

    def test_png_to_pillow(self):
        image = need("PIL.Image")
        out = self.export("--format", "png", "--png_scale", 1 / 1024)
        steps = np.asarray(image.open(out / "a.jpg.png"))
        np.testing.assert_array_equal(steps / 1024, DEPTH)

    def test_exr_to_openexr(self):
        exr = need("OpenEXR")
        out = self.export("--format", "exr")
        file = exr.InputFile(str(out / "a.jpg.exr"))
        depth = np.frombuffer(file.channel("Z"), np.float32).reshape(4, 6)
        np.testing.assert_array_equal(depth, DEPTH)

    def test_bin_to_pycolmap(self):
        out = self.export("--format", "bin")
        depth_map = pycolmap.DepthMap()
        depth_map.read(out / "a.jpg.geometric.bin")
        np.testing.assert_array_equal(depth_map.to_array(), DEPTH)

    def test_3dgs_to_pillow(self):
        image = need("PIL.Image")
        out = self.export("--format", "3dgs")
        # As its loader does: key without extension, 16 bits over 2^16, scale
        # and offset; images are distrusted whose scale is not in 0.2 to 5 times
        # the median.
        parameters = json.loads((out / "depth_params.json").read_text())
        self.assertEqual(list(parameters), ["a"])
        pixels = np.asarray(image.open(out / "a.png")).astype(np.float32)
        inverse = pixels / 2**16 * parameters["a"]["scale"]
        inverse += parameters["a"]["offset"]
        # One step of 65536 of the largest inverse depth, 2.
        np.testing.assert_allclose(inverse, 1 / DEPTH, atol=2 / 65536)

    def test_bin_of_images_undistorted_by_pycolmap(self):
        image = need("PIL.Image")
        images, model_path = self.path / "images", self.path / "model"
        images.mkdir()
        model_path.mkdir()
        photo = image.fromarray(np.zeros((HEIGHT, WIDTH, 3), np.uint8))
        photo.save(images / "a.jpg")
        # Points 1.5 times as far as the map, a ramp, has them.
        camera = pycolmap.Camera(
            model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT,
            params=[50, 30, 20, -0.2], camera_id=1,
        )  # fmt: skip
        centers = [[x + 0.5, y + 0.5] for x in range(WIDTH) for y in range(HEIGHT)]
        rays = camera.cam_from_img(np.array(centers))
        depth = (2 + rays[:, 0]).reshape(WIDTH, HEIGHT).T
        np.save(self.depth / "a.npy", depth.astype(np.float32))
        model = pycolmap.Reconstruction()
        model.add_camera_with_trivial_rig(camera)
        chosen = range(0, len(centers), 24)
        photo = pycolmap.Image(
            name="a.jpg", image_id=1, camera_id=1,
            keypoints=np.array([centers[i] for i in chosen]),
        )  # fmt: skip
        model.add_image_with_trivial_frame(photo, pycolmap.Rigid3d())
        for index, i in enumerate(chosen):
            track = pycolmap.Track()
            track.add_element(1, index)
            z = 1.5 * (2 + rays[i, 0])
            model.add_point3D(z * np.append(rays[i], 1), track)
        model.write(model_path)
        pycolmap.undistort_images(self.path / "dense", model_path, images)
        undistorted = pycolmap.Reconstruction(self.path / "dense" / "sparse").cameras[1]

        run(
            "depth_importer", "--database_path", self.database,
            "--depth_path", self.depth,
        )  # fmt: skip
        run(
            "depth_exporter", "--database_path", self.database,
            "--input_path", model_path, "--output_path", self.path / "out",
            "--undistorted_path", self.path / "dense" / "sparse",
            "--DepthAlignment.model", "scale", "--format", "bin",
        )  # fmt: skip
        depth_map = pycolmap.DepthMap()
        depth_map.read(self.path / "out" / "a.jpg.geometric.bin")
        depth = depth_map.to_array()
        self.assertEqual(depth.shape, (undistorted.height, undistorted.width))
        columns = np.arange(undistorted.width) + 0.5
        fx, _, cx, _ = undistorted.params
        expected = 1.5 * (2 + (columns - cx) / fx)
        # Half floats, and interpolation between pixels.
        inside = depth[4:-4, 4:-4]
        np.testing.assert_allclose(
            inside, np.broadcast_to(expected[4:-4], inside.shape), rtol=2e-3
        )


if __name__ == "__main__":
    program = unittest.main(exit=False)
    skipped = program.result.skipped
    if not program.result.wasSuccessful():
        sys.exit(1)
    sys.exit(77 if skipped and len(skipped) == program.result.testsRun else 0)
