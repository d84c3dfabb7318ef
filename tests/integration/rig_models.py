"""Rigs of databases that pycolmap makes: models keep their shape, and pycolmap
reads them with rigs and frames.

Usage: COLMAP=PATH rig_models.py WORK_DIR

Exit code 77 if pycolmap is not installed.
"""

import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys

try:
    import numpy as np
    import pycolmap
except ImportError as error:
    print(f"skipped: {error} (pip install pycolmap)")
    sys.exit(77)

COLMAP = os.environ["COLMAP"]


def synthesize(folder, num_cameras, baseline):
    """A database with a rig of cameras of known focal length; its truth."""
    folder.mkdir(parents=True)
    pycolmap.set_random_seed(0)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = 1
    options.num_cameras_per_rig = num_cameras
    options.num_frames_per_rig = 8
    options.num_points3D = 200
    options.num_points2D_without_point3D = 20
    options.sensor_from_rig_translation_stddev = baseline
    options.sensor_from_rig_rotation_stddev = 5.0
    options.camera_has_prior_focal_length = True
    with pycolmap.Database.open(folder / "database.db") as database:
        truth = pycolmap.synthesize_dataset(options, database)
        noise = pycolmap.SyntheticNoiseOptions()
        noise.point2D_stddev = 0.5
        noisy = pycolmap.Reconstruction(truth)
        pycolmap.synthesize_noise(noise, noisy, database)
    return truth


def map_database(folder, output, *options):
    result = subprocess.run(
        [COLMAP, "depth_global_mapper", "--database_path", folder / "database.db",
         "--output_path", folder / output, *options],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return pycolmap.Reconstruction(folder / output / "0")


def sensor_poses(model):
    (rig,) = (rig for rig in model.rigs.values() if rig.num_sensors() > 1)
    return {sensor.id: pose for sensor, pose in rig.non_ref_sensors.items()}


def centers(model):
    return {
        image.name: image.projection_center()
        for image in model.images.values()
        if image.has_pose
    }


def check_is_rigid(model, truth):
    """The poses of images are those of their frames, with the true sensors."""
    for camera_id, pose in sensor_poses(truth).items():
        found = sensor_poses(model)[camera_id]
        assert np.allclose(found.matrix(), pose.matrix(), atol=1e-12)
    for image in model.images.values():
        frame = image.frame
        expected = frame.sensor_from_world(image.camera.sensor_id)
        assert np.allclose(
            image.cam_from_world().matrix(), expected.matrix(), atol=1e-9
        )


def scale(model, truth):
    found, true = centers(model), centers(truth)
    names = sorted(found)
    spread = [np.linalg.norm(found[a] - found[b]) for a in names for b in names]
    true_spread = [np.linalg.norm(true[a] - true[b]) for a in names for b in names]
    return np.sum(spread) / np.sum(true_spread)


def check_known(work):
    for num_cameras, baseline in ((2, 0.3), (3, 0.0)):
        folder = work / f"known{num_cameras}"
        truth = synthesize(folder, num_cameras, baseline)
        model = map_database(folder, "model")
        assert model.num_reg_images() == 8 * num_cameras
        assert model.num_reg_frames() == 8
        check_is_rigid(model, truth)
        if baseline > 0:
            # The noise of the key points is a thousandth of the baseline's
            # parallax.
            assert abs(scale(model, truth) - 1) < 0.01, scale(model, truth)
        free = map_database(folder, "free", "--ignore_rigs", "1")
        assert all(rig.num_sensors() == 1 for rig in free.rigs.values())


def check_unknown(work):
    folder = work / "unknown"
    truth = synthesize(folder, 2, 0.3)
    connection = sqlite3.connect(folder / "database.db")
    connection.execute("UPDATE rig_sensors SET sensor_from_rig = NULL")
    connection.commit()
    connection.close()
    model = map_database(folder, "model")
    assert model.num_reg_frames() == 8
    for camera_id, pose in sensor_poses(truth).items():
        found = sensor_poses(model)[camera_id]
        angle = (found.rotation.inverse() * pose.rotation).angle()
        assert np.rad2deg(angle) < 0.1, np.rad2deg(angle)
        translation = found.translation / scale(model, truth)
        error = np.linalg.norm(translation - pose.translation)
        assert error < 0.01 * np.linalg.norm(pose.translation), error


def turn_sensor(database_path, angle_deg):
    """Turns the pose of the second camera in the rig about its y axis."""
    half = np.deg2rad(angle_deg) / 2
    turn = pycolmap.Rigid3d(
        pycolmap.Rotation3d(np.array([0, np.sin(half), 0, np.cos(half)])), np.zeros(3)
    )
    with pycolmap.Database.open(database_path) as database:
        (rig,) = (rig for rig in database.read_all_rigs() if rig.num_sensors() > 1)
        sensor, pose = next(iter(rig.non_ref_sensors.items()))
        rig.set_sensor_from_rig(sensor, turn * pose)
        database.update_rig(rig)


def relative_rotation_errors_deg(model, truth):
    """Of all pairs of images against the truth."""
    found = {image.name: image for image in model.images.values() if image.has_pose}
    true = {image.name: image for image in truth.images.values() if image.has_pose}
    names = sorted(found)
    return [
        np.rad2deg(
            (
                relative(found[a], found[b]).rotation.inverse()
                * relative(true[a], true[b]).rotation
            ).angle()
        )
        for a in names
        for b in names
        if a < b
    ]


def relative(image1, image2):
    return image2.cam_from_world() * image1.cam_from_world().inverse()


def check_wrong(work):
    """Wrong rotations in a rig are found: small ones by the model, large ones by
    pairs. Held, they are errors of all pairs of two cameras."""
    for angle_deg in (1, 60):
        folder = work / f"wrong{angle_deg}"
        truth = synthesize(folder, 2, 0.3)
        turn_sensor(folder / "database.db", angle_deg)
        model = map_database(folder, "model")
        assert model.num_reg_frames() == 8
        errors_deg = relative_rotation_errors_deg(model, truth)
        # As of unknown poses.
        assert max(errors_deg) < 0.2, (angle_deg, max(errors_deg))
        report = json.loads((folder / "model" / "report.json").read_text())
        assert any("camera 2 in its rig" in text for text in report["warnings"])


def check_apart(work):
    """A camera of unknown pose whose images match no other camera's is in none of
    the rigs of a model."""
    folder = work / "apart"
    synthesize(folder, 3, 0.3)
    connection = sqlite3.connect(folder / "database.db")
    connection.execute("UPDATE rig_sensors SET sensor_from_rig = NULL WHERE sensor_id = 3")
    cameras = dict(connection.execute("SELECT image_id, camera_id FROM images"))
    for table in ("matches", "two_view_geometries"):
        pair_ids = [row[0] for row in connection.execute(f"SELECT pair_id FROM {table}")]
        for pair_id in pair_ids:
            pair = {cameras[pair_id // 2147483647], cameras[pair_id % 2147483647]}
            if 3 in pair and len(pair) > 1:
                connection.execute(f"DELETE FROM {table} WHERE pair_id = ?", (pair_id,))
    connection.commit()
    connection.close()
    model = map_database(folder, "model")
    assert model.num_reg_images() == 16
    assert all(rig.num_sensors() == 2 for rig in model.rigs.values())
    other = pycolmap.Reconstruction(folder / "model" / "1")
    assert other.num_reg_images() == 8
    assert all(rig.num_sensors() == 1 for rig in other.rigs.values())


def main():
    work = pathlib.Path(sys.argv[1])
    shutil.rmtree(work, ignore_errors=True)
    check_known(work)
    check_unknown(work)
    check_wrong(work)
    check_apart(work)


if __name__ == "__main__":
    main()
