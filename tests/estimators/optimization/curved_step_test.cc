#include "estimators/optimization/curved_step.h"

#include "estimators/rotation_vector.h"

#include <cmath>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A chain of bodies, one unit apart along x, with two points beside each, which
// it and the next two see.
struct Chain {
  ObservationIndex observations;
  std::vector<BodyMotion> motions;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3d> point_steps;
};

Chain StraightChain(int num_bodies) {
  Chain chain;
  chain.observations.num_cameras = num_bodies;
  for (int i = 0; i < num_bodies; ++i) {
    chain.motions.emplace_back().center << i, 0, 0;
    for (const double y : {-3.0, 4.0}) {
      for (int body = i; body < std::min(num_bodies, i + 3); ++body) {
        chain.observations.cameras.push_back(body);
        chain.observations.points.push_back(int(chain.points.size()));
      }
      chain.points.emplace_back(i + 0.5, y, 1);
    }
  }
  chain.observations.num_points = int(chain.points.size());
  chain.point_steps.resize(chain.points.size());
  return chain;
}

// Turns about z that grow to max_angle at the end, with the centres and points
// that follow to first order.
Chain BendingChain(int num_bodies, double max_angle) {
  Chain chain = StraightChain(num_bodies);
  const double curvature = max_angle / num_bodies;
  const auto step_at = [&](const Eigen::Vector3d& x) {
    return Eigen::Vector3d(
        -curvature * x.x() * x.y(), 0.5 * curvature * x.x() * x.x(), 0);
  };
  for (BodyMotion& motion : chain.motions) {
    motion.rotation.z() = curvature * motion.center.x();
    motion.translation = step_at(motion.center);
  }
  for (size_t i = 0; i < chain.points.size(); ++i) {
    chain.point_steps[i] = step_at(chain.points[i]);
  }
  return chain;
}

std::optional<CurvedPositions> Move(const Chain& chain,
                                    int held_body = 0,
                                    int num_threads = 1) {
  return CurvedStep(chain.observations, held_body)
      .Move(chain.motions, chain.points, chain.point_steps, num_threads);
}

TEST(CurvedStep, RigidMotionStaysRigid) {
  Chain chain = StraightChain(20);
  const int held_body = 7;
  const Eigen::Vector3d held = chain.motions[held_body].center;
  const Eigen::Vector3d rotation(0.3, -0.4, 0.5);
  for (BodyMotion& motion : chain.motions) {
    motion.rotation = rotation;
    motion.translation = rotation.cross(motion.center - held);
  }
  for (size_t i = 0; i < chain.points.size(); ++i) {
    chain.point_steps[i] = rotation.cross(chain.points[i] - held);
  }
  const auto moved = Move(chain, held_body);
  ASSERT_TRUE(moved);
  const Eigen::Quaterniond turn = RotationFromVector(rotation);
  // The tolerance is that of rounding.
  for (size_t i = 0; i < chain.motions.size(); ++i) {
    EXPECT_LT(
        (moved->centers[i] - (held + turn * (chain.motions[i].center - held)))
            .norm(),
        1e-9);
  }
  for (size_t i = 0; i < chain.points.size(); ++i) {
    EXPECT_LT(
        (moved->points[i] - (held + turn * (chain.points[i] - held))).norm(),
        1e-9);
  }
}

TEST(CurvedStep, ChainBendsWithoutStretching) {
  const double max_angle = 0.5;
  const Chain chain = BendingChain(200, max_angle);
  const auto moved = Move(chain);
  ASSERT_TRUE(moved);
  for (size_t i = 1; i < chain.motions.size(); ++i) {
    // Straight lines stretch the last link by max_angle^2 / 2 = 0.12. The
    // rotation vectors of two neighbours differ by 0.0025.
    EXPECT_NEAR((moved->centers[i] - moved->centers[i - 1]).norm(), 1, 1e-5);
  }
  // The chain becomes an arc of this angle.
  const double radius = 200 / max_angle;
  const double end_angle = max_angle * 199 / 200;
  EXPECT_LT((moved->centers.back() -
             radius * Eigen::Vector3d(
                          std::sin(end_angle), 1 - std::cos(end_angle), 0))
                .norm(),
            1e-2);
  // Points stay beside their bodies; those at y = 4 come nearer to each other,
  // as on the inner side of a bend.
  for (size_t i = 0; i < chain.motions.size(); ++i) {
    const Eigen::Vector3d in_body =
        RotationFromVector(chain.motions[i].rotation).conjugate() *
        (moved->points[2 * i] - moved->centers[i]);
    EXPECT_LT((in_body - Eigen::Vector3d(0.5, -3, 1)).norm(), 0.02);
  }
}

TEST(CurvedStep, AgreesWithTheStraightStepToFirstOrder) {
  std::vector<double> errors;
  for (const double max_angle : {1e-2, 1e-3}) {
    const Chain chain = BendingChain(50, max_angle);
    const auto moved = Move(chain);
    ASSERT_TRUE(moved);
    double error = 0;
    for (size_t i = 0; i < chain.points.size(); ++i) {
      error = std::max(
          error,
          (moved->points[i] - chain.points[i] - chain.point_steps[i]).norm());
    }
    errors.push_back(error);
  }
  // The difference is of second order.
  EXPECT_NEAR(errors[1] / errors[0], 0.01, 0.001);
}

TEST(CurvedStep, PartsWithoutCommonPointsMoveByThemselves) {
  Chain chain = BendingChain(20, 0.5);
  // Only body 12 and the next see its points.
  ObservationIndex kept;
  kept.num_cameras = chain.observations.num_cameras;
  kept.num_points = chain.observations.num_points;
  for (size_t k = 0; k < chain.observations.points.size(); ++k) {
    const int first = chain.observations.points[k] / 2;
    if (first < 12 && chain.observations.cameras[k] >= 12) continue;
    kept.points.push_back(chain.observations.points[k]);
    kept.cameras.push_back(chain.observations.cameras[k]);
  }
  chain.observations = kept;
  const auto moved = Move(chain, /*held_body=*/3);
  ASSERT_TRUE(moved);
  for (const size_t held : {3, 12}) {
    EXPECT_LT((moved->centers[held] - chain.motions[held].center -
               chain.motions[held].translation)
                  .norm(),
              1e-9);
  }
  for (size_t i = 1; i < chain.motions.size(); ++i) {
    if (i == 12) continue;
    EXPECT_NEAR((moved->centers[i] - moved->centers[i - 1]).norm(), 1, 1e-3);
  }
}

TEST(CurvedStep, DoesNotDependOnThreads) {
  const Chain chain = BendingChain(100, 0.5);
  const auto moved1 = Move(chain, 0, 1);
  const auto moved3 = Move(chain, 0, 3);
  ASSERT_TRUE(moved1 && moved3);
  EXPECT_EQ(moved1->centers, moved3->centers);
  EXPECT_EQ(moved1->points, moved3->points);
}

TEST(CurvedStep, PositionsThatAreNotFiniteGiveNothing) {
  Chain chain = BendingChain(10, 0.5);
  chain.motions[4].translation.x() = NAN;
  EXPECT_FALSE(Move(chain));
}

}  // namespace
}  // namespace dgsfm
