#include "sfm/mapping/shared_center.h"

#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "estimators/optimization/ray_intersection.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Share of points without parallax above which a user should hear of it.
constexpr double kMaxShareWithoutParallax = 0.8;
// How much more than expected one centre may cost, over what is expected.
constexpr double kMaxExcessRatio = 2;
// Distance over that of the median point, or the inverse, of stuck points.
constexpr double kMinStuckRatio = 20;
// Centres nearer than this are the same [median distance of points].
constexpr double kMaxSpreadRatio = 1e-6;

// Error of a key point, by which rays without parallax may enclose an angle
// [px].
constexpr double kKeypointErrorPx = 1;

using Rays = std::vector<Eigen::Vector3d>;

// Rays of unit length of a track [world].
Rays RaysOf(const colmap::Reconstruction& model, const colmap::Track& track) {
  Rays rays;
  for (const colmap::TrackElement& element : track.Elements()) {
    rays.push_back(
        CamFromWorld(model.Image(element.image_id)).rotation.conjugate() *
        RayInCam(model, element));
  }
  return rays;
}

Eigen::Vector3d MeanRay(const Rays& rays) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& ray : rays) sum += ray;
  // Rays that cancel belong to no point; the first one is as good as any.
  return sum.norm() > 1e-3 ? Eigen::Vector3d(sum.normalized()) : rays.front();
}

// About the angle between the outermost rays.
double RayAngleDeg(const Rays& rays) {
  const Eigen::Vector3d mean = MeanRay(rays);
  double max_angle_deg = 0;
  for (const Eigen::Vector3d& ray : rays) {
    max_angle_deg = std::max(max_angle_deg, 2 * AngleDeg(mean, ray));
  }
  return max_angle_deg;
}

// Distance of a point by the depth maps that see it; 0 if none does.
double DistanceByDepth(const KeypointDepthMap& depths,
                       const ImageScales& scales,
                       const colmap::Reconstruction& model,
                       const colmap::Point3D& point) {
  std::vector<double> distances;
  for (const colmap::TrackElement& element : point.Track().Elements()) {
    const auto depth = depths.find(element.image_id);
    const auto scale = scales.find(element.image_id);
    if (depth == depths.end() || scale == scales.end()) continue;
    const double z =
        scale->second * depth->second.depths.at(element.point2D_idx);
    const Eigen::Vector3d in_cam =
        CamFromWorld(model.Image(element.image_id)) * point.XYZ();
    if (z > 0 && in_cam.z() > 0) {
      distances.push_back(z * in_cam.norm() / in_cam.z());
    }
  }
  return distances.empty() ? 0 : Median(distances);
}

Eigen::Vector3d MeanCenter(const ImageCenters& centers,
                           const colmap::Track& track) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const colmap::TrackElement& element : track.Elements()) {
    sum += centers.at(element.image_id);
  }
  return sum / double(track.Length());
}

// Points of a model that no two images see under this angle, as share of all.
double ShareWithoutParallax(double min_angle_deg,
                            const colmap::Reconstruction& model) {
  if (model.NumPoints3D() == 0) return 0;
  const ImageCenters centers = CentersOf(model);
  size_t num_without = 0;
  for (const auto& [point_id, point] : model.Points3D()) {
    num_without += !IsTriangulated(point, centers, min_angle_deg * M_PI / 180);
  }
  return double(num_without) / double(model.NumPoints3D());
}

}  // namespace

double MedianRayAngleDeg(const std::vector<colmap::Track>& tracks,
                         const colmap::Reconstruction& model) {
  std::vector<double> angles_deg;
  for (const colmap::Track& track : tracks) {
    angles_deg.push_back(RayAngleDeg(RaysOf(model, track)));
  }
  if (angles_deg.empty()) return std::numeric_limits<double>::infinity();
  const double median_deg = Median(angles_deg);
  VLOG(1) << "Rays of tracks enclose " << median_deg << " deg (median)";
  return median_deg;
}

void PlaceAtOneCenter(const std::vector<colmap::Track>& tracks,
                      colmap::Reconstruction* model) {
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, image] : model->Images()) {
    image_ids.push_back(image_id);
  }
  std::sort(image_ids.begin(), image_ids.end());
  for (const colmap::image_t image_id : image_ids) {
    SetCenterInWorld(Eigen::Vector3d::Zero(), &model->Image(image_id));
    model->RegisterImage(image_id);
  }
  for (const colmap::Track& track : tracks) {
    model->AddPoint3D(MeanRay(RaysOf(*model, track)), track);
  }
}

void MoveToOneCenter(colmap::Reconstruction* model) {
  for (const colmap::image_t image_id : model->RegImageIds()) {
    SetCenterInWorld(Eigen::Vector3d::Zero(), &model->Image(image_id));
  }
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    colmap::Point3D& point = model->Point3D(point_id);
    point.SetXYZ(MeanRay(RaysOf(*model, point.Track())));
  }
}

size_t PlaceAtDepth(const KeypointDepthMap& depths,
                    const ImageScales& scales,
                    colmap::Reconstruction* model) {
  std::vector<double> known;
  std::map<colmap::point3D_t, double> distances;
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const double distance =
        DistanceByDepth(depths, scales, *model, model->Point3D(point_id));
    distances[point_id] = distance;
    if (distance > 0) known.push_back(distance);
  }
  if (known.empty()) return 0;
  const double median = Median(known);
  for (const auto& [point_id, distance] : distances) {
    colmap::Point3D& point = model->Point3D(point_id);
    point.SetXYZ((distance > 0 ? distance : median) * point.XYZ().normalized());
  }
  return known.size();
}

size_t MoveStuckPoints(colmap::Reconstruction* model) {
  const ImageCenters centers = CentersOf(*model);
  std::map<colmap::point3D_t, double> distances;
  std::vector<double> values;
  for (const auto& [point_id, point] : model->Points3D()) {
    const double distance =
        (point.XYZ() - MeanCenter(centers, point.Track())).norm();
    distances[point_id] = distance;
    values.push_back(distance);
  }
  if (values.empty()) return 0;
  const double median = Median(std::move(values));
  size_t num_moved = 0;
  for (const auto& [point_id, distance] : distances) {
    if (distance < kMinStuckRatio * median &&
        distance * kMinStuckRatio > median) {
      continue;
    }
    colmap::Point3D& point = model->Point3D(point_id);
    point.SetXYZ(MeanCenter(centers, point.Track()) +
                 median * MeanRay(RaysOf(*model, point.Track())));
    ++num_moved;
  }
  return num_moved;
}

size_t RemovePointsWithoutDistance(colmap::Reconstruction* model) {
  if (IsAtOneCenter(*model)) return 0;
  const ImageCenters centers = CentersOf(*model);
  size_t num_removed = 0;
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const colmap::Point3D& point = model->Point3D(point_id);
    const colmap::image_t image_id = point.Track().Element(0).image_id;
    const double focal_length_px =
        model->Camera(model->Image(image_id).CameraId()).MeanFocalLength();
    if (IsTriangulated(point, centers, kKeypointErrorPx / focal_length_px)) {
      continue;
    }
    model->DeletePoint3D(point_id);
    ++num_removed;
  }
  return num_removed;
}

bool IsAtOneCenter(const colmap::Reconstruction& model) {
  const ImageCenters centers = CentersOf(model);
  if (centers.size() < 2 || model.NumPoints3D() == 0) return false;
  const Eigen::Vector3d first = centers.begin()->second;
  std::vector<double> distances;
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    distances.push_back((model.Point3D(point_id).XYZ() - first).norm());
  }
  const double max_distance = kMaxSpreadRatio * Median(distances);
  return std::all_of(centers.begin(), centers.end(), [&](const auto& center) {
    return (center.second - first).norm() <= max_distance;
  });
}

double CostOfObservations(const RobustLoss& loss,
                          const colmap::Reconstruction& model) {
  double cost = 0;
  for (const colmap::point3D_t point_id : SortedPoints(model)) {
    const colmap::Point3D& point = model.Point3D(point_id);
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      const Eigen::Vector3d in_cam =
          CamFromWorld(model.Image(element.image_id)) * point.XYZ();
      const double error_px = ReprojectionError(model, element, in_cam);
      cost += loss.Cost(error_px * error_px);
    }
  }
  return cost;
}

bool IsExplainedByRotations(double cost_of_one_center,
                            double cost_of_free_centers,
                            const colmap::Reconstruction& model) {
  const double num_images = double(model.NumRegImages());
  const double num_points = double(model.NumPoints3D());
  const double redundancy = 2 * double(model.ComputeNumObservations()) -
                            3 * num_points - 6 * num_images;
  if (!(redundancy > 0)) return true;
  // Parameters that free centres add: these, and distances of points.
  const double expected_excess = (num_points + 3 * num_images) / redundancy;
  return cost_of_one_center <=
         (1 + kMaxExcessRatio * expected_excess) * cost_of_free_centers;
}

std::optional<std::string> ParallaxAdvice(double min_angle_deg,
                                          const colmap::Reconstruction& model) {
  if (IsAtOneCenter(model)) {
    return "The " + std::to_string(model.NumRegImages()) +
           " images of a model turn without moving, as far as their matches "
           "show: they share one centre. Rotations and focal lengths are "
           "measured, distances of points are those of depth maps or, without "
           "any, arbitrary. Positions need images from other places";
  }
  const double share = ShareWithoutParallax(min_angle_deg, model);
  if (share <= kMaxShareWithoutParallax) return std::nullopt;
  return std::to_string(std::lround(100 * share)) +
         " % of the points of a model with " +
         std::to_string(model.NumRegImages()) +
         " images are seen from less than " +
         std::to_string(std::lround(min_angle_deg * 10) / 10) + "." +
         std::to_string(std::lround(min_angle_deg * 10) % 10) +
         " degrees apart: the images turn more than they move, and positions "
         "are far less certain than rotations. Images from places farther "
         "apart help";
}

}  // namespace dgsfm
