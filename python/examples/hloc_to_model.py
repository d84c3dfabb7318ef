"""Features and matches of hloc to a model.

usage: hloc_to_model.py PHOTOS FEATURES.h5 MATCHES.h5 OUTPUT [--depth DEPTH]

The files are those of hloc's extract_features and match_features. DEPTH is a
folder of depth maps. Needs pycolmap and h5py.
"""

import argparse
import logging
import pathlib

import h5py
import numpy as np
import pycolmap

import dgsfm


def read_matches(file, pairs):
    """Indices of key points by pairs of names, N x 2."""
    for name1, name2 in pairs:
        # hloc writes a pair once, in either order, with "/" as "-".
        for first, second in ((name1, name2), (name2, name1)):
            key = f"{first.replace('/', '-')}/{second.replace('/', '-')}"
            if key not in file:
                continue
            partners = file[key]["matches0"][()].astype(np.int64)
            (indices,) = np.nonzero(partners >= 0)
            yield first, second, np.stack([indices, partners[indices]], axis=1)
            break


def create_database(database_path, photos, features_path, matches_path):
    """A database with hloc's key points and matches."""
    pycolmap.Database.open(database_path).close()  # Creates it.
    pycolmap.import_images(database_path, photos)
    with pycolmap.Database.open(database_path) as database:
        ids = {image.name: image.image_id for image in database.read_all_images()}
        with h5py.File(features_path) as features:
            for name, image_id in ids.items():
                # The centre of hloc's first pixel is (0, 0), COLMAP's (0.5, 0.5).
                keypoints = features[name]["keypoints"][()].astype(np.float32)
                database.write_keypoints(image_id, keypoints + 0.5)
        names = sorted(ids)
        pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
        with h5py.File(matches_path) as matches:
            for name1, name2, indices in read_matches(matches, pairs):
                database.write_matches(
                    ids[name1], ids[name2], indices.astype(np.uint32)
                )


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photos", type=pathlib.Path)
    parser.add_argument("features", type=pathlib.Path)
    parser.add_argument("matches", type=pathlib.Path)
    parser.add_argument("output", type=pathlib.Path)
    parser.add_argument("--depth", type=pathlib.Path)
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    options.output.mkdir(parents=True, exist_ok=True)
    database_path = options.output / "database.db"
    if not database_path.exists():
        create_database(
            database_path, options.photos, options.features, options.matches
        )
    if options.depth:
        dgsfm.import_depth(database_path, options.depth)
    models = dgsfm.global_depth_mapping(
        database_path, options.output / "model", options.photos
    )
    for model in models:
        print(model)


if __name__ == "__main__":
    main()
