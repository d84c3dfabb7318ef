// Random exact problems of the minimal solvers with depth.

#pragma once

#include "estimators/solvers/relative_pose_affine_depth.h"
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

struct AffineDepthProblem {
  DepthQuadruple quadruple;
  AffineDepthModel truth;

  DepthTriplet Triplet() const {
    DepthTriplet triplet;
    for (int i = 0; i < 3; ++i) {
      triplet.points1[i] = quadruple.points1[i];
      triplet.points2[i] = quadruple.points2[i];
      triplet.depths1[i] = quadruple.depths1[i];
      triplet.depths2[i] = quadruple.depths2[i];
    }
    return triplet;
  }
};

// Any rotation, depths 0.1 to 10, scale 0.1 to 10, shifts -0.5 to 2 of map
// depths above 0.05, points within a field of view of about 70 degrees.
inline AffineDepthProblem CreateAffineProblem(bool calibrated,
                                              std::mt19937_64* random) {
  const auto uniform = [&](double min, double max) {
    return std::uniform_real_distribution<double>(min, max)(*random);
  };
  while (true) {
    AffineDepthProblem problem;
    TwoViewModel& truth = problem.truth.model;
    if (!calibrated) {
      truth.focal1 = uniform(0.5, 5);
      truth.focal2 = uniform(0.5, 5);
    }
    truth.scale = uniform(0.1, 10);
    problem.truth.shift1 = uniform(-0.5, 2);
    problem.truth.shift2 = uniform(-0.5, 2);
    const Eigen::Vector4d q(
        uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    truth.rotation = Eigen::Quaterniond(q.normalized()).toRotationMatrix();
    truth.translation << uniform(-2, 2), uniform(-2, 2), uniform(-2, 2);
    bool visible = true;
    for (int i = 0; i < 4; ++i) {
      const double z1 = uniform(0.1, 10);
      const Eigen::Vector3d ray(uniform(-0.7, 0.7), uniform(-0.7, 0.7), 1);
      const Eigen::Vector3d point2 =
          truth.rotation * (z1 * ray) + truth.translation;
      visible = visible && point2.z() > 0.05;
      problem.quadruple.points1[i] = truth.focal1 * ray.head<2>();
      problem.quadruple.points2[i] = truth.focal2 * point2.hnormalized();
      problem.quadruple.depths1[i] = z1 - problem.truth.shift1;
      problem.quadruple.depths2[i] =
          point2.z() / truth.scale - problem.truth.shift2;
      visible = visible && problem.quadruple.depths1[i] > 0.05 &&
                problem.quadruple.depths2[i] > 0.05;
    }
    if (visible) return problem;
  }
}

inline double BestDistance(const AffineDepthModels& models,
                           const AffineDepthModel& truth) {
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < models.count; ++i) {
    const AffineDepthModel& a = models.values[i];
    best =
        std::min(best,
                 (a.model.rotation - truth.model.rotation).norm() +
                     (a.model.translation - truth.model.translation).norm() +
                     std::abs(std::log(a.model.scale / truth.model.scale)) +
                     std::abs(std::log(a.model.focal1 / truth.model.focal1)) +
                     std::abs(std::log(a.model.focal2 / truth.model.focal2)) +
                     std::abs(a.shift1 - truth.shift1) +
                     std::abs(a.shift2 - truth.shift2));
  }
  return best;
}

}  // namespace dgsfm
