"""Matches of a dense matcher to a model, here those of RoMa.

usage: dense_matches_to_model.py PHOTOS OUTPUT [--depth DEPTH]

DEPTH is a folder of depth maps. Needs pycolmap and, unless map_photos is called
with a matcher of your own, romatch with its weights.
"""

import argparse
import itertools
import logging
import pathlib

import numpy as np
import pycolmap

import dgsfm


def roma_matcher(num_matches=5000):
    """A function of two paths: N x 4 pixels and N confidences."""
    import torch
    from PIL import Image
    from romatch import roma_outdoor

    device = "cuda" if torch.cuda.is_available() else "cpu"
    model = roma_outdoor(device=device)

    def match(path1, path2):
        with Image.open(path1) as image1, Image.open(path2) as image2:
            (width1, height1), (width2, height2) = image1.size, image2.size
        warp, certainty = model.match(str(path1), str(path2), device=device)
        sampled, confidence = model.sample(warp, certainty, num=num_matches)
        points = model.to_pixel_coordinates(sampled, height1, width1, height2, width2)
        return np.hstack([part.cpu().numpy() for part in points]), confidence

    return match


def match_all(photos, names, match):
    """Arrays for import_dense_matches, all pairs of images."""
    matches = {}
    for name1, name2 in itertools.combinations(names, 2):
        points, confidence = match(photos / name1, photos / name2)
        matches[name1, name2] = {"matches": points, "confidence": confidence}
    return matches


def map_photos(photos, output, match, depth=None):
    """A database with the matches, and models of it in output/model."""
    output.mkdir(parents=True, exist_ok=True)
    database_path = output / "database.db"
    if not database_path.exists():
        pycolmap.Database.open(database_path).close()  # Creates it.
        pycolmap.import_images(database_path, photos)
    with pycolmap.Database.open(database_path) as database:
        names = sorted(image.name for image in database.read_all_images())
    dgsfm.import_dense_matches(
        database_path,
        match_all(photos, names, match),
        min_confidence=0.05,
        overwrite=True,
    )
    # Depth is sampled at key points, so it comes after them.
    if depth is not None:
        dgsfm.import_depth(database_path, depth)
    return dgsfm.global_depth_mapping(database_path, output / "model", photos)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photos", type=pathlib.Path)
    parser.add_argument("output", type=pathlib.Path)
    parser.add_argument("--depth", type=pathlib.Path)
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    for model in map_photos(
        options.photos, options.output, roma_matcher(), options.depth
    ):
        print(model)


if __name__ == "__main__":
    main()
