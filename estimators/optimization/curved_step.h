// Steps of bundle adjustment along curves.

#pragma once

#include "estimators/optimization/observation_blocks.h"
#include "estimators/optimization/reduced_system.h"

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// First-order motion of what cameras are fixed to: it turns by the rotation
// vector [rad] about its center, which moves by the translation.
struct BodyMotion {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

struct CurvedPositions {
  std::vector<Eigen::Vector3d> centers;
  std::vector<Eigen::Vector3d> points;
};

// Where bodies and points go by a step that was found by a linearised problem.
// When a chain of images bends by an angle w, straight lines stretch what is
// far from the held body by w^2 / 2, which is many pixels for some degrees:
// such steps would be rejected. Here neighbours keep to second order the
// positions relative to each other that the linearised problem gives them. For
// bodies i and j with points in common,
//   c_j' - c_i' = exp(w) (d + v_j - v_i - w x d),  d = c_j - c_i,
// where w is the mean of their rotation vectors, in the least-squares sense:
// the links of a graph in which neighbours see the same point. A point moves
// likewise with each body that sees it, and to the mean, weighted by the
// inverse squared distance.
class CurvedStep {
 public:
  // The cameras of the observations are bodies. The held body, and one of each
  // part of the graph without it, keep to their straight lines.
  CurvedStep(ObservationIndex observations, int held_body);

  int HeldBody() const { return held_body_; }

  // points: where they are; point_steps: their straight steps. Nothing if a
  // position is not finite. The same for any number of threads.
  std::optional<CurvedPositions> Move(
      const std::vector<BodyMotion>& motions,
      const std::vector<Eigen::Vector3d>& points,
      const std::vector<Eigen::Vector3d>& point_steps,
      int num_threads);

 private:
  // Bodies that are neighbours at `weight` points.
  struct Link {
    int body1 = 0;
    int body2 = 0;
    double weight = 0;
  };

  static std::vector<Link> FindLinks(const ObservationIndex& observations);
  void AddToLaplacian(int body1, int body2, double value);
  std::optional<std::vector<Eigen::Vector3d>> MoveCenters(
      const std::vector<BodyMotion>& motions);

  const ObservationIndex observations_;
  const int held_body_;
  const PointRanges ranges_;
  const std::vector<Link> links_;
  std::vector<int> held_bodies_;
  ReducedSystem laplacian_;
};

}  // namespace dgsfm
