#!/usr/bin/env python3
"""What positions of images are worth.

usage: positions.py [street] [halves] [wrong] [loop] [FOLDER...]

street: 100 images, positions with 2 m of noise, 10 % of them off by 50 m, all
    altitudes by 30 m; errors of centres in the frame of the positions, against
    a model that is aligned to them afterwards (COLMAP 4.2.1's robust alignment,
    as its model_aligner does it).
halves: two parts of a street without common matches.
wrong: positions of which 30 % are off by 50 m, against none.
loop: 300 images around an object without matches that close the loop.
FOLDER...: distances from the positions of the database, against pycolmap's
    incremental mapping with position priors on the same database.
"""

import argparse
import json
import pathlib
import shutil
import sqlite3
import subprocess
import sys
import tempfile

import numpy as np
import pycolmap


def run(colmap, *arguments):
    result = subprocess.run(
        [colmap, *map(str, arguments)], capture_output=True, text=True
    )
    if result.returncode != 0:
        sys.exit(result.stdout + result.stderr)


class Scene:
    def __init__(self, colmap, folder, *arguments):
        self.colmap, self.folder = colmap, pathlib.Path(folder)
        shutil.rmtree(self.folder, ignore_errors=True)
        if "--num_points_per_image" not in arguments:
            arguments = (*arguments, "--num_points_per_image", 300)
        run(colmap, "depth_scene_synthesizer", "--output_path", self.folder,
            "--database_only", 1, *arguments)  # fmt: skip
        self.truth = poses_of(pycolmap.Reconstruction(self.folder / "gt"))

    def map(self, *arguments):
        output = self.folder / "models"
        run(self.colmap, "depth_global_mapper", "--database_path",
            self.folder / "database.db", "--output_path", output,
            *arguments)  # fmt: skip
        self.report = json.loads((output / "report.json").read_text())
        return pycolmap.Reconstruction(output / "0")

    def position_errors(self, model, offset):
        """Distances from the true centres by name, in metres. The model is in
        the frame of georeference.json, the truth about gt/origin.txt."""
        file = self.folder / "models" / "georeference.json"
        ecef_from_local = np.array(json.loads(file.read_text())["ecef_from_local"])
        origin = np.loadtxt(self.folder / "gt" / "origin.txt")
        gps = pycolmap.GPSTransform()
        errors = {}
        for name, pose in poses_of(model).items():
            ecef = ecef_from_local[:3, :3] @ center(pose) + ecef_from_local[:3, 3]
            enu = gps.ellipsoid_to_enu(
                gps.ecef_to_ellipsoid(ecef[None]), *origin
            )[0] - [0, 0, offset]
            errors[name] = np.linalg.norm(enu - center(self.truth[name]))
        return errors

    def positions(self):
        """Of the database, east, north and up of gt/origin.txt."""
        return read_positions(
            self.folder / "database.db", np.loadtxt(self.folder / "gt" / "origin.txt")
        )


def poses_of(model):
    return {
        image.name: image.cam_from_world()
        for image in model.images.values()
        if image.has_pose
    }


def center(pose):
    return pose.rotation.inverse() * -pose.translation


def read_positions(database, origin=None):
    rows = sqlite3.connect(database).execute(
        "SELECT name, position FROM images JOIN pose_priors "
        "ON images.image_id = pose_priors.corr_data_id"
    )
    positions = {name: np.frombuffer(blob) for name, blob in rows if blob}
    if origin is None:
        origin = np.median(list(positions.values()), axis=0)
    gps = pycolmap.GPSTransform()
    return {
        name: gps.ellipsoid_to_enu(xyz[None], *origin)[0]
        for name, xyz in positions.items()
    }


def aligned(model, positions, max_error):
    poses = poses_of(model)
    names = sorted(set(poses) & set(positions))
    estimated = pycolmap.estimate_sim3d_robust(
        np.array([center(poses[name]) for name in names]),
        np.array([positions[name] for name in names]),
        pycolmap.RANSACOptions(max_error=max_error),
    )
    if estimated is None:
        sys.exit("no alignment")
    return {n: estimated["tgt_from_src"] * center(poses[n]) for n in poses}


def pair_errors(poses, truth, names):
    """Largest of the errors of rotation and direction of each pair [deg]."""
    errors = []
    for i, a in enumerate(names):
        for b in names[:i]:
            if a not in poses or b not in poses:
                errors.append(180)
                continue
            found = poses[b] * poses[a].inverse()
            true = truth[b] * truth[a].inverse()
            rotation = np.rad2deg((found.rotation.inverse() * true.rotation).angle())
            norms = np.linalg.norm(found.translation) * np.linalg.norm(true.translation)
            # Images of one centre have no direction.
            if np.linalg.norm(true.translation) < 1e-6 or norms == 0:
                direction = 0
            else:
                cosine = found.translation @ true.translation / norms
                direction = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
            errors.append(max(rotation, direction))
    return np.array(errors)


def auc(errors, threshold):
    return 100 * np.mean(1 - np.minimum(errors, threshold) / threshold)


def street(colmap, work, seed):
    scene = Scene(colmap, work / "street", "--family", "street", "--num_images", 100,
                  "--gps", 1, "--gps_noise", 2, "--gps_outlier_ratio", 0.1,
                  "--gps_outlier", 50, "--gps_altitude_offset", 30,
                  "--random_seed", seed)  # fmt: skip
    errors = scene.position_errors(scene.map(), 30)
    without = scene.map("--use_pose_priors", 0)
    print(f"street {seed}: {len(errors)} images, median error "
          f"{np.median(list(errors.values())):.3f} m; aligned afterwards within",
          end="")  # fmt: skip
    for max_error in (3, 6, 10):
        centers = aligned(without, scene.positions(), max_error)
        distances = [
            np.linalg.norm(xyz - [0, 0, 30] - center(scene.truth[name]))
            for name, xyz in centers.items()
        ]
        print(f" {max_error} m: {np.median(distances):.3f} m", end="")
    print(flush=True)


def halves(colmap, work, seed):
    scene = Scene(colmap, work / "halves", "--family", "street", "--num_images", 100,
                  "--num_components", 2, "--component_step", 200, "--gps", 1,
                  "--gps_noise", 2, "--gravity", 1, "--random_seed", seed)  # fmt: skip
    model = scene.map()
    errors, poses = scene.position_errors(model, 0), poses_of(model)
    names = sorted(scene.truth)
    print(f"halves {seed}: {len(scene.report['models'])} model, {len(poses)} images")
    for what, part in (("both", names), ("first", names[:50]), ("second", names[50:])):
        print(f"  {what}: median error {np.median([errors[n] for n in part]):.3f} m, "
              f"of pairs {np.median(pair_errors(poses, scene.truth, part)):.3f} deg")


def wrong(colmap, work, seed):
    scene = Scene(colmap, work / "wrong", "--family", "street", "--num_images", 100,
                  "--gps", 1, "--gps_noise", 2, "--gps_outlier_ratio", 0.3,
                  "--gps_outlier", 50, "--random_seed", seed)  # fmt: skip
    names = sorted(scene.truth)
    scores = [
        auc(pair_errors(poses_of(scene.map(*options)), scene.truth, names), 5)
        for options in ((), ("--use_pose_priors", 0))
    ]
    print(f"wrong {seed}: AUC@5 {scores[0]:.2f}, without positions {scores[1]:.2f}")


def loop(colmap, work, seed):
    noise = 2
    scene = Scene(colmap, work / "loop", "--family", "ring", "--num_images", 300,
                  "--gps", 1, "--gps_noise", noise, "--gravity", 1,
                  "--random_seed", seed)  # fmt: skip
    connection = sqlite3.connect(scene.folder / "database.db")
    for table in ("matches", "two_view_geometries"):
        connection.execute(
            f"DELETE FROM {table} WHERE abs(pair_id / 2147483647 - "
            "pair_id % 2147483647) > 100"
        )
    connection.commit()
    with_positions = scene.position_errors(scene.map(), 0)
    without = scene.map("--use_pose_priors", 0)
    free = [
        np.linalg.norm(xyz - center(scene.truth[name]))
        for name, xyz in aligned(without, scene.positions(), 3 * noise).items()
    ]
    errors = list(with_positions.values())
    print(f"loop {seed}: {len(errors)} images, median error {np.median(errors):.3f} m, "
          f"largest {np.max(errors):.3f} m = {np.max(errors) / noise:.2f} standard "
          f"deviations; aligned afterwards {np.median(free):.3f}, "
          f"{np.max(free):.3f} m")  # fmt: skip


def real(colmap, work, folder):
    database = work / "real.db"
    shutil.copyfile(folder / "database.db", database)
    positions = read_positions(database)
    output = work / "real"
    run(colmap, "depth_global_mapper", "--database_path", database,
        "--output_path", output)  # fmt: skip
    report = json.loads((output / "report.json").read_text())
    ours = report["models"][0]["positions"]["position_errors_m"]
    options = pycolmap.IncrementalPipelineOptions()
    options.use_prior_position = True
    options.use_robust_loss_on_prior_position = True
    (work / "theirs").mkdir()
    models = pycolmap.incremental_mapping(
        database, folder / "images", work / "theirs", options
    )
    model = max(models.values(), key=lambda m: m.num_reg_images())
    # COLMAP's origin is another one: the median error is taken off.
    theirs = {
        name: center(pose) - positions[name]
        for name, pose in poses_of(model).items()
        if name in positions
    }
    offset = np.median(list(theirs.values()), axis=0)
    theirs = {name: error - offset for name, error in theirs.items()}
    common = {name: ours[name] for name in theirs if name in ours}
    for name, errors in (("dgsfm", ours), ("pycolmap", theirs), ("dgsfm, the same", common)):
        errors = np.array(list(errors.values()))
        print(f"{folder.name} {name}: {len(errors)} images, median horizontal "
              f"{np.median(np.linalg.norm(errors[:, :2], axis=1)):.3f} m, vertical "
              f"{np.median(np.abs(errors[:, 2])):.3f} m")  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="*", help="street halves wrong loop FOLDER")
    parser.add_argument("--colmap", default="build/release/bin/colmap")
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    pycolmap.logging.minloglevel = 2
    experiments = {"street": street, "halves": halves, "wrong": wrong, "loop": loop}
    for what in options.what or experiments:
        with tempfile.TemporaryDirectory() as work:
            work = pathlib.Path(work)
            if what not in experiments:
                real(options.colmap, work, pathlib.Path(what))
                continue
            for seed in range(options.seeds):
                experiments[what](options.colmap, work, seed)


if __name__ == "__main__":
    main()
