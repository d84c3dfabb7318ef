"""Databases with our depth tables stay databases of COLMAP 4.x.

Usage: pycolmap_compat.py DEPTH_TABLES_TOOL WORK_DIR [DATABASE ...]

Compares what pycolmap reads before and after the tables were added: to a
database that pycolmap made, one that COLMAP 3.8 made, and copies of the given
ones. Exit code 77 if pycolmap is not installed.
"""

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


def make_database(path):
    """Writes a small database with the installed pycolmap."""
    rng = np.random.default_rng(0)
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera(
            model="PINHOLE", width=640, height=480, params=[500, 510, 320, 240]
        )
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        rig_id = database.write_rig(rig)
        for name in ("a.jpg", "folder/b.jpg", "c.jpg"):
            image = pycolmap.Image(name=name, camera_id=camera.camera_id)
            image.image_id = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig_id
            frame.add_data_id(image.data_id)
            database.write_frame(frame)
            keypoints = rng.uniform(0, 480, (20, 4)).astype(np.float32)
            database.write_keypoints(image.image_id, keypoints)
        for id1, id2 in ((1, 2), (3, 2)):
            matches = np.stack([rng.permutation(20) for _ in "ab"], axis=1)
            database.write_matches(id1, id2, matches)
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = matches[:15]
            geometry.E = np.arange(9.0).reshape(3, 3)
            geometry.cam2_from_cam1 = pycolmap.Rigid3d()
            database.write_two_view_geometry(id1, id2, geometry)


def user_version(path):
    connection = sqlite3.connect(path)
    version = connection.execute("PRAGMA user_version").fetchone()[0]
    connection.close()
    return version


def read_database(path):
    """All that pycolmap reads, as values that compare by ==."""
    with pycolmap.Database.open(path) as database:
        cameras = [
            (c.camera_id, c.model.name, c.width, c.height, list(c.params),
             c.has_prior_focal_length)
            for c in database.read_all_cameras()
        ]  # fmt: skip
        images = [
            (i.image_id, i.name, i.camera_id)
            for i in database.read_all_images()
        ]
        keypoints = [database.read_keypoints(i[0]).tolist() for i in images]
        pair_ids, matches = database.read_all_matches()
        geometry_ids, geometries = database.read_two_view_geometries()
        return {
            "rigs": [str(rig) for rig in database.read_all_rigs()],
            "frames": [str(frame) for frame in database.read_all_frames()],
            "cameras": cameras,
            "images": images,
            "keypoints": keypoints,
            "matches": list(zip(pair_ids, [m.tolist() for m in matches])),
            "two-view geometries": [
                (pair_id, int(g.config), g.inlier_matches.tolist(),
                 str(g.E), str(g.F), str(g.H), str(g.cam2_from_cam1))
                for pair_id, g in zip(geometry_ids, geometries)
            ],
        }  # fmt: skip


def check_database(tool, path):
    """Compares a database with a copy that has our tables."""
    extended = path.with_suffix(".extended.db")
    shutil.copyfile(path, extended)
    subprocess.run([tool, "extend", extended], check=True)
    assert user_version(extended) == user_version(path), "user_version"
    # Opening a database of an older version makes pycolmap update it.
    before = read_database(path)
    after = read_database(extended)
    for name in before:
        assert before[name] == after[name], f"{path}: {name} differ"
    assert before["images"] and before["matches"], f"{path}: nothing to compare"
    assert user_version(extended) == user_version(path), "user_version"
    subprocess.run([tool, "check", extended], check=True)
    counts = ", ".join(f"{len(values)} {name}" for name, values in before.items())
    print(f"{path.name}: {counts} as before")


def main():
    tool, work_dir, *databases = sys.argv[1:]
    work_dir = pathlib.Path(work_dir)
    shutil.rmtree(work_dir, ignore_errors=True)
    work_dir.mkdir(parents=True)
    paths = [work_dir / "pycolmap.db", work_dir / "colmap38.db"]
    make_database(paths[0])
    subprocess.run([tool, "create", paths[1]], check=True)
    for i, database in enumerate(databases):
        paths.append(work_dir / f"given{i}.db")
        shutil.copyfile(database, paths[-1])
    for path in paths:
        check_database(tool, path)


if __name__ == "__main__":
    main()
