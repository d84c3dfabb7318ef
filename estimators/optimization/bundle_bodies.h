// What moves by itself in a bundle, and how it takes steps.

#pragma once

#include "estimators/optimization/bundle_solver.h"
#include "estimators/optimization/curved_step.h"

#include <array>
#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Rotation vector w [rad] and shift d of a pose (R, t), which moves to
// (exp(w) R, exp(w) (t - p) + p + d) with a pivot p.
using PoseStep = Eigen::Matrix<double, 6, 1>;

void MovePose(const PoseStep& step,
              const Eigen::Vector3d& pivot,
              Rigid3d* pose);

// The pivot of an image or a frame: its centre where steps are curved, else the
// origin of the world.
Eigen::Vector3d BodyPivot(const Bundle& bundle, const Rigid3d& pose);

// Bodies are the frames of a bundle, and behind them the images that belong to
// none. Curved steps take the gauge of AdjustBundle: one body is held, and at
// most one component of the shift of another. Prior centres have no such gauge:
// these hold chains, which do not bend far.
class BundleBodies {
 public:
  // The bundle must outlive this.
  BundleBodies(const ObservationIndex& observations, Bundle* bundle);

  size_t Count() const { return bundle_->frames.size() + free_images_.size(); }

  // Moves bodies and points, but no sensors, nor the images of frames.
  void Move(const std::vector<PoseStep>& steps,
            const std::vector<Eigen::Vector3d>& point_steps,
            int num_threads);

 private:
  // A coordinate of a body's translation.
  struct Coordinate {
    int body = 0;
    int index = 0;
  };

  void PrepareCurvedStep(const ObservationIndex& observations,
                         const std::vector<int>& body_of_image);
  BundleImage& FreeImage(size_t body) const {
    return bundle_->images[free_images_[body - bundle_->frames.size()]];
  }
  Rigid3d& PoseOf(size_t body) const;
  const std::array<bool, 6>& HeldComponentsOf(size_t body) const;
  std::optional<double> ScaleCoordinate() const;
  bool HoldScale(double coordinate, CurvedPositions* positions) const;
  void MoveTo(const CurvedPositions& positions);

  Bundle* bundle_;
  std::vector<int> free_images_;
  // What fixes the scale, if anything does.
  std::optional<Coordinate> scale_gauge_;
  // Empty where steps are straight.
  std::optional<CurvedStep> curved_step_;
};

}  // namespace dgsfm
