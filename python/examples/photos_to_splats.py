"""Photos and depth maps to a folder for 3D Gaussian splatting.

usage: photos_to_splats.py PHOTOS DEPTH OUTPUT

DEPTH has the maps of a depth model, as dgsfm-estimate-depth writes those of
MoGe-2:

    dgsfm-estimate-depth moge2 --image_path PHOTOS --output_path DEPTH

OUTPUT/splats gets undistorted images, sparse/0 with the model and
depth_params.json, and depths. Features are COLMAP's: needs pycolmap.
"""

import argparse
import logging
import pathlib
import shutil

import pycolmap

import dgsfm


def extract_and_match(database_path, photos):
    """SIFT features and matches of all pairs, by COLMAP's defaults."""
    pycolmap.extract_features(database_path, photos)
    pycolmap.match_exhaustive(database_path)


def write_splats(database_path, photos, model, folder):
    """The folder that 3D Gaussian splatting trains on."""
    pycolmap.undistort_images(folder, model.path, photos)
    # Splatting looks for the model one folder deeper than COLMAP writes it.
    sparse = folder / "sparse"
    (sparse / "0").mkdir()
    for file in sparse.glob("*.bin"):
        file.rename(sparse / "0" / file.name)
    dgsfm.export_depth(
        database_path,
        folder / "depths",
        model.path,
        format="3dgs",
        undistorted_path=sparse / "0",
    )
    shutil.move(folder / "depths" / "depth_params.json", sparse / "0")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photos", type=pathlib.Path)
    parser.add_argument("depth", type=pathlib.Path)
    parser.add_argument("output", type=pathlib.Path)
    options = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    options.output.mkdir(parents=True, exist_ok=True)
    database_path = options.output / "database.db"
    if not database_path.exists():
        extract_and_match(database_path, options.photos)
    dgsfm.import_depth(database_path, options.depth)
    models = dgsfm.global_depth_mapping(
        database_path, options.output / "model", options.photos
    )
    for warning in models.report["warnings"]:
        print("Warning:", warning)
    write_splats(database_path, options.photos, models[0], options.output / "splats")
    print(f"{models[0]}, for splatting in {options.output / 'splats'}")


if __name__ == "__main__":
    main()
