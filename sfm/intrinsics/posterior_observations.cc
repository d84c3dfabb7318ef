#include "sfm/intrinsics/posterior_observations.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

PosteriorObservations::PosteriorObservations(
    double loss_scale_px,
    const std::vector<colmap::image_t>& image_ids,
    const colmap::Reconstruction& model)
    : image_ids_(image_ids), model_(model) {
  index.num_cameras = int(image_ids_.size());
  for (const colmap::point3D_t point_id : SortedPoints(model_)) {
    std::vector<Observation> of_point;
    for (const colmap::TrackElement& element :
         model_.Point3D(point_id).Track().Elements()) {
      const auto image = std::lower_bound(
          image_ids_.begin(), image_ids_.end(), element.image_id);
      Observation observation;
      observation.image = int(image - image_ids_.begin());
      observation.point2D_idx = element.point2D_idx;
      if (image != image_ids_.end() && *image == element.image_id &&
          Weigh(loss_scale_px, &observation)) {
        of_point.push_back(observation);
      }
    }
    if (of_point.size() < 2) continue;
    std::stable_sort(
        of_point.begin(), of_point.end(), [](const auto& a, const auto& b) {
          return a.image < b.image;
        });
    for (const Observation& observation : of_point) {
      index.cameras.push_back(observation.image);
      index.points.push_back(index.num_points);
      observations.push_back(observation);
    }
    ++index.num_points;
  }
}

// The point of the observation in the frame of its camera before the
// translation, and where it is seen, with derivatives.
bool PosteriorObservations::Project(const Observation& observation,
                                    Eigen::Vector3d* rotated,
                                    Eigen::Vector2d* residual_px,
                                    ProjectionJacobian* by) const {
  const colmap::Image& image = ImageOf(observation.image);
  const colmap::Camera& camera = model_.Camera(image.CameraId());
  const colmap::Point2D& point2D = image.Point2D(observation.point2D_idx);
  const Rigid3d cam_from_world = CamFromWorld(image);
  *rotated =
      cam_from_world.rotation * model_.Point3D(point2D.Point3DId()).XYZ();
  if (!ProjectionOfModel(camera.ModelId())(
          camera.ParamsData(),
          *rotated + cam_from_world.translation,
          residual_px,
          by)) {
    return false;
  }
  *residual_px -= point2D.XY();
  return true;
}

// False if the camera model cannot project the point.
bool PosteriorObservations::Weigh(double loss_scale_px,
                                  Observation* observation) const {
  Eigen::Vector3d rotated;
  Eigen::Vector2d residual_px;
  ProjectionJacobian by;
  if (!Project(*observation, &rotated, &residual_px, &by)) return false;
  observation->weight = 1 / std::sqrt(1 + residual_px.squaredNorm() /
                                              (loss_scale_px * loss_scale_px));
  observation->squared_norm =
      (std::sqrt(observation->weight) * residual_px).squaredNorm();
  return true;
}

void PosteriorObservations::Linearize(int k, Elimination::Row* row) const {
  const Observation& observation = observations[size_t(k)];
  Eigen::Vector3d rotated;
  ProjectionJacobian by;
  Project(observation, &rotated, &row->residual, &by);
  const double root = std::sqrt(observation.weight);
  row->residual *= root;
  row->by_camera.setZero();
  const Rigid3d cam_from_world = CamFromWorld(ImageOf(observation.image));
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d by_point = root * by.point.row(i);
    row->by_camera.block<3, 1>(0, i) = rotated.cross(by_point);
    row->by_camera.block<3, 1>(3, i) = by_point;
    row->by_point.col(i) = cam_from_world.rotation.conjugate() * by_point;
  }
  const auto num_params = Eigen::Index(CameraOf(observation.image).NumParams());
  row->by_camera.middleRows(kNumPoseParams, num_params) =
      root * by.params.leftCols(num_params).transpose();
}

}  // namespace dgsfm
