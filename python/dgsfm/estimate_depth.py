#!/usr/bin/env python3
"""Runs a monocular depth model over a folder of images.

usage: estimate_depth.py MODEL --image_path photos --output_path depth

Writes photos/sub/a.jpg as depth/sub/a.jpg.npz with what the model gives of depth
(z, of the size of its output), mask, confidence and intrinsics (pixels of the
map): the files that depth_importer reads. Maps that are there already are left
alone, so that a broken run goes on. Images are taken as they are stored, EXIF
orientation is ignored, as COLMAP does.

MODEL is one of those below or an ONNX file. The packages and weights of models
are yours to get: each has its own licence. A model of inverse depth (relative
Depth Anything in ONNX, say) needs depth_importer --depth_type inverse, and if
its inverse depth has an unknown shift it is of no use.
"""

import argparse
import pathlib
import sys
import time

import numpy as np
from PIL import Image

EXTENSIONS = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"}


def load_image(path):
    """Height x width x 3 bytes."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def to_array(tensor):
    return np.asarray(tensor.detach().float().cpu()).squeeze()


class TorchModel:
    """One image after the other on a device of PyTorch."""

    # How to get the package, the default of --weights, and where these are from.
    install = ""
    weights = ""
    origin = "huggingface.co; a folder or file of that name here goes first"

    def __init__(self, options):
        import torch

        self.torch = torch
        self.options = options
        device = "cuda" if torch.cuda.is_available() else "cpu"
        self.device = options.device or device
        self.load(options.weights or self.weights)

    def estimate(self, images):
        with self.torch.inference_mode():
            return [self.estimate_one(image) for image in images]

    def tensor(self, image):
        return self.torch.from_numpy(image.copy()).permute(2, 0, 1).to(self.device)


class Moge2(TorchModel):
    install = "pip install git+https://github.com/microsoft/MoGe.git"
    weights = "Ruicheng/moge-2-vitl-normal"

    def load(self, weights):
        from moge.model.v2 import MoGeModel

        self.model = MoGeModel.from_pretrained(weights).to(self.device).eval()

    def estimate_one(self, image):
        result = self.model.infer(self.tensor(image) / 255)
        height, width = image.shape[:2]
        intrinsics = to_array(result["intrinsics"]) * [[width], [height], [1]]
        return {
            "depth": to_array(result["depth"]),
            "mask": to_array(result["mask"]) > 0,
            "intrinsics": intrinsics,
        }


class DepthAnything2(TorchModel):
    install = "pip install transformers torch"
    weights = "depth-anything/Depth-Anything-V2-Metric-Outdoor-Large-hf"

    def load(self, weights):
        from transformers import AutoImageProcessor, AutoModelForDepthEstimation

        self.processor = AutoImageProcessor.from_pretrained(weights)
        self.model = AutoModelForDepthEstimation.from_pretrained(weights)
        self.model = self.model.to(self.device).eval()

    def estimate_one(self, image):
        inputs = self.processor(images=Image.fromarray(image), return_tensors="pt")
        result = self.model(**inputs.to(self.device))
        return {"depth": to_array(result.predicted_depth)}


class DepthAnything3(TorchModel):
    install = "pip install git+https://github.com/ByteDance-Seed/Depth-Anything-3.git"
    weights = "depth-anything/DA3NESTED-GIANT-LARGE"

    def load(self, weights):
        from depth_anything_3.api import DepthAnything3 as Model

        self.model = Model.from_pretrained(weights).to(self.device).eval()

    def estimate_one(self, image):
        result = self.model.inference([image])
        # Its maps, and the camera with them, are smaller than the image.
        maps = {"depth": np.asarray(result.depth)[0]}
        if getattr(result, "conf", None) is not None:
            maps["confidence"] = np.asarray(result.conf)[0]
        if getattr(result, "intrinsics", None) is not None:
            maps["intrinsics"] = np.asarray(result.intrinsics)[0]
        return maps


class UniDepth2(TorchModel):
    install = "pip install git+https://github.com/lpiccinelli-eth/UniDepth.git"
    weights = "lpiccinelli/unidepth-v2-vitl14"

    def load(self, weights):
        from unidepth.models import UniDepthV2

        self.model = UniDepthV2.from_pretrained(weights).to(self.device).eval()
        self.model.interpolation_mode = "bilinear"

    def estimate_one(self, image):
        result = self.model.infer(self.tensor(image))
        return {
            "depth": to_array(result["depth"]),
            "intrinsics": to_array(result["intrinsics"]),
        }


class UniK3d(TorchModel):
    install = "pip install git+https://github.com/lpiccinelli-eth/UniK3D.git"
    weights = "lpiccinelli/unik3d-vitl"

    def load(self, weights):
        from unik3d.models import UniK3D

        self.model = UniK3D.from_pretrained(weights).to(self.device).eval()
        self.model.interpolation_mode = "bilinear"

    def estimate_one(self, image):
        # Points 3 x height x width; its "distance" is along the ray.
        return {"depth": to_array(self.model.infer(self.tensor(image))["points"])[2]}


class DepthPro(TorchModel):
    install = "pip install git+https://github.com/apple/ml-depth-pro.git"
    weights = "./checkpoints/depth_pro.pt"
    origin = "get_pretrained_models.sh of github.com/apple/ml-depth-pro"

    def load(self, weights):
        import dataclasses

        import depth_pro
        from depth_pro.depth_pro import DEFAULT_MONODEPTH_CONFIG_DICT as config

        config = dataclasses.replace(config, checkpoint_uri=weights)
        self.model, self.transform = depth_pro.create_model_and_transforms(
            config=config, device=self.device
        )
        self.model.eval()

    def estimate_one(self, image):
        result = self.model.infer(self.transform(Image.fromarray(image)))
        focal_length = float(result["focallength_px"])
        return {
            "depth": to_array(result["depth"]),
            "intrinsics": np.array([focal_length]),
        }


class Metric3d(TorchModel):
    install = "pip install torch mmengine (the rest comes by torch.hub)"
    weights = "metric3d_vit_large"
    origin = "torch.hub, the entry points of github.com/YvanYin/Metric3D"
    # The focal length of its training [px], which its depth belongs to.
    focal_length = 1000

    def load(self, weights):
        # That of its training, too.
        self.size = (544, 1216) if "convnext" in weights else (616, 1064)
        self.model = self.torch.hub.load("yvanyin/metric3d", weights, pretrain=True)
        self.model = self.model.to(self.device).eval()

    def estimate_one(self, image):
        height, width = image.shape[:2]
        factor = min(self.size[0] / height, self.size[1] / width)
        size = round(height * factor), round(width * factor)
        resized = Image.fromarray(image).resize(size[::-1], Image.BICUBIC)
        mean, deviation = [123.675, 116.28, 103.53], [58.395, 57.12, 57.375]
        padded = np.zeros((*self.size, 3), np.float32)
        padded[: size[0], : size[1]] = (np.asarray(resized) - mean) / deviation
        depth = to_array(self.model.inference({"input": self.tensor(padded)[None]})[0])
        # A field of view, for want of one: the focal length is the longer side's.
        focal_length = factor * self.options.focal_length_factor * max(height, width)
        depth = depth[: size[0], : size[1]] * focal_length / self.focal_length
        return {"depth": depth}


class Onnx:
    """Any ONNX file: an input N x 3 x height x width of colours; the output
    called depth, or the first, is the map, outputs called mask, confidence and
    intrinsics are stored too."""

    install = "pip install onnxruntime"

    def __init__(self, options):
        import onnxruntime

        providers = onnxruntime.get_available_providers()
        if options.device == "cpu":
            providers = ["CPUExecutionProvider"]
        self.session = onnxruntime.InferenceSession(options.model, providers=providers)
        self.options = options
        self.input = self.session.get_inputs()[0]
        self.names = [output.name for output in self.session.get_outputs()]
        batch, _, height, width = self.input.shape
        self.size = options.input_size or [height, width]
        if not all(isinstance(side, int) for side in self.size):
            sys.exit("the model takes any size: choose one by --input_size H W")
        self.can_batch = not isinstance(batch, int)

    def estimate(self, images):
        if not self.can_batch and len(images) > 1:
            return [self.estimate([image])[0] for image in images]
        colours = np.stack(
            [
                np.asarray(
                    Image.fromarray(image).resize(self.size[::-1], Image.BICUBIC)
                )
                for image in images
            ]
        )
        colours = (colours / 255.0 - self.options.mean) / self.options.deviation
        colours = colours.transpose(0, 3, 1, 2).astype(np.float32)
        outputs = dict(
            zip(self.names, self.session.run(None, {self.input.name: colours}))
        )
        depth = outputs.get("depth", outputs[self.names[0]])
        results = []
        for i in range(len(images)):
            maps = {"depth": np.asarray(depth[i]).squeeze()}
            for name in ("mask", "confidence", "intrinsics"):
                if name in outputs:
                    maps[name] = np.asarray(outputs[name][i]).squeeze()
            results.append(maps)
        return results


MODELS = {
    "moge2": Moge2,
    "depth_anything_v2": DepthAnything2,
    "depth_anything_v3": DepthAnything3,
    "unidepth_v2": UniDepth2,
    "unik3d": UniK3d,
    "depth_pro": DepthPro,
    "metric3d": Metric3d,
}


def parse_arguments():
    listing = "\n".join(f"  {name}: {model.install}" for name, model in MODELS.items())
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog=f"models and how to install them:\n{listing}\n"
        f"  FILE.onnx: {Onnx.install}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("model", help="name or ONNX file")
    parser.add_argument("--image_path", type=pathlib.Path, required=True)
    parser.add_argument("--output_path", type=pathlib.Path, required=True)
    parser.add_argument("--weights", help="of a model by name: its own name or file")
    parser.add_argument("--device", help="cpu, cuda, cuda:1, ...; the best by default")
    parser.add_argument("--batch_size", type=int, default=1, help="of an ONNX file")
    parser.add_argument(
        "--input_size", type=int, nargs=2, metavar=("H", "W"), help="of an ONNX file"
    )
    parser.add_argument(
        "--mean", type=float, nargs=3, default=[0.485, 0.456, 0.406],
        help="of colours in [0, 1], for an ONNX file",
    )  # fmt: skip
    parser.add_argument(
        "--deviation", type=float, nargs=3, default=[0.229, 0.224, 0.225],
        help="of colours in [0, 1], for an ONNX file",
    )  # fmt: skip
    parser.add_argument(
        "--focal_length_factor", type=float, default=1.2,
        help="focal length over the longer side, for metric3d",
    )  # fmt: skip
    return parser.parse_args()


def create_model(options):
    is_onnx = options.model.endswith(".onnx")
    if not is_onnx and options.model not in MODELS:
        sys.exit(f"no model {options.model}: {', '.join(MODELS)}, or a file .onnx")
    if is_onnx and not pathlib.Path(options.model).is_file():
        sys.exit(f"no file {options.model}")
    model = Onnx if is_onnx else MODELS[options.model]
    try:
        return model(options)
    except ImportError as error:
        sys.exit(f"{error}\nThe model needs: {model.install}")
    except Exception as error:
        name = options.model if is_onnx else options.weights or model.weights
        sys.exit(
            f"{type(error).__name__}: {error}\n"
            f"The weights {name} could not be loaded"
            + ("" if is_onnx else f" (from {model.origin}; --weights takes others)")
        )


def find_images(options):
    """Images without a map, relative to their folder."""
    paths = [
        path.relative_to(options.image_path)
        for path in sorted(options.image_path.rglob("*"))
        if path.suffix.lower() in EXTENSIONS
    ]
    if not paths:
        sys.exit(f"no images in {options.image_path}")
    return paths, [path for path in paths if not map_path(options, path).exists()]


def map_path(options, path):
    return options.output_path / path.parent / (path.name + ".npz")


def write_map(path, maps):
    """All or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    maps["depth"] = np.asarray(maps["depth"], np.float32)
    with open(partial, "wb") as file:
        np.savez_compressed(file, **maps)
    partial.rename(path)


def load_images(options, paths, failed):
    """Those that can be read, by their paths; the others are named."""
    images = {}
    for path in paths:
        try:
            images[path] = load_image(options.image_path / path)
        except OSError as error:
            print(f"\n{path}: {error}", file=sys.stderr)
            failed.append(path)
    return images


def main():
    options = parse_arguments()
    failed = []
    all_images, images = find_images(options)
    print(f"{len(all_images)} images, {len(images)} without a map", file=sys.stderr)
    if not images:
        return
    model = create_model(options)
    begin = time.monotonic()
    for start in range(0, len(images), options.batch_size):
        batch = images[start : start + options.batch_size]
        loaded = load_images(options, batch, failed)
        results = model.estimate(list(loaded.values())) if loaded else []
        for path, maps in zip(loaded, results):
            if maps["depth"].ndim != 2:
                sys.exit(f"the model's depth has the shape {maps['depth'].shape}")
            write_map(map_path(options, path), maps)
        done = start + len(batch)
        seconds_left = (time.monotonic() - begin) / done * (len(images) - done)
        print(
            f"\r{done} of {len(images)}, {seconds_left:.0f} s left",
            end="", file=sys.stderr, flush=True,
        )  # fmt: skip
    print(file=sys.stderr)
    if failed:
        sys.exit(f"{len(failed)} images could not be read, the first: {failed[0]}")


if __name__ == "__main__":
    main()
