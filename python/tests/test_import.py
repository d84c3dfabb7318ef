"""Depth and matches from memory and from files."""

import numpy as np
import pytest
from conftest import flat_depths, image_names, image_size, query, run_program

import dgsfm


@pytest.mark.parametrize(
    "convert",
    [
        np.float16,
        np.float64,
        np.longdouble,
        np.uint16,
        np.int64,
        ">f4",
        lambda depth: np.asfortranarray(depth),
        lambda depth: depth[None, :, :, None],
        lambda depth: np.repeat(depth, 2, axis=1)[:, ::2],
    ],
)
def test_arrays_of_any_layout_give_the_same(database, convert):
    depths = flat_depths(database)
    for depth in depths.values():
        depth[: len(depth) // 2] = 3
    dgsfm.import_depth(database, depths)
    expected = query(database, "SELECT image_id, data FROM dgsfm_keypoint_depths")
    converted = {
        name: convert(depth) if callable(convert) else depth.astype(convert)
        for name, depth in depths.items()
    }
    dgsfm.import_depth(database, converted, overwrite=True)
    stored = query(database, "SELECT image_id, data FROM dgsfm_keypoint_depths")
    assert stored == expected


def test_arrays_give_the_same_as_files(database, tmp_path):
    depths = flat_depths(database)
    for i, (name, depth) in enumerate(depths.items()):
        depth += np.linspace(0, i, depth.shape[1])
        path = tmp_path / "depth" / f"{name}.npy"
        path.parent.mkdir(exist_ok=True)
        np.save(path, depth)
    tables = [
        "SELECT image_id, data FROM dgsfm_keypoint_depths",
        "SELECT image_id, data FROM dgsfm_depth_maps",
    ]
    dgsfm.import_depth(database, tmp_path / "depth")
    expected = [query(database, table) for table in tables]
    dgsfm.import_depth(database, depths, overwrite=True)
    assert [query(database, table) for table in tables] == expected
    paths = {name: tmp_path / "depth" / f"{name}.npy" for name in depths}
    dgsfm.import_depth(database, paths, overwrite=True)
    assert [query(database, table) for table in tables] == expected


def test_kinds_and_units_as_on_the_command_line(database):
    depths = flat_depths(database, 4.0)
    result = dgsfm.import_depth(
        database, depths, depth_type="inverse", depth_scale=2, depth_unit="relative"
    )
    assert {image["median_depth"] for image in result["imported"]} == {0.5}
    units = query(database, "SELECT DISTINCT unit FROM dgsfm_keypoint_depths")
    assert units == [(1,)]


def test_output_of_a_depth_model(database):
    height, width = image_size(database)
    depths = {}
    for name, depth in flat_depths(database).items():
        mask = np.ones(depth.shape, bool)
        mask[:, 0] = False
        intrinsics = np.array([[1.2, 0, 0.5], [0, 1.6, 0.5], [0, 0, 1]])
        depths[name] = {"depth": depth, "mask": mask, "intrinsics": intrinsics}
    result = dgsfm.import_depth(database, depths)
    image = result["imported"][0]
    assert image["coverage"] == pytest.approx(1 - 1 / image["width"])
    focal_length = (1.2 * width + 1.6 * height) / 2
    assert image["focal_length_px"] == pytest.approx(focal_length)


def test_confidence_leaves_pixels_out(database):
    depths = {
        name: {"depth": depth, "confidence": np.linspace(0, 1, depth.size).reshape(depth.shape)}
        for name, depth in flat_depths(database).items()
    }  # fmt: skip
    result = dgsfm.import_depth(database, depths, min_confidence=0.5)
    assert result["imported"][0]["coverage"] == pytest.approx(0.5, abs=0.01)


def test_unchanged_arrays_are_not_imported_again(database):
    depths = flat_depths(database)
    dgsfm.import_depth(database, depths)
    assert dgsfm.import_depth(database, depths)["num_unchanged"] == len(depths)
    next(iter(depths.values()))[0, 0] = 1
    assert dgsfm.import_depth(database, depths)["num_unchanged"] == len(depths) - 1


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda depth: depth.T, "turned by 90 degrees"),
        (lambda depth: depth[:, :5], "more than max_aspect_factor"),
        (lambda depth: depth.ravel(), ""),
        (lambda depth: np.stack([depth, depth]), ""),
        (lambda depth: depth[:0], "no values"),
        (lambda depth: np.full_like(depth, np.nan), "no pixel"),
        (lambda depth: {"depth": depth, "mask": np.ones((2, 3))}, "mask is 3 x 2"),
        (lambda depth: {"maps": depth}, "no array named depth"),
    ],
)
def test_wrong_shape_names_the_image(database, change, reason):
    depths = flat_depths(database)
    name = image_names(database)[3]
    depths[name] = change(depths[name])
    with pytest.raises(RuntimeError, match=f"depth map of {name}: .*{reason}"):
        dgsfm.import_depth(database, depths)
    # The others are stored, as by the command.
    with pytest.raises(RuntimeError, match="^1 depth maps could not be imported"):
        dgsfm.import_depth(database, depths)


@pytest.mark.parametrize("value", ["text", None, 1j])
def test_what_is_no_number_names_the_image(database, value):
    depths = flat_depths(database)
    name = image_names(database)[3]
    depths[name] = {"depth": np.array([[value]])}
    with pytest.raises(TypeError, match=name):
        dgsfm.import_depth(database, depths)


def test_names_of_no_image(database):
    depths = flat_depths(database)
    depths["other.jpg"] = next(iter(depths.values()))
    result = dgsfm.import_depth(database, depths)
    assert result["depths_without_image"] == ["other.jpg"]
    with pytest.raises(RuntimeError, match="none of the 1 depth maps"):
        dgsfm.import_depth(database, {"other.jpg": depths["other.jpg"]})


def dense_matches(database):
    """The matches of the database as a dense matcher would give them."""
    points = {}
    for image_id, cols, data in query(database, "SELECT image_id, cols, data FROM keypoints"):
        points[image_id] = np.frombuffer(data, np.float32).reshape(-1, cols)[:, :2]
    names = dict(query(database, "SELECT image_id, name FROM images"))
    matches = {}
    for pair_id, data in query(database, "SELECT pair_id, data FROM matches"):
        image_id1, image_id2 = divmod(pair_id, 2147483647)
        indices = np.frombuffer(data, np.uint32).reshape(-1, 2)
        matches[names[image_id1], names[image_id2]] = np.hstack(
            [points[image_id1][indices[:, 0]], points[image_id2][indices[:, 1]]]
        )
    return matches


def test_dense_matches(database):
    matches = dense_matches(database)
    with pytest.raises(RuntimeError, match="use --overwrite 1"):
        dgsfm.import_dense_matches(database, matches)
    result = dgsfm.import_dense_matches(database, matches, overwrite=True)
    assert result["num_pairs"] == len(matches)
    assert result["num_matches"] > 0.9 * sum(map(len, matches.values()))
    split = {
        names: {
            "keypoints0": points[:, :2],
            "keypoints1": points[:, 2:],
            "confidence": np.ones(len(points)),
        }
        for names, points in matches.items()
    }
    again = dgsfm.import_dense_matches(database, split, overwrite=True)
    assert again == result


def test_dense_matches_of_wrong_shape_name_the_pair(database):
    matches = dense_matches(database)
    names = next(iter(matches))
    matches[names] = matches[names][:, :3]
    with pytest.raises(RuntimeError, match="<>".join(names)):
        dgsfm.import_dense_matches(database, matches, overwrite=True)
    # Nothing was stored.
    assert len(query(database, "SELECT pair_id FROM matches")) == len(matches)


def test_errors_are_those_of_the_command_line(database, tmp_path):
    arguments = ["--database_path", database, "--depth_path", tmp_path / "none"]
    code, _, error = run_program("depth_importer", *arguments)
    assert code == 1
    with pytest.raises(RuntimeError) as raised:
        dgsfm.import_depth(database, tmp_path / "none")
    assert f"ERROR: {raised.value}\n" in error
