"""Verification, mapping and what is made of models."""

import logging
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time

import numpy as np
import pytest
from conftest import model_bytes, query, run_program, synthesize

import dgsfm


def test_model_is_that_of_the_command_line(fountain, tmp_path):
    database, depths = fountain
    other = shutil.copy(database, tmp_path / "other.db")
    depth_path = tmp_path / "depth"
    depth_path.mkdir()
    for name, depth in depths.items():
        np.save(depth_path / f"{name}.npy", depth)
    (tmp_path / "expected").mkdir()
    for command in (
        ["depth_importer", "--depth_path", depth_path],
        ["depth_global_mapper", "--output_path", tmp_path / "expected"],
    ):
        code, _, error = run_program(*command, "--database_path", other)
        assert code == 0, error
    dgsfm.import_depth(database, depths)
    models = dgsfm.global_depth_mapping(database, tmp_path / "model")
    assert model_bytes(models[0]) == model_bytes(tmp_path / "expected" / "0")
    assert models[0].num_images == len(depths)
    assert models[0].unit == "metres"


def test_stages_one_by_one(database, synthetic, tmp_path, caplog, capfd):
    steps = []
    with caplog.at_level(logging.INFO, logger="dgsfm"):
        result = dgsfm.verify_pairs(
            database, progress=lambda *step: steps.append(step)
        )
    assert result["pairs"]["valid"] > 10
    label, done, total = steps[-1]
    assert label == "Verifying pairs"
    assert done == total == sum(result["pairs"].values())
    assert any("Pairs: " in r.getMessage() for r in caplog.records)
    assert {r.name for r in caplog.records} == {"dgsfm"}

    models = dgsfm.global_depth_mapping(database, tmp_path / "model")
    assert isinstance(models, list) and len(models) == 1
    assert models[0].path == tmp_path / "model" / "0"
    assert models[0].num_images == 10
    assert models.report == dgsfm.read_report(tmp_path / "model")
    assert len(models.report["images"]) == 10
    # Standard output is the caller's.
    assert capfd.readouterr() == ("", "")

    evaluation = dgsfm.evaluate(models[0], synthetic / "gt", [1, 5])
    assert evaluation["num_registered"] == 10
    assert evaluation["auc"]["5"] > 90
    again = dgsfm.verify_pairs(database)
    assert again["num_kept"] == total


def test_models_are_reconstructions_of_pycolmap(database, tmp_path):
    pytest.importorskip("pycolmap")
    models = dgsfm.global_depth_mapping(database, tmp_path / "model")
    (reconstruction,) = models.reconstructions
    assert reconstruction.num_points3D() == models[0].num_points
    assert reconstruction.num_reg_images() == models[0].num_images


def test_warnings_are_warnings(database, tmp_path, caplog):
    query(database, "DELETE FROM dgsfm_keypoint_depths")
    with caplog.at_level(logging.WARNING, logger="dgsfm"):
        dgsfm.verify_pairs(database)
    assert "no depth priors" in caplog.text
    assert {r.levelno for r in caplog.records} == {logging.WARNING}


def test_no_model_is_an_error_with_a_report(database, tmp_path):
    with pytest.raises(RuntimeError, match="no model could be reconstructed, see .*"):
        dgsfm.global_depth_mapping(
            database, tmp_path / "model", pair_verification={"min_num_inliers": 10**6}
        )
    report = dgsfm.read_report(tmp_path / "model")
    assert report["models"] == []
    assert all("reason" in image for image in report["images"])


def test_preset_of_the_paper_sets_defaults(database, tmp_path):
    dgsfm.global_depth_mapping(
        database, tmp_path / "model", paper=True, skip_pair_judging=True,
        two_view_depth={"min_num_trials": 300},
    )  # fmt: skip
    project = (tmp_path / "model" / "project.ini").read_text()
    assert "paper=1" in project
    assert "intrinsics_prior=calibrated" in project.replace('"', "")
    assert "min_num_trials=300" in project
    assert "skip_retriangulation=1" in project


def test_exported_depth_is_that_imported(fountain, tmp_path):
    database, depths = fountain
    dgsfm.import_depth(database, depths)
    result = dgsfm.export_depth(database, tmp_path / "maps")
    assert set(result["exported"]) == set(depths)
    for name, depth in depths.items():
        exported = np.load(tmp_path / "maps" / result["exported"][name]["file"])
        known = np.isfinite(depth) & (depth > 0)
        np.testing.assert_allclose(exported[known], depth[known], rtol=1e-3)
        assert not exported[~known].any()
    with pytest.raises(ValueError, match="undistorted_path needs input_path"):
        dgsfm.export_depth(database, tmp_path / "maps", undistorted_path="x")
    with pytest.raises(ValueError, match="png_scale must be positive"):
        dgsfm.export_depth(database, tmp_path / "maps", png_scale=0)


def test_threads_map_different_databases(database, tmp_path):
    expected = dgsfm.global_depth_mapping(database, tmp_path / "model")
    copies = [shutil.copy(database, tmp_path / f"{i}.db") for i in range(3)]
    models = {}

    def work(path):
        models[path] = dgsfm.global_depth_mapping(path, f"{path}.model")

    threads = [threading.Thread(target=work, args=[path]) for path in copies]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for path in copies:
        assert model_bytes(models[path][0]) == model_bytes(expected[0])


def test_other_threads_run_meanwhile(database):
    ticks = []
    stop = threading.Event()

    def tick():
        while not stop.wait(0.01):
            ticks.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.monotonic()
    dgsfm.verify_pairs(database, restart=True)
    end = time.monotonic()
    stop.set()
    thread.join()
    gaps = np.diff([begin, *(t for t in ticks if begin < t < end), end])
    # A call that held the interpreter would be one gap; seconds would depend on
    # what else the machine does.
    assert gaps.max() < 0.5 * (end - begin)


def test_exception_of_progress_ends_the_call(database):
    def fail(label, done, total):
        raise LookupError(label)

    with pytest.raises(LookupError, match="Verifying pairs"):
        dgsfm.verify_pairs(database, progress=fail)
    assert dgsfm.verify_pairs(database)["pairs"]["valid"] > 10


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """A database whose verification takes seconds."""
    folder = tmp_path_factory.mktemp("street") / "scene"
    synthesize(
        folder, "--database_only", 1, "--family", "street", "--num_images", 24,
        "--outlier_match_ratio", 0.3,
    )  # fmt: skip
    return folder / "database.db"


INTERRUPTED = """
    import os, signal
    import dgsfm

    def interrupt(label, done, total):
        if done < total and not interrupt.done:
            interrupt.done = True
            os.kill(os.getpid(), signal.SIGINT)

    interrupt.done = False
    try:
        dgsfm.{call}
    except KeyboardInterrupt:
        print("interrupted")
"""


def is_interrupted(call):
    """Whether Ctrl-C at the first sign of progress ends the call."""
    code = textwrap.dedent(INTERRUPTED).format(call=call)
    output = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    return "interrupted" in output


def test_ctrl_c_during_verification(street, tmp_path):
    database = shutil.copy(street, tmp_path)
    assert is_interrupted(
        f"verify_pairs({str(database)!r}, progress=interrupt)"
    )
    stored = query(database, "SELECT COUNT(*) FROM dgsfm_pair_geometries")[0][0]
    assert query(database, "PRAGMA integrity_check") == [("ok",)]
    result = dgsfm.verify_pairs(database)
    # What was finished then is kept, and the rest is done.
    assert 0 < result["num_kept"] == stored < sum(result["pairs"].values())
    complete = shutil.copy(street, tmp_path / "complete.db")
    assert dgsfm.verify_pairs(complete)["pairs"] == result["pairs"]


def test_ctrl_c_during_mapping(street, tmp_path):
    database = shutil.copy(street, tmp_path)
    output_path = tmp_path / "model"
    dgsfm.verify_pairs(database)
    assert is_interrupted(
        f"global_depth_mapping({str(database)!r}, {str(output_path)!r}, "
        "progress=interrupt)"
    )
    # Components that were mapped stay for the next run.
    names = {p.name for p in pathlib.Path(output_path).glob("*")}
    assert names <= {".dgsfm_checkpoints"}
    assert dgsfm.global_depth_mapping(database, output_path)[0].num_images > 20


def test_program_hands_back_its_exit_code(tmp_path):
    assert run_program("depth_importer")[0] == 2
    assert run_program("help")[0] == 0
    code, _, error = run_program("model_evaluator", "--input_path", tmp_path,
                                 "--ground_truth_path", tmp_path)  # fmt: skip
    assert code == 1 and error.startswith("ERROR: ")
