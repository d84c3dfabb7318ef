// Random exact problems of the minimal solvers with depth.

#pragma once

#include "estimators/solvers/relative_pose_depth.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <Eigen/Geometry>

namespace dgsfm {

enum class Focals { KNOWN, SHARED, TWO, ONE_SIDED };

struct DepthProblem {
  DepthTriplet triplet;
  TwoViewModel truth;
};

// Any rotation, depths 0.1 to 10, scale 0.1 to 10, focal lengths 0.5 to 5
// (image units), points within a field of view of about 90 degrees.
inline DepthProblem CreateDepthProblem(Focals focals, std::mt19937_64* random) {
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(*random);
  };
  while (true) {
    DepthProblem problem;
    TwoViewModel& truth = problem.truth;
    if (focals != Focals::KNOWN) {
      truth.focal2 = std::exp(uniform(std::log(0.5), std::log(5.0)));
      if (focals == Focals::SHARED) truth.focal1 = truth.focal2;
      if (focals == Focals::TWO) {
        truth.focal1 = std::exp(uniform(std::log(0.5), std::log(5.0)));
      }
    }
    truth.scale = std::exp(uniform(std::log(0.1), std::log(10.0)));
    const Eigen::Vector4d q(
        uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    truth.rotation = Eigen::Quaterniond(q.normalized()).toRotationMatrix();
    truth.translation << uniform(-5, 5), uniform(-5, 5), uniform(-5, 5);
    bool visible = true;
    for (int i = 0; i < 3; ++i) {
      const double z1 = std::exp(uniform(std::log(0.1), std::log(10.0)));
      const Eigen::Vector3d ray(uniform(-1, 1), uniform(-1, 1), 1);
      const Eigen::Vector3d point2 =
          truth.rotation * (z1 * ray) + truth.translation;
      visible = visible && point2.z() > 0.1 && point2.z() < 10 &&
                point2.head<2>().norm() < 2 * point2.z();
      problem.triplet.points1[i] = truth.focal1 * ray.head<2>();
      problem.triplet.points2[i] = truth.focal2 * point2.head<2>() / point2.z();
      problem.triplet.depths1[i] = z1;
      problem.triplet.depths2[i] = point2.z() / truth.scale;
    }
    if (visible) return problem;
  }
}

inline double Distance(const TwoViewModel& a, const TwoViewModel& b) {
  return (a.rotation - b.rotation).norm() +
         (a.translation - b.translation).norm() / b.translation.norm() +
         std::abs(std::log(a.scale / b.scale)) +
         std::abs(std::log(a.focal1 / b.focal1)) +
         std::abs(std::log(a.focal2 / b.focal2));
}

inline double BestDistance(const TwoViewModels& models,
                           const TwoViewModel& truth) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < models.count; ++i) {
    best = std::min(best, Distance(models.values[i], truth));
  }
  return best;
}

}  // namespace dgsfm
