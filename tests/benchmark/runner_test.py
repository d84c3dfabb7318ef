"""Runs of small experiments with programs made for the test."""

import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

import support
import pycolmap
from dgsfm_benchmark import page, runner
from dgsfm_benchmark.database import copy_with_images, merge_cameras
from dgsfm_benchmark.errors import BenchmarkError
from dgsfm_benchmark.experiment import read_experiment, with_engines
from dgsfm_benchmark.process import run_program
from dgsfm_benchmark.storage import EXPERIMENTS, with_stored_runs

# A mapper that takes the truth of its scene, found beside the images, writes
# it as its model, and notes in a file that it ran.
MAPPER = f"""#!{sys.executable}
import pathlib, shutil, sys
images, output, seed = sys.argv[1:]
scene = pathlib.Path(images).parent
with open(scene / "runs.txt", "a") as log:
    log.write(seed + "\\n")
if seed == "1":
    sys.exit("the mapper gave up")
shutil.copytree(scene / "gt", pathlib.Path(output) / "0")
"""

# This project's program, as far as the benchmark needs it: it writes a model
# and a report, which has the repeatability only if that is asked for. The
# second seed fails after both are written.
DEPTH_MAPPER = f"""#!{sys.executable}
import json, pathlib, shutil, sys
command, *arguments = sys.argv[1:]
if command == "depth_importer":
    sys.exit()
assert command == "depth_global_mapper"
options = dict(zip(arguments[::2], arguments[1::2]))
output = pathlib.Path(options["--output_path"])
shutil.copytree(pathlib.Path(__file__).parent / "data/scene/gt", output / "0")
report = dict(stages=[])
if options.get("--measure_repeatability") == "1":
    report["repeatability"] = dict(
        auc_1_3_5_deg=[87.5, 95.0, 97.0],
        median_rotation_deg=0.05,
        median_translation_deg=0.1,
    )
(output / "report.json").write_text(json.dumps(report))
if options["--random_seed"] == "1":
    sys.exit("the mapper gave up")
"""

REPEATABILITY_EXPERIMENT = """
seeds = [0, 1]
[[dataset]]
name = "test"
layout = "plain"
path = "{path}"
[[engine]]
name = "measured"
type = "dgsfm"
options = {{ measure_repeatability = 1 }}
[[engine]]
name = "not measured"
type = "dgsfm"
"""

FACTS_EXPERIMENT = """
seeds = [0, 1]
[[dataset]]
name = "test"
role = "fit"
layout = "plain"
path = "{path}"
seeds = [0]
every = [1, 2]
[dataset.scene.scene]
min_threshold_deg = {min_threshold_deg}
is_metric = false
depth_units = {{ depth = 4 }}
[[engine]]
name = "any depth"
type = "dgsfm"
depth = ["depth_sensor", "depth", "none"]
[[engine]]
name = "none"
type = "dgsfm"
[[engine]]
name = "other seed"
type = "dgsfm"
seeds = [1]
"""

EXPERIMENT = """
seeds = [0, 1]
[[dataset]]
name = "test"
layout = "plain"
path = "{path}"
[[engine]]
name = "copy"
type = "colmap"
program = "{program}"
commands = [["{{images}}", "{{output}}", "{{seed}}"]]
[[engine]]
name = "with depth"
type = "dgsfm"
depth = "depth"
"""


def write_database(path, names):
    """A COLMAP 4.x database of images without key points."""
    database = pycolmap.Database.open(str(path))
    for name in names:
        camera = pycolmap.Camera.create_from_model_name(
            0, "SIMPLE_RADIAL", 70, 64, 48
        )
        camera.camera_id = database.write_camera(camera)
        image = pycolmap.Image(name=name, camera_id=camera.camera_id)
        image.image_id = database.write_image(image)
        # As COLMAP's extractor: each camera is a rig, each image a frame.
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        frame = pycolmap.Frame(rig_id=database.write_rig(rig))
        frame.add_data_id(image.data_id)
        database.write_frame(frame)
    database.close()


class RunnerTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name)
        self.scene = self.path / "data" / "scene"
        poses = support.random_poses(3)
        support.write_text_model(self.scene / "gt", poses)
        support.write_images(self.scene / "images", poses)
        write_database(self.scene / "database.db", poses)
        self.program = self.path / "mapper"
        self.program.write_text(MAPPER)
        self.program.chmod(0o755)

    def run_experiment(self, text=EXPERIMENT, values=None, **settings):
        path = self.path / "experiment.toml"
        path.write_text(
            text.format(
                path=self.path / "data",
                program=self.program,
                **(values or {}),
            )
        )
        with contextlib.redirect_stderr(io.StringIO()):
            return runner.run_experiment(
                read_experiment(path),
                runner.Settings(
                    self.path, self.path / "work", self.program, 2, **settings
                ),
            )

    def num_runs(self):
        return len((self.scene / "runs.txt").read_text().split())

    def test_failed_run_counts_as_zero_and_says_why(self):
        good, bad = self.run_experiment()
        self.assertEqual((good["status"], good["seed"]), ("ok", 0))
        for area in good["metrics"]["auc"]:
            # The poses are of text files with 17 digits.
            self.assertAlmostEqual(area, 100, delta=1e-6)
        self.assertGreater(good["peak_memory_mb"], 0)
        self.assertEqual(bad["status"], "failed")
        self.assertIn("the mapper gave up", bad["reason"])
        self.assertEqual(bad["metrics"]["auc"], [0, 0, 0])
        # The engine that wants depth, which the scene has not, does not run.
        self.assertEqual({good["engine"], bad["engine"]}, {"copy"})

    def test_records_repeatability_where_it_is_measured(self):
        self.program.write_text(DEPTH_MAPPER)
        records = self.run_experiment(REPEATABILITY_EXPERIMENT)
        runs = {(r["engine"], r["seed"]): r for r in records}
        self.assertEqual(len(runs), 4)
        self.assertEqual(
            {key for key, run in runs.items() if run["status"] == "ok"},
            {("measured", 0), ("not measured", 0)},
        )
        # What a run that failed has left does not count.
        self.assertEqual(
            {
                key: run["metrics"]["repeatable_auc_1"]
                for key, run in runs.items()
                if "repeatable_auc_1" in run["metrics"]
            },
            {("measured", 0): 87.5},
        )
        results = self.path / "runs.json"
        page.store_runs({"test": {"records": records}}, results)
        self.assertEqual(page.read_runs(results)["test"]["records"], records)

    def test_records_what_is_known_of_scenes(self):
        self.program.write_text(DEPTH_MAPPER)
        (self.scene / "depth").mkdir()
        records = self.run_experiment(
            FACTS_EXPERIMENT, {"min_threshold_deg": 3}
        )
        # Of three images every second one is too few.
        self.assertEqual(
            [(r["engine"], r["depth"], r["seed"]) for r in records],
            [("any depth", "depth", 0), ("none", "none", 0)],
        )
        for record in records:
            self.assertEqual(record["role"], "fit")
            self.assertEqual(record["min_threshold_deg"], 3)
            self.assertEqual(record["thresholds_deg"], [1, 3, 5])
        # Truth and model are the same, so the model is 4 units of depth off.
        errors = [r["metrics"].get("scale_error") for r in records]
        self.assertAlmostEqual(errors[0], 0.75)
        self.assertIsNone(errors[1])
        # What is said of a scene changes no run, but its record.
        values = {"min_threshold_deg": 5}
        self.assertEqual(
            self.run_experiment(FACTS_EXPERIMENT, values),
            [{**record, **values} for record in records],
        )

    def test_goes_on_where_it_was(self):
        records = self.run_experiment()
        self.assertEqual(self.num_runs(), 2)
        self.assertEqual(self.run_experiment(), records)
        self.assertEqual(self.num_runs(), 2)
        self.run_experiment(fresh=True)
        self.assertEqual(self.num_runs(), 4)
        # Another version of the program, and a file that was cut off.
        self.program.write_text(MAPPER + "# changed\n")
        self.run_experiment()
        self.assertEqual(self.num_runs(), 6)
        (record,) = self.path.glob("work/**/copy/0/run.json")
        record.write_text(record.read_text()[:20])
        self.run_experiment()
        self.assertEqual(self.num_runs(), 7)

    def test_subsets_are_scenes_of_their_own(self):
        names = [f"{i:04d}.jpg" for i in range(3)]
        target = self.path / "cut.db"
        copy_with_images(self.scene / "database.db", target, names[::2])
        database = pycolmap.Database.open(str(target))
        self.addCleanup(database.close)
        self.assertEqual(
            [image.name for image in database.read_all_images()], names[::2]
        )
        with self.assertRaisesRegex(BenchmarkError, "x.jpg"):
            copy_with_images(
                self.scene / "database.db", self.path / "x.db", ["x.jpg"]
            )


    def test_merged_cameras_are_one_rig(self):
        path = self.scene / "database.db"
        merge_cameras(path)
        database = pycolmap.Database.open(str(path))
        self.addCleanup(database.close)
        (camera,) = database.read_all_cameras()
        (rig,) = database.read_all_rigs()
        self.assertEqual(rig.ref_sensor_id.id, camera.camera_id)
        for image in database.read_all_images():
            self.assertEqual(image.camera_id, camera.camera_id)
        for frame in database.read_all_frames():
            self.assertEqual(frame.rig_id, rig.rig_id)

    def test_different_cameras_cannot_be_merged(self):
        path = self.scene / "database.db"
        database = pycolmap.Database.open(str(path))
        camera = pycolmap.Camera.create_from_model_name(
            0, "SIMPLE_RADIAL", 70, 48, 64
        )
        database.write_image(
            pycolmap.Image(
                name="x.jpg", camera_id=database.write_camera(camera)
            )
        )
        database.close()
        with self.assertRaisesRegex(BenchmarkError, "different cameras"):
            merge_cameras(path)


class ProcessTest(unittest.TestCase):
    def test_reports_time_and_memory_of_the_child(self):
        with tempfile.TemporaryDirectory() as folder:
            # That of this process, which is larger, must not count.
            mine = b"x" * 500_000_000
            code = "import time; x = b'x' * 200_000_000; time.sleep(0.2)"
            usage = run_program(
                [sys.executable, "-c", code], Path(folder) / "log"
            )
            self.assertEqual(len(mine), 500_000_000)
            # 200 million bytes, and the interpreter.
            self.assertGreater(usage.peak_memory_mb, 190)
            self.assertLess(usage.peak_memory_mb, 300)

    def test_kills_what_takes_too_long(self):
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaisesRegex(BenchmarkError, "no result after"):
                run_program(
                    [sys.executable, "-c", "import time; time.sleep(60)"],
                    Path(folder) / "log",
                    timeout_seconds=0.2,
                )


class ExperimentFilesTest(unittest.TestCase):
    def test_all_can_be_read(self):
        paths = sorted(
            (support.PROJECT / "benchmark" / "experiments").glob("*.toml")
        )
        self.assertGreater(len(paths), 4)
        for path in paths:
            self.assertTrue(read_experiment(path).engines)

    def test_all_say_what_constants_may_be_fitted_on(self):
        folder = support.PROJECT / "benchmark" / "experiments"
        for path in folder.glob("*.toml"):
            for dataset in read_experiment(path).datasets:
                self.assertIn("role", dataset, path)

    def test_scenes_of_a_shared_file(self):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "scenes.toml").write_text(
                "[scene.a]\nis_metric = false\nmin_threshold_deg = 3\n"
                "[scene.b]\nlike = 'a'\nimages = '0:3'\n"
                "[scene.c]\n"
            )
            path = Path(folder) / "x.toml"
            head = (
                "[[engine]]\nname = 'e'\ntype = 'dgsfm'\n"
                "[[dataset]]\nname = 'a'\nlayout = 'plain'\n"
                "scene_file = 'scenes.toml'\nscenes = ['a', 'b']\n"
            )
            path.write_text(head + "[dataset.scene.a]\nmin_threshold_deg = 5\n")
            (dataset,) = read_experiment(path).datasets
            facts = {"is_metric": False, "min_threshold_deg": 5}
            self.assertEqual(
                dataset["scene"],
                {"a": facts, "b": {"folder": "a", "images": "0:3", **facts}},
            )
            for text, message in (
                ("role = 'fitted'", "fitted"),
                ("[dataset.scene.a]\nmetric = true", "metric"),
                ("[dataset.scene.a]\nrole = 'x'", "role 'x'"),
            ):
                path.write_text(head + text)
                with self.assertRaisesRegex(BenchmarkError, message):
                    read_experiment(path)

    def test_engines_run_alone_beside_stored_runs_of_others(self):
        experiment = read_experiment(EXPERIMENTS / "real_photos.toml")
        part = with_engines(experiment, ["COLMAP global"])
        self.assertEqual([e["name"] for e in part.engines], ["COLMAP global"])
        with self.assertRaisesRegex(BenchmarkError, "no engine 'x', but no depth"):
            with_engines(experiment, ["x"])

        def run(scene, engine, seconds):
            return {
                "dataset": "shared", "scene": scene, "engine": engine,
                "seed": 0, "seconds": seconds,
            }  # fmt: skip

        merged = with_stored_runs(
            [run("a", "no depth", 1), run("b", "no depth", 1)],
            {
                "records": [
                    run("a", "COLMAP global", 2), run("a", "no depth", 2),
                    run("b", "an engine of old", 2),
                ]
            },
            experiment,
        )  # fmt: skip
        self.assertEqual(
            merged,
            [
                run("a", "COLMAP global", 2), run("a", "no depth", 1),
                run("b", "no depth", 1),
            ],
        )  # fmt: skip

    def test_faults_are_named(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "x.toml"
            for text, message in (
                ("seeds = ", "x.toml"),
                ("[[dataset]]\nname = 'a'\nlayout = 'plain'", "engine"),
                ("sedes = [0]\ndataset = []\nengine = []", "sedes"),
            ):
                path.write_text(text)
                with self.assertRaisesRegex(BenchmarkError, message):
                    read_experiment(path)


if __name__ == "__main__":
    unittest.main()
