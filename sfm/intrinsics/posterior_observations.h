// The observations that an intrinsics posterior rests on.

#pragma once

#include "estimators/optimization/point_elimination.h"
#include "sfm/intrinsics/posterior_columns.h"

#include <vector>

namespace dgsfm {

class PosteriorObservations {
 public:
  using Elimination = PointElimination<2, kNumPoseParams + kMaxNumCameraParams>;

  struct Observation {
    int image = 0;
    colmap::point2D_t point2D_idx = 0;
    // Weight by the soft L1 loss.
    double weight = 1;
    // Squared norm of the residual times its weight.
    double squared_norm = 0;
  };

  // Those of the images that the camera models can project, of points with two
  // or more. The images, in increasing order, and the model must outlive this.
  PosteriorObservations(double loss_scale_px,
                        const std::vector<colmap::image_t>& image_ids,
                        const colmap::Reconstruction& model);

  // The residual, whitened by its weight.
  void Linearize(int k, Elimination::Row* row) const;

  const colmap::Image& ImageOf(int image) const {
    return model_.Image(image_ids_[size_t(image)]);
  }
  const colmap::Camera& CameraOf(int image) const {
    return model_.Camera(ImageOf(image).CameraId());
  }

  ObservationIndex index;
  std::vector<Observation> observations;

 private:
  bool Project(const Observation& observation,
               Eigen::Vector3d* rotated,
               Eigen::Vector2d* residual_px,
               ProjectionJacobian* by) const;
  bool Weigh(double loss_scale_px, Observation* observation) const;

  const std::vector<colmap::image_t>& image_ids_;
  const colmap::Reconstruction& model_;
};

}  // namespace dgsfm
