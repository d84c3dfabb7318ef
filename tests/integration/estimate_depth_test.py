"""scripts/estimate_depth.py with a tiny ONNX model. Exit code 77 without ONNX
Runtime and Pillow."""

import pathlib
import subprocess
import sys
import tempfile

try:
    import numpy as np
    import onnxruntime  # noqa: F401
    from PIL import Image
except ImportError as error:
    print(f"skipped: {error}")
    sys.exit(77)

SCRIPT = pathlib.Path(__file__).parents[2] / "scripts" / "estimate_depth.py"


def varint(value):
    digits = []
    while value > 0x7F:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*digits, value])


def number(field, value):
    return varint(field << 3) + varint(value)


def nested(field, *parts):
    content = b"".join(p.encode() if isinstance(p, str) else p for p in parts)
    return varint(field << 3 | 2) + varint(len(content)) + content


def value_info(name, *dimensions):
    """A tensor of floats; dimensions are numbers or names."""
    shape = [
        nested(1, number(1, d) if isinstance(d, int) else nested(2, d))
        for d in dimensions
    ]
    tensor = nested(1, number(1, 1), nested(2, *shape))
    return nested(1, name), nested(2, tensor)


def tiny_model():
    """The protocol buffer of a model whose depth is the mean of the colours."""
    axes = nested(5, nested(1, "axes"), number(8, 1), number(20, 7))
    keep = nested(5, nested(1, "keepdims"), number(3, 1), number(20, 2))
    node = nested(
        1, nested(1, "image"), nested(2, "depth"), nested(4, "ReduceMean"), axes, keep
    )
    graph = nested(
        7,
        node,
        nested(2, "mean"),
        nested(11, *value_info("image", "n", 3, 8, 12)),
        nested(12, *value_info("depth", "n", 1, 8, 12)),
    )
    return number(1, 8) + nested(8, nested(1, ""), number(2, 13)) + graph


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-B", SCRIPT, *map(str, arguments)],
        capture_output=True,
        text=True,
    )


def main():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "tiny.onnx").write_bytes(tiny_model())
        rng = np.random.default_rng(0)
        names = ["a.png", "b.png", "sub/c.png"]
        (folder / "images" / "sub").mkdir(parents=True)
        images = {}
        for image_name in names:
            # The model's size, so that nothing is resampled.
            images[image_name] = rng.integers(0, 256, (8, 12, 3), dtype=np.uint8)
            Image.fromarray(images[image_name]).save(folder / "images" / image_name)
        arguments = [
            folder / "tiny.onnx", "--image_path", folder / "images",
            "--output_path", folder / "depth", "--batch_size", 2, "--device", "cpu",
            "--mean", 0, 0, 0, "--deviation", 0.5, 0.5, 0.5,
        ]  # fmt: skip
        result = run(*arguments)
        assert result.returncode == 0, result.stderr
        assert "3 of 3" in result.stderr
        for image_name in names:
            depth = np.load(folder / "depth" / (image_name + ".npz"))["depth"]
            expected = images[image_name].mean(axis=2) / 127.5
            np.testing.assert_allclose(depth, expected, rtol=1e-5, atol=1e-6)
        # What is there is left alone.
        (folder / "depth" / "b.png.npz").unlink()
        result = run(*arguments)
        assert "3 images, 1 without a map" in result.stderr, result.stderr
        assert (folder / "depth" / "b.png.npz").exists()

        # One that cannot be read does not stop the others.
        (folder / "depth" / "b.png.npz").unlink()
        (folder / "images" / "a2.png").write_bytes(b"no image")
        result = run(*arguments)
        assert result.returncode == 1
        assert "could not be read, the first: a2.png" in result.stderr, result.stderr
        assert (folder / "depth" / "b.png.npz").exists()
        (folder / "images" / "a2.png").unlink()

        (folder / "depth" / "b.png.npz").unlink()
        result = run("moge3", *arguments[1:5])
        assert "no model moge3: moge2," in result.stderr, result.stderr
        result = run("moge2", *arguments[1:5])
        assert "github.com/microsoft/MoGe" in result.stderr, result.stderr
    print("depth of 3 images by ONNX Runtime")


if __name__ == "__main__":
    main()
