"""COLMAP through pycolmap, one stage a process.

    python -m dgsfm_benchmark.pycolmap_worker '{"stage": "global", ...}'

Processes of their own keep the memory of stages apart, and a crash from the
benchmark. The argument is a JSON object: stage, database, images (folder),
output (folder), threads, seed, names (of images), pairs (file).
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pycolmap


def extract_features(job: dict) -> None:
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = job["threads"]
    options.use_gpu = False
    pycolmap.extract_features(
        job["database"],
        job["images"],
        image_names=job["names"],
        camera_mode=pycolmap.CameraMode.PER_IMAGE,
        extraction_options=options,
    )


def match_features(job: dict) -> None:
    pycolmap.set_random_seed(job["seed"])
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = job["threads"]
    options.use_gpu = False
    if job["pairs"] is None:
        pycolmap.match_exhaustive(job["database"], matching_options=options)
    else:
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = job["pairs"]
        pycolmap.match_image_pairs(
            job["database"], matching_options=options, pairing_options=pairing
        )


def calibrate_view_graph(job: dict) -> None:
    options = pycolmap.ViewGraphCalibrationOptions()
    options.random_seed = job["seed"]
    if not pycolmap.calibrate_view_graph(job["database"], options):
        # The mapper takes the focal lengths as they are.
        print("view graph calibration failed")


def map_globally(job: dict) -> None:
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = job["threads"]
    options.random_seed = job["seed"]
    pycolmap.global_mapping(
        job["database"], job["images"], job["output"], options
    )


def refine_principal_point(job: dict) -> None:
    """Adjusts the models in the output folder once more, as the global mapper
    does, but with a free principal point.

    The tolerance is that of the mapper, too. To convergence the principal
    point of a camera that only moves ahead would run away.
    """
    options = pycolmap.GlobalPipelineOptions().mapper.bundle_adjustment
    options.refine_principal_point = True
    options.ceres.solver_options.num_threads = job["threads"]
    for folder in sorted(Path(job["output"]).iterdir()):
        if (folder / "images.bin").exists():
            model = pycolmap.Reconstruction(str(folder))
            pycolmap.bundle_adjustment(model, options)
            model.write(str(folder))


def map_incrementally(job: dict) -> None:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = job["threads"]
    options.random_seed = job["seed"]
    options.extract_colors = False
    pycolmap.incremental_mapping(
        job["database"], job["images"], job["output"], options
    )


STAGES = {
    "features": extract_features,
    "matching": match_features,
    "view_graph_calibration": calibrate_view_graph,
    "global": map_globally,
    "principal_point": refine_principal_point,
    "incremental": map_incrementally,
}


def main() -> None:
    job = json.loads(sys.argv[1])
    STAGES[job["stage"]](job)


if __name__ == "__main__":
    main()
