"""Options are those of the command line."""

import re

import pytest
from conftest import run_program

import dgsfm

CLASSES = {
    "depth_importer": dgsfm.DepthImporterOptions,
    "dense_match_importer": dgsfm.DenseMatchImporterOptions,
    "depth_geometric_verifier": dgsfm.DepthGeometricVerifierOptions,
    "depth_global_mapper": dgsfm.DepthGlobalMapperOptions,
    "depth_exporter": dgsfm.DepthExporterOptions,
}
# Arguments of the functions.
ARGUMENTS = {
    "database_path", "depth_path", "match_path", "input_path", "output_path",
    "image_path", "help", "project_path",
}  # fmt: skip


@pytest.mark.parametrize("command", CLASSES)
def test_names_and_defaults_are_those_of_the_command(command):
    _, text, _ = run_program(command, "--help")
    found = dict(re.findall(r"--([\w.]+) arg(?: \(=([^)]*)\))?", text))
    options = CLASSES[command]().todict()
    # A shard's output_path is an option.
    arguments = ARGUMENTS - set(options)
    expected = {k: v for k, v in found.items() if k not in arguments}
    assert set(options) == set(expected)
    for name, value in options.items():
        assert type(value)(value) == value
        if isinstance(value, str):
            assert value == expected[name]
        else:
            assert float(value) == float(expected[name])


def test_groups_and_names():
    options = dgsfm.DepthGlobalMapperOptions()
    options.two_view_depth.max_epipolar_error = 3
    options.skip_bundle_adjustment = True
    changed = options.changed()
    assert changed == {
        "TwoViewDepth.max_epipolar_error": 3,
        "DepthGlobalMapper.skip_bundle_adjustment": True,
    }
    other = dgsfm.DepthGlobalMapperOptions()
    other.mergedict(changed)
    assert other == options
    other = dgsfm.DepthGlobalMapperOptions(
        two_view_depth={"max_epipolar_error": 3}, skip_bundle_adjustment=True
    )
    assert other == options
    assert "TwoViewDepth.max_epipolar_error=3\n" in options.summary()


def test_unknown_options_are_refused(database):
    with pytest.raises(AttributeError, match="tresh"):
        dgsfm.DepthImporterOptions().tresh = 1
    with pytest.raises(AttributeError, match="tresh"):
        dgsfm.verify_pairs(database, tresh=1)
    with pytest.raises(AttributeError, match="TwoViewDepthOptions has no option 'tresh'"):
        dgsfm.verify_pairs(database, {"TwoViewDepth.tresh": 1})
    with pytest.raises(TypeError, match="DepthGeometricVerifierOptions"):
        dgsfm.verify_pairs(database, dgsfm.DepthImporterOptions())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"num_threads": "many"}, "option num_threads must be a whole number"),
        ({"num_threads": 2.5}, "option num_threads must be a whole number"),
        ({"num_threads": 2**40}, "num_threads"),
        ({"use_depth": 2}, "option use_depth must be a truth value"),
        ({"checkpoint_interval": float("nan")}, "checkpoint_interval must not be nan"),
        ({"checkpoint_interval": -1}, "checkpoint_interval must be >= 0"),
        ({"intrinsics_prior": "good"}, "must be auto, exif or calibrated"),
        ({"intrinsics_prior": 3}, "option intrinsics_prior must be a text"),
    ],
)
def test_values_out_of_bounds_are_refused(database, values, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        dgsfm.verify_pairs(database, **values)


def test_choices_are_named(database):
    with pytest.raises(ValueError, match="must be one of z, range, inverse"):
        dgsfm.import_depth(database, {}, depth_type="deep")


def test_numbers_of_numpy_are_numbers(database):
    import numpy as np

    options = {"num_threads": np.int32(1), "checkpoint_interval": np.float32(1)}
    dgsfm.verify_pairs(database, options)
