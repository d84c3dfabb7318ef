"""The models by name of scripts/estimate_depth.py, with stand-ins for their
packages: modules of the same interface, as published, that check what they are
given and return known depth. What comes out is imported.

Usage: COLMAP=PATH estimate_depth_adapters.py

Exit code 77 without NumPy, Pillow and pycolmap.
"""

import contextlib
import dataclasses
import importlib.util
import io
import os
import pathlib
import sqlite3
import subprocess
import sys
import tempfile
import types
import unittest
import unittest.mock

try:
    import numpy as np
    import pycolmap
    from PIL import Image
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

COLMAP = os.environ.get("COLMAP", "build/release/bin/colmap")
SCRIPT = pathlib.Path(__file__).parents[2] / "python" / "dgsfm" / "estimate_depth.py"
WIDTH, HEIGHT = 60, 40
FOCAL_LENGTH = 48.0
INTRINSICS = np.array([[FOCAL_LENGTH, 0, 30], [0, FOCAL_LENGTH, 20], [0, 0, 1]])


def ramp(height, width):
    """z-depth that tells rows from columns and either from its mirror image."""
    v, u = np.mgrid[:height, :width]
    return (1 + (u + 0.5) / width + 2 * (v + 0.5) / height).astype(np.float32)


class Tensor:
    """Of PyTorch, as far as the script uses it."""

    def __init__(self, array, device="cpu"):
        self.array = np.asarray(array)
        self.device = device

    def __array__(self, dtype=None, copy=None):
        assert self.device == "cpu", "a tensor of another device has no array"
        return self.array.astype(dtype or self.array.dtype)

    def __truediv__(self, number):
        return Tensor(self.array / number, self.device)

    def __getitem__(self, key):
        return Tensor(self.array[key], self.device)

    def __float__(self):
        return float(self.array)

    def permute(self, *axes):
        return Tensor(self.array.transpose(axes), self.device)

    def to(self, device):
        return Tensor(self.array, device)

    def cpu(self):
        return self.to("cpu")

    def detach(self):
        return self

    def float(self):
        return Tensor(self.array.astype(np.float32), self.device)


class Model:
    """What is common to the stand-ins: made by name, moved, set to evaluate."""

    made = []

    @classmethod
    def from_pretrained(cls, weights):
        if "missing" in weights:
            raise OSError(f"{weights} is not a local folder and is not online")
        model = cls()
        model.weights = weights
        Model.made.append(model)
        return model

    def to(self, device):
        self.device = device
        return self

    def eval(self):
        self.is_evaluating = True
        return self

    def check_image(self, image, top):
        """3 x height x width of the device, colours up to `top`."""
        assert self.is_evaluating and image.device == self.device == "gpu:1"
        assert image.array.shape == (3, HEIGHT, WIDTH), image.array.shape
        assert image.array.max() == top, image.array.max()
        # Red grows to the right, green downwards.
        assert image.array[0, 0, 0] == 0 and image.array[0, 0, -1] == top
        assert image.array[1, 0, 0] == 0 and image.array[1, -1, 0] == top

    def tensor(self, array):
        return Tensor(array, self.device)


class Moge2(Model):
    def infer(self, image):
        self.check_image(image, 1)
        mask = np.ones((HEIGHT, WIDTH), bool)
        mask[0, 0] = False
        normalized = INTRINSICS / [[WIDTH], [HEIGHT], [1]]
        return {
            "depth": self.tensor(np.where(mask, ramp(HEIGHT, WIDTH), np.inf)),
            "mask": self.tensor(mask),
            "intrinsics": self.tensor(normalized.astype(np.float32)),
            "points": self.tensor(np.zeros((HEIGHT, WIDTH, 3))),
        }


class UniDepth2(Model):
    interpolation_mode = None

    def infer(self, image):
        self.check_image(image, 255)
        assert image.array.dtype == np.uint8 and self.interpolation_mode == "bilinear"
        return {
            "depth": self.tensor(ramp(HEIGHT, WIDTH)[None, None]),
            "intrinsics": self.tensor(INTRINSICS[None].astype(np.float32)),
        }


class UniK3d(UniDepth2):
    def infer(self, image):
        depth = UniDepth2.infer(self, image)["depth"].array[0, 0]
        points = np.stack([depth * 0.1, depth * 0.2, depth])
        distance = np.linalg.norm(points, axis=0)
        return {
            "points": self.tensor(points[None]),
            "distance": self.tensor(distance[None, None]),
        }


class Processor:
    """Resizes to multiples of 14, as Depth Anything's does."""

    @classmethod
    def from_pretrained(cls, weights):
        return cls()

    def __call__(self, images, return_tensors):
        assert return_tensors == "pt" and images.size == (WIDTH, HEIGHT)
        pixels = np.asarray(images.resize((56, 42)), np.float32)

        class Batch(dict):
            def to(self, device):
                return Batch(pixel_values=self["pixel_values"].to(device))

        return Batch(pixel_values=Tensor(pixels.transpose(2, 0, 1)[None]))


class DepthAnything2(Model):
    def __call__(self, pixel_values):
        assert pixel_values.device == self.device == "gpu:1"
        height, width = pixel_values.array.shape[2:]
        depth = self.tensor(ramp(height, width)[None])
        return types.SimpleNamespace(predicted_depth=depth)


class DepthAnything3(Model):
    def inference(self, image):
        (array,) = image
        assert array.shape == (HEIGHT, WIDTH, 3) and array.dtype == np.uint8
        # At half the size, the camera too; of a batch of one.
        confidence = np.full((1, 20, 30), 2, np.float32)
        confidence[0, 0, 0] = 0
        intrinsics = INTRINSICS * [[0.5], [0.5], [1]]
        return types.SimpleNamespace(
            depth=ramp(20, 30)[None],
            conf=confidence,
            intrinsics=intrinsics[None].astype(np.float32),
        )


class DepthPro(Model):
    def infer(self, image):
        assert self.is_evaluating and image.array.shape == (3, HEIGHT, WIDTH)
        return {
            "depth": self.tensor(ramp(HEIGHT, WIDTH)),
            "focallength_px": self.tensor(np.float32(FOCAL_LENGTH)),
        }


class Metric3d(Model):
    def inference(self, inputs):
        image = inputs["input"]
        assert self.is_evaluating and image.device == self.device == "gpu:1"
        batch, channels, *size = image.array.shape
        assert (batch, channels) == (1, 3) and image.array.dtype == np.float32
        assert size == ([544, 1216] if "convnext" in self.weights else [616, 1064])
        # The image fills the height; beside it are the mean colours.
        factor = size[0] / HEIGHT
        width = round(factor * WIDTH)
        assert np.ptp(image.array[0, :, :, width:]) == 0
        assert image.array[0, 0, 0, 0] < 0 < image.array[0, 0, 0, width - 1]
        # Of a camera with a focal length of 1000 pixels.
        depth = np.full(size, 7, np.float32)
        depth[:, :width] = ramp(size[0], width) * 1000 / (factor * FOCAL_LENGTH)
        return self.tensor(depth[None, None]), None, {}


def stand_ins():
    """Modules by name."""

    def module(**members):
        result = types.ModuleType("stand_in")
        vars(result).update(members)
        return result

    @dataclasses.dataclass
    class Config:
        checkpoint_uri: str = "/nowhere"

    def create_depth_pro(config, device):
        model = DepthPro.from_pretrained(config.checkpoint_uri).to(device)

        def transform(image):
            return Tensor(np.asarray(image).transpose(2, 0, 1) / 255, device)

        return model, transform

    def load_from_hub(repository, entry_point, pretrain):
        assert repository == "yvanyin/metric3d" and pretrain
        return Metric3d.from_pretrained(entry_point)

    return {
        "torch": module(
            cuda=types.SimpleNamespace(is_available=lambda: False),
            hub=types.SimpleNamespace(load=load_from_hub),
            inference_mode=contextlib.nullcontext,
            from_numpy=Tensor,
        ),
        "moge": module(),
        "moge.model": module(),
        "moge.model.v2": module(MoGeModel=Moge2),
        "transformers": module(
            AutoImageProcessor=Processor, AutoModelForDepthEstimation=DepthAnything2
        ),
        "depth_anything_3": module(),
        "depth_anything_3.api": module(DepthAnything3=DepthAnything3),
        "unidepth": module(),
        "unidepth.models": module(UniDepthV2=UniDepth2),
        "unik3d": module(),
        "unik3d.models": module(UniK3D=UniK3d),
        "depth_pro": module(create_model_and_transforms=create_depth_pro),
        "depth_pro.depth_pro": module(DEFAULT_MONODEPTH_CONFIG_DICT=Config()),
    }


def load_script():
    spec = importlib.util.spec_from_file_location("estimate_depth", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


class Adapters(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = pathlib.Path(folder.name)
        (self.path / "images").mkdir()
        image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        image[:, :, 0] = np.linspace(0, 255, WIDTH)
        image[:, :, 1] = np.linspace(0, 255, HEIGHT)[:, None]
        Image.fromarray(image).save(self.path / "images" / "a.png")
        Model.made = []

    def run_script(self, model, *arguments, modules=None):
        """What it says when it ends early, and otherwise its map."""
        command = [
            "estimate_depth.py", model, "--image_path", str(self.path / "images"),
            "--output_path", str(self.path / "depth"), "--device", "gpu:1", *arguments,
        ]  # fmt: skip
        modules = stand_ins() if modules is None else modules
        with unittest.mock.patch.dict(sys.modules, modules), unittest.mock.patch.object(
            sys, "argv", command
        ), contextlib.redirect_stderr(io.StringIO()):
            try:
                load_script().main()
            except SystemExit as end:
                return str(end)
        return dict(np.load(self.path / "depth" / "a.png.npz"))

    def import_depth(self):
        """Depth at key points 0.5 px inside of the corners, and the focal length."""
        database = self.path / "database.db"
        with pycolmap.Database.open(database) as db:
            camera = pycolmap.Camera(
                model="PINHOLE", width=WIDTH, height=HEIGHT, params=[50, 50, 30, 20]
            )
            camera.camera_id = db.write_camera(camera)
            image_id = db.write_image(
                pycolmap.Image(name="a.png", camera_id=camera.camera_id)
            )
            keypoints = [[0.5, 0.5], [59.5, 0.5], [0.5, 39.5], [30, 20]]
            db.write_keypoints(image_id, np.array(keypoints, np.float32))
        subprocess.run(
            [
                COLMAP, "depth_importer", "--database_path", database,
                "--depth_path", self.path / "depth",
            ],
            check=True, capture_output=True,
        )  # fmt: skip
        connection = sqlite3.connect(database)
        data, focal_length = connection.execute(
            "SELECT data, focal_length FROM dgsfm_keypoint_depths"
        ).fetchone()
        connection.close()
        return np.frombuffer(data, np.float32), focal_length

    def check(self, model, focal_length, *arguments, is_corner_known=True):
        result = self.run_script(model, *arguments)
        self.assertIsInstance(result, dict, result)
        self.assertEqual(result["depth"].dtype, np.float32)
        depths, found_focal_length = self.import_depth()
        self.assertAlmostEqual(found_focal_length, focal_length, places=4)
        # Within two pixels of the smallest map, and half floats.
        expected = np.array([1.03, 2.01, 2.98, 2.5])
        self.assertEqual(depths[0] > 0, is_corner_known)
        np.testing.assert_allclose(depths[1:], expected[1:], atol=0.15)

    def test_moge2(self):
        self.check("moge2", FOCAL_LENGTH, is_corner_known=False)
        self.assertEqual(Model.made[0].weights, "Ruicheng/moge-2-vitl-normal")

    def test_depth_anything_v2(self):
        self.check("depth_anything_v2", 0)

    def test_depth_anything_v3(self):
        self.check("depth_anything_v3", FOCAL_LENGTH, is_corner_known=False)

    def test_unidepth_v2(self):
        self.check("unidepth_v2", FOCAL_LENGTH)

    def test_unik3d(self):
        self.check("unik3d", 0)

    def test_depth_pro(self):
        self.check("depth_pro", FOCAL_LENGTH, "--weights", "mine/depth_pro.pt")
        self.assertEqual(Model.made[0].weights, "mine/depth_pro.pt")

    def test_metric3d(self):
        factor = str(FOCAL_LENGTH / WIDTH)
        self.check("metric3d", 0, "--focal_length_factor", factor)

    def test_metric3d_of_the_other_kind(self):
        self.check(
            "metric3d", 0, "--focal_length_factor", str(FOCAL_LENGTH / WIDTH),
            "--weights", "metric3d_convnext_large",
        )  # fmt: skip

    def test_missing_packages_are_named(self):
        for model, place in (
            ("moge2", "github.com/microsoft/MoGe"),
            ("depth_anything_v2", "pip install transformers"),
            ("depth_anything_v3", "Depth-Anything-3"),
            ("unidepth_v2", "github.com/lpiccinelli-eth/UniDepth"),
            ("unik3d", "github.com/lpiccinelli-eth/UniK3D"),
            ("depth_pro", "github.com/apple/ml-depth-pro"),
        ):
            with self.subTest(model):
                # None makes the import fail, installed or not.
                modules = dict.fromkeys(stand_ins())
                modules["torch"] = stand_ins()["torch"]
                message = self.run_script(model, modules=modules)
                self.assertIn("The model needs:", message)
                self.assertIn(place, message)

    def test_missing_weights_are_named(self):
        for model in (
            "moge2", "depth_anything_v2", "depth_anything_v3", "unidepth_v2",
            "unik3d", "depth_pro", "metric3d",
        ):  # fmt: skip
            with self.subTest(model):
                message = self.run_script(model, "--weights", "missing")
                self.assertIn("The weights missing could not be loaded", message)
                self.assertIn("is not online", message)
                self.assertIn("(from ", message)


if __name__ == "__main__":
    unittest.main()
