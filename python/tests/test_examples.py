"""The recipes of python/examples run on a small rendered scene."""

import json
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from conftest import query

import dgsfm

EXAMPLES = pathlib.Path(__file__).parents[1] / "examples"
pycolmap = pytest.importorskip("pycolmap")


def run_example(name, *arguments):
    result = subprocess.run(
        [sys.executable, EXAMPLES / name, *map(str, arguments)],
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def splats(photos, tmp_path_factory):
    """The output of the first recipe, of which the others make use."""
    output = tmp_path_factory.mktemp("splats")
    run_example("photos_to_splats.py", photos / "images", photos / "depth", output)
    return output


def test_photos_to_splats(photos, splats):
    folder = splats / "splats"
    names = {path.name for path in (photos / "images").iterdir()}
    assert {path.name for path in (folder / "images").iterdir()} == names
    model = pycolmap.Reconstruction(folder / "sparse" / "0")
    assert {image.name for image in model.images.values()} == names
    parameters = json.loads((folder / "sparse/0/depth_params.json").read_text())
    assert set(parameters) == {pathlib.Path(name).stem for name in names}
    for name in names:
        assert (folder / "depths" / f"{pathlib.Path(name).stem}.png").is_file()
    evaluation = dgsfm.evaluate(splats / "model", photos / "gt")
    assert evaluation["auc"]["5"] > 80
    assert evaluation["truth_from_model_scale"] == pytest.approx(1, abs=0.1)


def test_plots(splats, tmp_path):
    pytest.importorskip("matplotlib")
    run_example("look_at_result.py", splats / "model", tmp_path)
    sizes = {path.name: path.stat().st_size for path in tmp_path.glob("*.png")}
    assert set(sizes) == {"model.png", "view_graph.png", "quality.png", "time.png"}
    assert min(sizes.values()) > 5000


def keypoints_and_matches(database_path):
    names = dict(query(database_path, "SELECT image_id, name FROM images"))
    keypoints = {
        names[image_id]: np.frombuffer(data, np.float32).reshape(-1, cols)[:, :2]
        for image_id, cols, data in query(
            database_path, "SELECT image_id, cols, data FROM keypoints"
        )
    }
    matches = {}
    for pair_id, data in query(database_path, "SELECT pair_id, data FROM matches"):
        image_id1, image_id2 = divmod(pair_id, 2147483647)
        matches[names[image_id1], names[image_id2]] = np.frombuffer(
            data or b"", np.uint32
        ).reshape(-1, 2)
    return keypoints, matches


def test_hloc_to_model(photos, splats, tmp_path):
    h5py = pytest.importorskip("h5py")
    keypoints, matches = keypoints_and_matches(splats / "database.db")
    with h5py.File(tmp_path / "features.h5", "w") as file:
        for name, points in keypoints.items():
            file[f"{name}/keypoints"] = points - 0.5
    with h5py.File(tmp_path / "matches.h5", "w") as file:
        for (name1, name2), indices in matches.items():
            partners = np.full(len(keypoints[name2]), -1, np.int16)
            partners[indices[:, 1]] = indices[:, 0]
            file[f"{name2}/{name1}/matches0"] = partners
    run_example(
        "hloc_to_model.py", photos / "images", tmp_path / "features.h5",
        tmp_path / "matches.h5", tmp_path / "out", "--depth", photos / "depth",
    )  # fmt: skip
    evaluation = dgsfm.evaluate(tmp_path / "out" / "model", photos / "gt")
    assert evaluation["auc"]["5"] > 80


def test_dense_matches_to_model(photos, splats, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    import dense_matches_to_model as example

    keypoints, matches = keypoints_and_matches(splats / "database.db")

    def match(path1, path2):
        indices = matches.get((path1.name, path2.name))
        if indices is None:
            indices = matches[path2.name, path1.name][:, ::-1]
        points = np.hstack(
            [keypoints[path1.name][indices[:, 0]], keypoints[path2.name][indices[:, 1]]]
        )
        return points, np.ones(len(points), np.float32)

    models = example.map_photos(
        photos / "images", tmp_path / "out", match, photos / "depth"
    )
    evaluation = dgsfm.evaluate(models[0], photos / "gt")
    assert evaluation["auc"]["5"] > 80
