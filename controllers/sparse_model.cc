#include "controllers/sparse_model.h"

#include "colmap_ext/depth/affine_depth.h"
#include "estimators/affine_depth_fit.h"

#include <stdexcept>

namespace dgsfm {

SparseModel ReadSparseModel(const std::string& path) {
  const std::string folder = FindLargestModel(path);
  SparseModel model;
  model.path = folder;
  model.images = ReadModelImages(folder);
  model.cameras = ReadModelCameras(folder);
  for (const ModelPoint& point : ReadModelPoints(folder)) {
    model.points.emplace(point.point3D_id, point.xyz);
  }
  return model;
}

const colmap::Camera& CameraOfImage(const SparseModel& model,
                                    const std::string& image_name) {
  const auto image = model.images.find(image_name);
  if (image == model.images.end()) {
    throw std::runtime_error("image " + image_name + " is not in the model " +
                             model.path);
  }
  const auto camera = model.cameras.find(image->second.camera_id);
  if (camera == model.cameras.end()) {
    throw std::runtime_error("image " + image_name +
                             " has no camera in the model " + model.path);
  }
  return camera->second;
}

std::vector<DepthCorrespondence> FindDepthCorrespondences(
    const SparseModel& model,
    const std::string& image_name,
    const DepthMap& depth_map) {
  const colmap::Camera& camera = CameraOfImage(model, image_name);
  const ModelImage& image = model.images.at(image_name);
  std::vector<Eigen::Vector2d> positions;
  std::vector<double> point_depths;
  for (const ModelObservation& observation : image.observations) {
    const auto point = model.points.find(observation.point3D_id);
    if (point == model.points.end()) continue;
    const double depth = (image.cam_from_world * point->second).z();
    // Points behind the camera have no depth to compare with.
    if (!(depth > 0)) continue;
    positions.push_back(observation.xy);
    point_depths.push_back(depth);
  }
  DepthSamplingOptions sampling;
  // Samples at depth edges may be those of another surface than the point's.
  sampling.keep_edges = false;
  const std::vector<float> map_depths = SampleDepth(
      depth_map, positions, camera.Width(), camera.Height(), sampling);
  std::vector<DepthCorrespondence> correspondences;
  for (size_t i = 0; i < positions.size(); ++i) {
    if (map_depths[i] <= 0) continue;
    correspondences.push_back({positions[i].x() / camera.Width(),
                               positions[i].y() / camera.Height(),
                               map_depths[i],
                               point_depths[i]});
  }
  return correspondences;
}

bool ConvertByPoints(const SparseModel& model,
                     const std::string& image_name,
                     DepthMap* depth_map) {
  const bool is_disparity = depth_map->unit == DepthUnit::AFFINE_DISPARITY;
  std::vector<AffineDepthSample> samples;
  for (const DepthCorrespondence& point :
       FindDepthCorrespondences(model, image_name, *depth_map)) {
    samples.push_back(
        {point.map_depth,
         is_disparity ? 1 / point.point_depth : point.point_depth});
  }
  const AffineDepthFit fit = FitAffineDepth({samples}, AffineDepthFitOptions());
  if (!fit.success) return false;
  ConvertAffine({depth_map->unit, fit.scales[0], fit.shift, 0}, depth_map);
  return true;
}

}  // namespace dgsfm
