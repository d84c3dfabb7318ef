#include "sfm/mapping/model_refinement.h"

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/option_check.h"
#include "sfm/mapping/model_access.h"

#include <colmap/base/triangulation.h>

#include <algorithm>
#include <cmath>
#include <unordered_set>

namespace dgsfm {

namespace {

// Focal lengths and distortions beyond these are not real cameras (COLMAP's
// bounds for bogus parameters).
constexpr double kMinFocalLengthRatio = 0.1;
constexpr double kMaxFocalLengthRatio = 10.0;
constexpr double kMaxExtraParam = 1.0;

// Error of a ray by rotations and key points, which positions of images are
// weighed against [sine of angle].
constexpr double kRayStddev = 0.005;

// Points whose rays enclose a large enough angle, of each image, and the other
// points.
struct Triangulation {
  std::map<colmap::image_t, int> num_points;
  std::unordered_set<colmap::point3D_t> other_ids;

  Triangulation(const ModelRefinementOptions& options,
                const colmap::Reconstruction& model) {
    const double min_angle = options.min_triangulation_angle_deg * M_PI / 180;
    const ImageCenters centers = CentersOf(model);
    for (const auto& [image_id, center] : centers) num_points[image_id] = 0;
    for (const auto& [point_id, point] : model.Points3D()) {
      if (!IsTriangulated(point, centers, min_angle)) {
        other_ids.insert(point_id);
        continue;
      }
      for (const colmap::TrackElement& element : point.Track().Elements()) {
        ++num_points[element.image_id];
      }
    }
  }
};

// Points with a small triangulation angle whose images all see enough others.
std::unordered_set<colmap::point3D_t> DispensablePoints(
    const ModelRefinementOptions& options,
    const colmap::Reconstruction& model) {
  const Triangulation triangulation(options, model);
  std::unordered_set<colmap::point3D_t> point_ids;
  for (const colmap::point3D_t point_id : triangulation.other_ids) {
    const auto& elements = model.Point3D(point_id).Track().Elements();
    const bool is_needed =
        std::any_of(elements.begin(),
                    elements.end(),
                    [&](const colmap::TrackElement& element) {
                      return triangulation.num_points.at(element.image_id) <
                             options.min_num_triangulated_per_image;
                    });
    if (!is_needed) point_ids.insert(point_id);
  }
  return point_ids;
}

// The first image of each image's frame, by index; nothing without frames.
std::vector<int> BodiesOf(const ImageIndex& index, const FrameMembers& frames) {
  std::vector<int> bodies;
  if (frames.empty()) return bodies;
  std::map<frame_t, int> first_of_frames;
  for (int i = 0; i < index.Size(); ++i) {
    const auto member = frames.find(index.IdOf(i));
    bodies.push_back(member == frames.end()
                         ? i
                         : first_of_frames.emplace(member->second.frame_id, i)
                               .first->second);
  }
  return bodies;
}

PositioningPriors PriorsOf(const CenterPriors& center_priors,
                           const ImageIndex& index) {
  PositioningPriors priors;
  if (center_priors.centers.empty()) return priors;
  priors.weight = {kRayStddev, center_priors.loss_scale};
  priors.centers.resize(index.Size());
  for (const auto& [image_id, prior] : center_priors.centers) {
    priors.centers.at(index.Of(image_id)) = prior;
  }
  return priors;
}

// Frames that an image with enough points gives a pose.
std::set<frame_t> FramesWithPoints(const ModelRefinementOptions& options,
                                   const FrameMembers& frames,
                                   const colmap::Reconstruction& model) {
  std::set<frame_t> frame_ids;
  for (const auto& [image_id, member] : frames) {
    if (IsRegistered(model, image_id) &&
        model.Image(image_id).NumPoints3D() >=
            size_t(options.min_num_points_per_image)) {
      frame_ids.insert(member.frame_id);
    }
  }
  return frame_ids;
}

}  // namespace

bool IsTriangulated(const colmap::Point3D& point,
                    const ImageCenters& centers,
                    double min_angle) {
  const std::vector<colmap::TrackElement>& elements = point.Track().Elements();
  for (size_t i = 0; i < elements.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      if (colmap::CalculateTriangulationAngle(centers.at(elements[i].image_id),
                                              centers.at(elements[j].image_id),
                                              point.XYZ()) >= min_angle) {
        return true;
      }
    }
  }
  return false;
}

bool ModelRefinementOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(global_positioning)
      .Valid(bundle_adjustment)
      .Above("max_angular_error", max_angular_error_deg, 0)
      .Above("max_reprojection_error", max_reprojection_error_px, 0)
      .Above("tri_max_epipolar_error", max_epipolar_error_px, 0)
      .Above("max_completion_error", max_completion_error_px, 0)
      .AtLeast(
          "max_neighbor_distance_ratio",
          max_neighbor_distance_ratio == 0 ? 1 : max_neighbor_distance_ratio,
          1)
      .AtLeast("num_bundle_adjustment_rounds", num_bundle_adjustment_rounds, 0)
      .AtLeast("min_triangulation_angle", min_triangulation_angle_deg, 0)
      .AtLeast(
          "min_num_triangulated_per_image", min_num_triangulated_per_image, 0)
      .AtLeast("min_num_points_per_image", min_num_points_per_image, 3)
      .AreKept();
}

GlobalPositioningSummary PositionCameras(
    const GlobalPositioningOptions& options,
    int num_threads,
    colmap::image_t fixed_image,
    colmap::Reconstruction* model,
    const FrameMembers& frames,
    const CenterPriors& center_priors) {
  const std::vector<colmap::image_t> image_ids = SortedRegisteredImages(*model);
  const ImageIndex index(image_ids);
  const std::vector<colmap::point3D_t> point_ids = SortedPoints(*model);
  std::vector<Eigen::Vector3d> centers;
  for (int i = 0; i < index.Size(); ++i) {
    centers.push_back(
        CamFromWorld(model->Image(index.IdOf(i))).TargetOriginInSource());
  }
  std::vector<Eigen::Vector3d> points;
  std::vector<PositioningObservation> observations;
  observations.reserve(model->ComputeNumObservations());
  for (const colmap::point3D_t point_id : point_ids) {
    const colmap::Point3D& point = model->Point3D(point_id);
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      PositioningObservation observation;
      observation.camera = index.Of(element.image_id);
      observation.point = int(points.size());
      observation.ray_in_world =
          CamFromWorld(model->Image(element.image_id)).rotation.conjugate() *
          RayInCam(*model, element);
      observations.push_back(observation);
    }
    points.push_back(point.XYZ());
  }
  GlobalPositioningOptions positioning = options;
  positioning.num_threads = EffectiveNumThreads(num_threads);
  const GlobalPositioningSummary summary = SolveGlobalPositioning(
      std::move(observations),
      index.Of(fixed_image),
      positioning,
      &centers,
      &points,
      {BodiesOf(index, frames), HasBaseline(frames, image_ids)},
      PriorsOf(center_priors, index));
  if (!summary.success) return summary;
  for (int i = 0; i < index.Size(); ++i) {
    SetCenterInWorld(centers[i], &model->Image(index.IdOf(i)));
  }
  for (size_t i = 0; i < point_ids.size(); ++i) {
    model->Point3D(point_ids[i]).SetXYZ(points[i]);
  }
  return summary;
}

size_t FilterObservationsByAngle(double max_angle_deg,
                                 colmap::Reconstruction* model) {
  const double min_cosine = std::cos(max_angle_deg * M_PI / 180);
  size_t num_filtered = 0;
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const colmap::Point3D& point = model->Point3D(point_id);
    std::vector<colmap::TrackElement> outliers;
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      const Eigen::Vector3d point_in_cam =
          CamFromWorld(model->Image(element.image_id)) * point.XYZ();
      if (!(RayInCam(*model, element).dot(point_in_cam) >=
            min_cosine * point_in_cam.norm())) {
        outliers.push_back(element);
      }
    }
    num_filtered += outliers.size();
    if (outliers.size() + 1 >= point.Track().Length()) {
      model->DeletePoint3D(point_id);
      continue;
    }
    for (const colmap::TrackElement& element : outliers) {
      model->DeleteObservation(element.image_id, element.point2D_idx);
    }
  }
  return num_filtered;
}

size_t FilterObservations(const ModelRefinementOptions& options,
                          double error_factor,
                          colmap::Reconstruction* model) {
  const double max_error_px = error_factor * options.max_reprojection_error_px;
  size_t num_filtered = model->FilterObservationsWithNegativeDepth();
  num_filtered += model->FilterAllPoints3D(max_error_px, /*min_tri_angle=*/0);
  num_filtered += model->FilterPoints3D(max_error_px,
                                        options.min_triangulation_angle_deg,
                                        DispensablePoints(options, *model));
  return num_filtered;
}

std::set<colmap::camera_t> ImplausibleCameras(
    const colmap::Reconstruction& model) {
  std::set<colmap::camera_t> implausible;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    if (model.Camera(camera_id).HasBogusParams(
            kMinFocalLengthRatio, kMaxFocalLengthRatio, kMaxExtraParam)) {
      implausible.insert(camera_id);
    }
  }
  return implausible;
}

std::map<colmap::image_t, std::string> FilterImages(
    const ModelRefinementOptions& options,
    const FrameMembers& frames,
    colmap::Reconstruction* model) {
  std::map<colmap::image_t, std::string> filtered;
  const std::set<frame_t> with_points =
      FramesWithPoints(options, frames, *model);
  const std::set<colmap::camera_t> implausible = ImplausibleCameras(*model);
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    const colmap::Image& image = model->Image(image_id);
    const auto member = frames.find(image_id);
    if (member != frames.end() &&
        with_points.count(member->second.frame_id) > 0) {
      continue;
    }
    if (image.NumPoints3D() < size_t(options.min_num_points_per_image)) {
      filtered[image_id] = "only " + std::to_string(image.NumPoints3D()) +
                           " points after bundle adjustment";
    } else if (implausible.count(image.CameraId()) > 0) {
      filtered[image_id] = "implausible intrinsics after bundle adjustment";
    }
  }
  for (const auto& [image_id, reason] : filtered) {
    model->DeRegisterImage(image_id);
  }
  return filtered;
}

void UpdatePointErrors(colmap::Reconstruction* model) {
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    colmap::Point3D& point = model->Point3D(point_id);
    double sum = 0;
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      sum += ReprojectionError(
          *model,
          element,
          CamFromWorld(model->Image(element.image_id)) * point.XYZ());
    }
    point.SetError(sum / double(point.Track().Length()));
  }
}

}  // namespace dgsfm
