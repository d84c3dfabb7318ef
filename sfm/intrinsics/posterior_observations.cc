#include "sfm/intrinsics/posterior_observations.h"

#include "colmap_ext/pose_access.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>

namespace dgsfm {

PosteriorObservations::PosteriorObservations(
    double loss_scale_px,
    const std::vector<colmap::image_t>& image_ids,
    const colmap::Reconstruction& model) {
  for (const colmap::image_t image_id : image_ids) {
    const colmap::Image& image = model.Image(image_id);
    const colmap::Camera& camera = model.Camera(image.CameraId());
    const Rigid3d cam_from_world = CamFromWorld(image);
    views_.push_back({&camera,
                      ProjectionOfModel(camera.ModelId()),
                      cam_from_world.rotation.toRotationMatrix(),
                      cam_from_world.translation});
  }
  index.num_cameras = int(image_ids.size());
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const colmap::Point3D& point = model.Point3D(point_id);
    std::vector<Observation> of_point;
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      const auto image = std::lower_bound(
          image_ids.begin(), image_ids.end(), element.image_id);
      if (image == image_ids.end() || *image != element.image_id) continue;
      Observation observation;
      observation.image = int(image - image_ids.begin());
      observation.xy_px =
          model.Image(element.image_id).Point2D(element.point2D_idx).XY();
      if (Weigh(loss_scale_px, point.XYZ(), &observation)) {
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
    points_.push_back(point.XYZ());
    ++index.num_points;
  }
}

bool PosteriorObservations::Project(const Observation& observation,
                                    const Eigen::Vector3d& xyz,
                                    Eigen::Vector3d* rotated,
                                    Eigen::Vector2d* residual_px,
                                    ProjectionJacobian* by) const {
  const View& view = views_[size_t(observation.image)];
  *rotated = view.rotation * xyz;
  if (!view.project(view.camera->ParamsData(),
                    *rotated + view.translation,
                    residual_px,
                    by)) {
    return false;
  }
  *residual_px -= observation.xy_px;
  return true;
}

bool PosteriorObservations::Weigh(double loss_scale_px,
                                  const Eigen::Vector3d& xyz,
                                  Observation* observation) const {
  Eigen::Vector3d rotated;
  Eigen::Vector2d residual_px;
  if (!Project(*observation, xyz, &rotated, &residual_px, nullptr)) {
    return false;
  }
  observation->weight = 1 / std::sqrt(1 + residual_px.squaredNorm() /
                                              (loss_scale_px * loss_scale_px));
  observation->squared_norm =
      (std::sqrt(observation->weight) * residual_px).squaredNorm();
  return true;
}

void PosteriorObservations::Linearize(int k, Elimination::Row* row) const {
  const Observation& observation = observations[size_t(k)];
  const View& view = views_[size_t(observation.image)];
  Eigen::Vector3d rotated;
  ProjectionJacobian by;
  Project(observation,
          points_[size_t(index.points[size_t(k)])],
          &rotated,
          &row->residual,
          &by);
  const double root = std::sqrt(observation.weight);
  row->residual *= root;
  row->by_camera.setZero();
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d by_point = root * by.point.row(i);
    row->by_camera.block<3, 1>(0, i) = rotated.cross(by_point);
    row->by_camera.block<3, 1>(3, i) = by_point;
    row->by_point.col(i) = view.rotation.transpose() * by_point;
  }
  const auto num_params = Eigen::Index(view.camera->NumParams());
  row->by_camera.middleRows(kNumPoseParams, num_params) =
      root * by.params.leftCols(num_params).transpose();
}

}  // namespace dgsfm
