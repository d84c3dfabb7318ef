"""Metrics against figures made by hand and by an independent program."""

import importlib.util
import tempfile
import unittest
from pathlib import Path

import support
import numpy as np
from dgsfm_benchmark import metrics
from dgsfm_benchmark.geometry import Pose, align_points
from dgsfm_benchmark.model import read_model

# Figures of formulas agree to rounding.
ROUNDING = 1e-9


def rotation_z(angle_deg):
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


class RelativePoseErrorTest(unittest.TestCase):
    def test_is_the_larger_one_of_rotation_and_direction(self):
        truth1 = Pose(np.eye(3), np.zeros(3))
        truth2 = Pose(np.eye(3), np.array([1.0, 0, 0]))
        for rotation_deg, direction_deg in ((3, 2), (2, 5), (0, 120)):
            direction = rotation_z(direction_deg) @ np.array([7.0, 0, 0])
            estimate2 = Pose(rotation_z(rotation_deg), direction)
            error = metrics.relative_pose_error_deg(
                truth1, truth2, truth1, estimate2
            )
            self.assertAlmostEqual(
                error, max(rotation_deg, direction_deg), delta=ROUNDING
            )

    def test_direction_needs_a_true_baseline(self):
        pose = Pose(np.eye(3), np.zeros(3))
        moved = Pose(np.eye(3), np.array([0, 0.5e-3, 0]))
        other = Pose(np.eye(3), np.array([1.0, 0, 0]))
        error = metrics.relative_pose_error_deg
        self.assertEqual(error(pose, moved, pose, other, 1e-3), 0)
        self.assertAlmostEqual(error(pose, moved, pose, other, 1e-4), 90)
        self.assertEqual(error(pose, other, pose, pose), 180)


class AucTest(unittest.TestCase):
    def test_paper_auc_by_hand(self):
        # Recall rises to 1/2 at 1, to 1 at 3. Up to 1: a triangle of 1/4. Up
        # to 2: 1/4 and then, level, 1/2. Up to 4: 1/4, the trapezoid 3/2 from
        # 1 to 3, and 1.
        areas = metrics.paper_auc(np.array([3.0, 1.0]), [1, 2, 4])
        # The point at the threshold itself is not yet reached.
        expected = [0, 37.5, 68.75]
        np.testing.assert_allclose(areas, expected, atol=ROUNDING)

    def test_no_error_gives_all_and_no_pose_nothing(self):
        zeros = np.zeros(6)
        self.assertEqual(metrics.paper_auc(zeros, [1, 5]), [100, 100])
        infinite = np.full(6, np.inf)
        self.assertEqual(metrics.paper_auc(infinite, [1, 5]), [0, 0])
        self.assertEqual(metrics.colmap_auc(zeros, [1, 5], 0.01), [100, 100])
        self.assertEqual(
            metrics.colmap_auc(np.array([180.0]), [1, 5], 0.01), [0, 0]
        )

    def test_colmap_auc_by_hand(self):
        errors = np.array([0.5, 1.0, 4.0, 180.0])
        # No plateau: 1/4 at 0.5, 1/2 at 1, then level to 2.
        # (0.5 * 1/4 + 0.5 * 3/4) / 2 + 1 * 1/2 = 0.75, of 2.
        np.testing.assert_allclose(
            metrics.colmap_auc(errors, [2], 0), [37.5], atol=ROUNDING
        )
        # Plateau: 1/4 up to 0.5, 3/16 from there to 1, 1/2 from 1 to 2.
        np.testing.assert_allclose(
            metrics.colmap_auc(errors, [2], 0.5),
            [100 * (0.125 + 0.1875 + 0.5) / 2],
            atol=ROUNDING,
        )


class PoseErrorsTest(unittest.TestCase):
    def test_similarity_transforms_do_not_matter(self):
        truth = support.random_poses(5)
        random = np.random.default_rng(1)
        rotation, shift = support.random_rotation(random), random.normal(size=3)
        estimate = {
            name: Pose(
                pose.rotation @ rotation,
                3 * pose.translation + pose.rotation @ shift,
            )
            for name, pose in truth.items()
        }
        errors = metrics.paper_pose_errors_deg(truth, estimate)
        self.assertEqual(len(errors), 10)
        np.testing.assert_allclose(errors, 0, atol=ROUNDING)
        self.assertAlmostEqual(
            metrics.position_metrics(truth, estimate)["scale"], 1 / 3
        )

    def test_missing_image_counts_for_all_its_pairs(self):
        truth = support.random_poses(4)
        estimate = dict(list(truth.items())[:3])
        errors = metrics.paper_pose_errors_deg(truth, estimate)
        self.assertEqual(np.isinf(errors).sum(), 3)
        errors = metrics.colmap_pose_errors_deg(truth, [estimate], 0.01)
        self.assertEqual(len(errors), 12)
        self.assertEqual((errors == 180).sum(), 6)

    def test_colmap_counts_pairs_within_models(self):
        truth = support.random_poses(4)
        names = sorted(truth)
        models = [
            {name: truth[name] for name in names[:2]},
            {name: truth[name] for name in names[2:]},
        ]
        errors = metrics.colmap_pose_errors_deg(truth, models, 0.01)
        # Two ordered pairs in each model, the other eight are apart.
        self.assertEqual((errors == 180).sum(), 8)
        self.assertEqual((errors < 1e-5).sum(), 4)
        stranger = {**models[0], "x.jpg": truth[names[3]]}
        errors = metrics.colmap_pose_errors_deg(truth, [stranger], 0.01)
        # Ten true pairs are in no model, four have an image without truth.
        self.assertEqual(len(errors), 16)
        self.assertEqual((errors == 180).sum(), 14)


class IndependentScorerTest(unittest.TestCase):
    def test_agrees_with_pose_auc_on_ten_models(self):
        path = support.SHARED / "tools" / "pose_auc.py"
        if not path.exists():
            self.skipTest(f"{path} is not there")
        spec = importlib.util.spec_from_file_location("pose_auc", path)
        pose_auc = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(pose_auc)
        for seed in range(10):
            random = np.random.default_rng(seed)
            truth = support.random_poses(12, seed)
            estimate = {
                name: Pose(
                    support.small_rotation(random, 0.02) @ pose.rotation,
                    pose.translation + 0.05 * random.normal(size=3),
                )
                for name, pose in truth.items()
                if random.uniform() > 0.1
            }
            with tempfile.TemporaryDirectory() as folder:
                support.write_text_model(Path(folder) / "gt", truth)
                support.write_text_model(Path(folder) / "model", estimate)
                expected = pose_auc.evaluate(
                    pose_auc.load_gt(str(Path(folder) / "gt")),
                    pose_auc.load_gt(str(Path(folder) / "model")),
                )
                truth = read_model(Path(folder) / "gt").poses
                estimate = read_model(Path(folder) / "model").poses
            errors = metrics.paper_pose_errors_deg(truth, estimate)
            areas = metrics.paper_auc(errors, [1, 3, 5, 10])
            # The independent figures have two digits.
            np.testing.assert_allclose(
                areas,
                [expected[f"auc{t}"] for t in (1, 3, 5, 10)],
                atol=0.01,
            )
            self.assertAlmostEqual(
                metrics.position_metrics(truth, estimate)["scale"],
                expected["gt_over_model_scale"],
                delta=1e-5,
            )


class AlignmentTest(unittest.TestCase):
    def test_finds_similarity_and_rigid_transform(self):
        random = np.random.default_rng(0)
        source = random.normal(size=(6, 3))
        rotation = support.random_rotation(random)
        target = 2.5 * source @ rotation.T + [1, 2, 3]
        similarity = align_points(source, target)
        self.assertAlmostEqual(similarity.scale, 2.5)
        np.testing.assert_allclose(
            similarity.apply(source), target, atol=ROUNDING
        )
        self.assertEqual(align_points(source, target, False).scale, 1)
        np.testing.assert_allclose(
            align_points(source, target, False).rotation,
            rotation,
            atol=ROUNDING,
        )

    def test_points_on_a_line_leave_it_open(self):
        line = np.outer(np.arange(4.0), [1, 1, 0])
        self.assertIsNone(align_points(line, line))
        self.assertIsNone(align_points(line[:2], line[:2]))


class PointCloudTest(unittest.TestCase):
    def test_accuracy_and_completeness_by_hand(self):
        scan = np.array([[x, 0, 0] for x in np.arange(10.0)])
        # On the scan, 1.5 cm off, 4 cm off and far off.
        points = np.array(
            [[0, 0, 0], [1, 0.015, 0], [2, 0.04, 0], [3.5, 0, 0]]
        )
        figures = metrics.point_cloud_metrics(points, scan)
        self.assertEqual(
            [figures[f"accuracy_{k}cm"] for k in (1, 2, 5)], [25, 50, 75]
        )
        for k, expected in ((1, 10), (2, 20), (5, 30)):
            self.assertAlmostEqual(figures[f"completeness_{k}cm"], expected)

    def test_thinning_keeps_one_mean_a_voxel(self):
        points = np.array([[0.001, 0, 0], [0.003, 0, 0], [-5, 1, 0.5]])
        thinned = metrics.thin_points(points)
        self.assertEqual(len(thinned), 2)
        self.assertAlmostEqual(thinned[:, 0].max(), 0.002)

    def test_empty_clouds_have_nothing_near(self):
        figures = metrics.point_cloud_metrics(
            np.empty((0, 3)), np.zeros((1, 3))
        )
        self.assertEqual(set(figures.values()), {0.0})


if __name__ == "__main__":
    unittest.main()
