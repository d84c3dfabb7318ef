// The observations that an intrinsics posterior rests on.

#pragma once

#include "estimators/optimization/camera_projection.h"
#include "estimators/optimization/point_elimination.h"
#include "sfm/intrinsics/posterior_columns.h"

#include <vector>

namespace dgsfm {

class PosteriorObservations {
 public:
  using Elimination = PointElimination<2, kNumPoseParams + kMaxNumCameraParams>;

  struct Observation {
    int image = 0;
    Eigen::Vector2d xy_px = Eigen::Vector2d::Zero();
    // Weight by the soft L1 loss.
    double weight = 1;
    // Squared norm of the residual times its weight.
    double squared_norm = 0;
  };

  // Those of the images that the camera models can project, of points with two
  // or more. The images are in increasing order; the model must outlive this.
  PosteriorObservations(double loss_scale_px,
                        const std::vector<colmap::image_t>& image_ids,
                        const colmap::Reconstruction& model);

  // The residual, whitened by its weight.
  void Linearize(int k, Elimination::Row* row) const;

  const colmap::Camera& CameraOf(int image) const {
    return *views_[size_t(image)].camera;
  }

  ObservationIndex index;
  std::vector<Observation> observations;

 private:
  // What observations of an image have in common.
  struct View {
    const colmap::Camera* camera = nullptr;
    ProjectionFunction project = nullptr;
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;
  };

  // Where the point is in the frame of the camera before its translation, and
  // the residual, with derivatives.
  bool Project(const Observation& observation,
               const Eigen::Vector3d& xyz,
               Eigen::Vector3d* rotated,
               Eigen::Vector2d* residual_px,
               ProjectionJacobian* by) const;
  // False if the camera model cannot project the point.
  bool Weigh(double loss_scale_px,
             const Eigen::Vector3d& xyz,
             Observation* observation) const;

  std::vector<View> views_;
  std::vector<Eigen::Vector3d> points_;
};

}  // namespace dgsfm
