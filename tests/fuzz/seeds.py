#!/usr/bin/env python3
"""Writes what fuzzers start from: small files of each format by its usual tools.

usage: seeds.py FOLDER      files FOLDER/NPY/..., FOLDER/EXR/... and so on
"""

import io
import pathlib
import sys
import zlib

import h5py
import Imath
import numpy as np
import OpenEXR
from PIL import Image

DEPTH = np.linspace(1, 9, 24, dtype=np.float32).reshape(4, 6)
NUM_UPDATES_OF_DATABASE = 14


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def blob():
    """As docs of the table dgsfm_depth_maps say, behind two sizes."""
    bits = DEPTH.astype(np.float16).view(np.uint16).ravel()
    steps = np.diff(bits, prepend=np.uint16(0)).astype(np.uint16)
    codes = (steps << 1) ^ np.where(steps & 0x8000, 0xFFFF, 0).astype(np.uint16)
    low, high = (codes & 255).astype(np.uint8), (codes >> 8).astype(np.uint8)
    return b"\6\0\4\0" + zlib.compress(low.tobytes() + high.tobytes())


def plain_files():
    yield "NPY/c", npy(DEPTH)
    yield "NPY/fortran", npy(np.asfortranarray(DEPTH.astype(">f2")))
    yield "BIN/a", b"6&4&1&" + DEPTH.tobytes()
    yield "BLOB/a", blob()
    for i in range(NUM_UPDATES_OF_DATABASE):
        number = (2).to_bytes(8, "little")
        yield f"DATABASE/{i}", bytes([i]) + number + DEPTH.tobytes()[: 8 * (i + 1)]
    points, scores = DEPTH.reshape(12, 2), DEPTH.ravel()
    arrays = [points, points, scores[:12], DEPTH.reshape(6, 4), scores[:6]]
    yield "MATCHES/a", b"".join(map(npy, arrays))
    yield "MATCHES/half", b"".join(npy(a.astype(np.float16)) for a in arrays)
    yield "SCORES/txt", b"\0a.jpg d.jpg 0.5\n# no\nx/b c.jpg<>a.jpg<>1\ny/d.jpg<>a.jpg 0\n"
    yield "SCORES/csv", b'\1name1,name2,score\n"a.jpg","x/b c.jpg",0.5\nz/d.jpg,a.jpg,1\n'
    yield "SCORES/json", b'\2{"a.jpg<>y/d.jpg": 1, "b c.jpg<>a.jpg": 0.25}'
    yield "SCORES/list", (
        b'\2[["a.jpg", "b c.jpg", 1], {"image1": "a.jpg", "image2": "z/d.jpg",'
        b' "score": 0.5}]'
    )


def write_exr(folder):
    names = [name for name in dir(Imath.Compression) if name.endswith("_COMPRESSION")]
    for i, name in enumerate(names):
        header = OpenEXR.Header(6, 4)
        kind, pixels = [(OpenEXR.FLOAT, DEPTH), (OpenEXR.HALF, DEPTH.astype("f2"))][i % 2]
        header["channels"] = {"Z": Imath.Channel(Imath.PixelType(kind))}
        header["compression"] = Imath.Compression(getattr(Imath.Compression, name))
        file = OpenEXR.OutputFile(str(folder / f"{name}.exr"), header)
        file.writePixels({"Z": pixels.tobytes()})
        file.close()


def main():
    folder = pathlib.Path(sys.argv[1])
    for name in ("NPZ", "PFM", "PNG", "EXR", "TIFF", "HDF5"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name, content in plain_files():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    np.savez(folder / "NPZ/stored.npz", depth=DEPTH, mask=DEPTH > 3)
    np.savez_compressed(folder / "NPZ/deflated.npz", depth=DEPTH)
    steps = Image.fromarray((DEPTH * 1000).astype(np.uint16))
    steps.save(folder / "PNG/16.png")
    Image.fromarray((DEPTH * 9).astype(np.uint8)).save(folder / "PNG/8.png")
    steps.save(folder / "TIFF/16.tif")
    for compression in ("raw", "tiff_lzw", "tiff_deflate", "packbits"):
        file = folder / "TIFF" / f"{compression}.tif"
        Image.fromarray(DEPTH).save(file, compression=compression)
    Image.fromarray(DEPTH).save(folder / "PFM/a.pfm")
    write_exr(folder / "EXR")
    with h5py.File(folder / "HDF5/a.h5", "w") as file:
        group = file.create_group("a.jpg")
        group.create_dataset("depth", data=DEPTH.astype("f2"), compression="gzip")
        group["conf"] = DEPTH


if __name__ == "__main__":
    main()
