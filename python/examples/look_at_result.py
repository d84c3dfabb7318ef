# %% [markdown]
# # A result in plots
#
# Cells for Jupyter (jupytext, VS Code) or a plain script:
#
#     look_at_result.py OUTPUT_OF_MAPPING PICTURES
#
# Needs pycolmap and matplotlib.

# %%
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np

import dgsfm

output_path, picture_path = map(pathlib.Path, sys.argv[1:3])
picture_path.mkdir(parents=True, exist_ok=True)
report = dgsfm.read_report(output_path)
model = dgsfm.Model(output_path / "0", report["models"][0])
reconstruction = model.reconstruction
print(model)
print(*report["warnings"], sep="\n")


# %% Points and cameras from above: the two directions in which they vary most.
def plot_model():
    points = np.array([p.xyz for p in reconstruction.points3D.values()])
    centers = np.array(
        [
            image.projection_center()
            for image in reconstruction.images.values()
            if image.has_pose
        ]
    )
    near = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    points = points[near <= np.quantile(near, 0.95)]
    mean = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - mean, full_matrices=False)
    figure, plot = plt.subplots()
    plot.plot(*((points - mean) @ axes[:2].T).T, ",", label="points")
    plot.plot(*((centers - mean) @ axes[:2].T).T, "^", label="cameras")
    plot.set(aspect="equal", xlabel=model.unit, ylabel=model.unit)
    plot.legend()
    return figure


plot_model().savefig(picture_path / "model.png")


# %% The view graph: inliers of each pair, and which pairs are valid.
def plot_view_graph():
    names = sorted(image["name"] for image in report["images"])
    index = {name: i for i, name in enumerate(names)}
    inliers = np.full((len(names), len(names)), np.nan)
    for pair in report["view_graph"]:
        i, j = sorted((index[pair["image1"]], index[pair["image2"]]))
        # Valid pairs above the diagonal, all others below.
        i, j = (i, j) if pair["status"] == "valid" else (j, i)
        inliers[i, j] = pair["num_inliers"]
    figure, plot = plt.subplots()
    colours = plot.imshow(inliers)
    plot.set_title("inliers; above the diagonal valid, below others")
    figure.colorbar(colours)
    return figure


plot_view_graph().savefig(picture_path / "view_graph.png")


# %% Scales of the depth maps against the model, and reprojection errors.
def plot_quality():
    scales = [i["depth_scale"] for i in report["images"] if "depth_scale" in i]
    errors = [point.error for point in reconstruction.points3D.values()]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4))
    left.hist(scales, bins=20)
    left.set_xlabel("scale of a depth map [1]")
    right.hist(errors, bins=50)
    right.set_xlabel("reprojection error of a point [px]")
    return figure


plot_quality().savefig(picture_path / "quality.png")


# %% Where the time went.
def plot_time():
    seconds = {}
    for stage in report["stages"]:
        name = stage["stage"]
        seconds[name] = seconds.get(name, 0) + stage["seconds"]
    figure, plot = plt.subplots(layout="constrained")
    plot.barh(list(seconds)[::-1], list(seconds.values())[::-1])
    plot.set_xlabel("time [s]")
    return figure


plot_time().savefig(picture_path / "time.png")
