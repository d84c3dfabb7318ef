#include "sfm/mapping/metric_scale.h"

#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "sfm/mapping/model_access.h"

#include <colmap/base/similarity_transform.h>

#include <cmath>
#include <vector>

#include <Eigen/Geometry>

namespace dgsfm {

namespace {

// Points below which the depth scale of an image is not measured.
constexpr size_t kMinNumDepthsPerImage = 10;
// Spread of log scales beyond which maps give no unit. Sound maps of sensors
// and networks have 0.01 to 0.3, maps of other images more.
constexpr double kMaxLogScaleSpread = 0.35;

}  // namespace

std::map<colmap::image_t, DepthScale> DepthScalesOfModel(
    const KeypointDepthMap& depths, const colmap::Reconstruction& model) {
  std::map<colmap::image_t, DepthScale> scales;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const auto it = depths.find(image_id);
    if (it == depths.end()) continue;
    const colmap::Image& image = model.Image(image_id);
    const Rigid3d cam_from_world = CamFromWorld(image);
    std::vector<double> log_ratios;
    for (size_t i = 0; i < image.NumPoints2D(); ++i) {
      const colmap::Point2D& point2D = image.Point2D(i);
      const double prior_depth = it->second.depths[i];
      if (!point2D.HasPoint3D() || !(prior_depth > 0)) continue;
      const double depth =
          (cam_from_world * model.Point3D(point2D.Point3DId()).XYZ()).z();
      if (depth > 0) log_ratios.push_back(std::log(depth / prior_depth));
    }
    if (log_ratios.size() >= kMinNumDepthsPerImage) {
      const double median = Median(log_ratios);
      scales[image_id] = {std::exp(median), RobustStddev(log_ratios, median)};
    }
  }
  return scales;
}

ImageCenters CentersOf(const colmap::Reconstruction& model) {
  ImageCenters centers;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    centers[image_id] =
        CamFromWorld(model.Image(image_id)).TargetOriginInSource();
  }
  return centers;
}

std::string ModelUnitName(ModelUnit unit) {
  switch (unit) {
    case ModelUnit::ARBITRARY:
      return "arbitrary";
    case ModelUnit::DEPTH_MAPS:
      return "depth_maps";
    case ModelUnit::METRES:
      return "metres";
    case ModelUnit::RIGS:
      return "rigs";
  }
  return "unknown";
}

bool MeasuredUnit::IsDoubtful() const {
  return log_spread > kMaxLogScaleSpread;
}

MeasuredUnit UnitOfModel(const KeypointDepthMap& depths,
                         const std::map<colmap::image_t, double>& depth_scales,
                         const colmap::Reconstruction& model) {
  MeasuredUnit result;
  std::vector<double> log_scales, metric_log_scales;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    const auto scale = depth_scales.find(image_id);
    if (scale == depth_scales.end()) continue;
    log_scales.push_back(std::log(scale->second));
    if (depths.at(image_id).unit == DepthUnit::METRIC) {
      metric_log_scales.push_back(log_scales.back());
    }
  }
  if (log_scales.empty()) return result;
  result.is_metric = !metric_log_scales.empty();
  if (result.is_metric) log_scales = std::move(metric_log_scales);
  result.num_images = log_scales.size();
  result.log_scale = Median(log_scales);
  result.log_spread = RobustStddev(log_scales, result.log_scale);
  result.unit = result.is_metric && !result.IsDoubtful()
                    ? ModelUnit::METRES
                    : ModelUnit::DEPTH_MAPS;
  return result;
}

MeasuredUnit UnitOfModel(const KeypointDepthMap& depths,
                         const colmap::Reconstruction& model) {
  std::map<colmap::image_t, double> scales;
  for (const auto& [image_id, scale] : DepthScalesOfModel(depths, model)) {
    scales[image_id] = scale.scale;
  }
  return UnitOfModel(depths, scales, model);
}

MeasuredUnit NormalizeToDepth(const KeypointDepthMap& depths,
                              colmap::Reconstruction* model) {
  const MeasuredUnit unit = UnitOfModel(depths, *model);
  if (unit.num_images == 0) return unit;
  model->Transform(colmap::SimilarityTransform3(std::exp(-unit.log_scale),
                                                Eigen::Vector4d(1, 0, 0, 0),
                                                Eigen::Vector3d::Zero()));
  return unit;
}

}  // namespace dgsfm
