#include "sfm/mapping/model_refinement.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/option_check.h"
#include "estimators/two_view/two_view_model.h"
#include "estimators/two_view/two_view_residuals.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/mapping/model_access.h"
#include "sfm/verification/centered_point.h"

#include <colmap/base/triangulation.h>
#include <colmap/sfm/incremental_triangulator.h>

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

Eigen::Vector3d RayInCam(const colmap::Reconstruction& model,
                         const colmap::TrackElement& element) {
  const colmap::Image& image = model.Image(element.image_id);
  return model.Camera(image.CameraId())
      .ImageToWorld(image.Point2D(element.point2D_idx).XY())
      .homogeneous()
      .normalized();
}

// Does nothing where the depth is unknown.
void SetLogDistance(double distance,
                    double log_stddev,
                    PositioningObservation* observation) {
  if (!(distance > 0)) return;
  observation->log_distance = std::log(distance);
  observation->log_distance_stddev = log_stddev;
}

// Whether two rays of the point enclose at least min_angle [rad].
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

// Matches whose Sampson error under the poses of the model is small, each
// feature at most once, as COLMAP's correspondence graph wants them.
colmap::FeatureMatches MatchesOnEpipolarLines(
    const colmap::Reconstruction& model,
    colmap::image_t image_id1,
    colmap::image_t image_id2,
    const colmap::FeatureMatches& matches,
    double max_error_px) {
  const colmap::Image& image1 = model.Image(image_id1);
  const colmap::Image& image2 = model.Image(image_id2);
  const colmap::Camera& camera1 = model.Camera(image1.CameraId());
  const colmap::Camera& camera2 = model.Camera(image2.CameraId());
  const Rigid3d cam2_from_cam1 =
      CamFromWorld(image2) * CamFromWorld(image1).Inverse();
  TwoViewModel two_view;
  two_view.rotation = cam2_from_cam1.rotation.toRotationMatrix();
  two_view.translation = cam2_from_cam1.translation;
  two_view.focal1 = camera1.MeanFocalLength();
  two_view.focal2 = camera2.MeanFocalLength();
  const Eigen::Matrix3d F = two_view.FundamentalMatrix();
  colmap::FeatureMatches consistent;
  std::vector<bool> is_used1(image1.NumPoints2D(), false);
  std::vector<bool> is_used2(image2.NumPoints2D(), false);
  for (const colmap::FeatureMatch& match : matches) {
    const auto point1 =
        UndistortPoint(camera1, image1.Point2D(match.point2D_idx1).XY());
    const auto point2 =
        UndistortPoint(camera2, image2.Point2D(match.point2D_idx2).XY());
    if (point1 && point2 &&
        std::abs(SampsonError(F,
                              point1->point,
                              point2->point,
                              UndistortedCovariance(point1->pixel_jacobian),
                              UndistortedCovariance(point2->pixel_jacobian))) <=
            max_error_px &&
        !is_used1[match.point2D_idx1] && !is_used2[match.point2D_idx2]) {
      is_used1[match.point2D_idx1] = true;
      is_used2[match.point2D_idx2] = true;
      consistent.push_back(match);
    }
  }
  return consistent;
}

// Agreement with epipolar lines does not bring back look-alikes that an
// imported score excluded or that are displaced along the baseline.
bool StaysOut(PairStatus status) {
  return status == PairStatus::LOW_PAIR_SCORE ||
         status == PairStatus::TRANSLATION_OUTLIER;
}

}  // namespace

bool ModelRefinementOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Valid(global_positioning)
      .Valid(bundle_adjustment)
      .Above("max_angular_error_deg", max_angular_error_deg, 0)
      .Above("max_reprojection_error_px", max_reprojection_error_px, 0)
      .Above("max_epipolar_error_px", max_epipolar_error_px, 0)
      .Above("max_completion_error_px", max_completion_error_px, 0)
      .AtLeast("num_bundle_adjustment_rounds", num_bundle_adjustment_rounds, 0)
      .AtLeast("min_triangulation_angle_deg", min_triangulation_angle_deg, 0)
      .AtLeast(
          "min_num_triangulated_per_image", min_num_triangulated_per_image, 0)
      .AtLeast("min_num_points_per_image", min_num_points_per_image, 3)
      .AreKept();
}

GlobalPositioningSummary PositionCameras(const ModelRefinementOptions& options,
                                         const DepthPriors& priors,
                                         colmap::image_t fixed_image,
                                         colmap::Reconstruction* model) {
  const ImageIndex index(SortedRegisteredImages(*model));
  const std::vector<colmap::point3D_t> point_ids = SortedPoints(*model);
  std::vector<Eigen::Vector3d> centers;
  for (int i = 0; i < index.Size(); ++i) {
    centers.push_back(
        CamFromWorld(model->Image(index.IdOf(i))).TargetOriginInSource());
  }
  DepthPriors needed;
  std::map<colmap::image_t, DepthScale> scales;
  if (options.global_positioning.use_depth) {
    needed = PriorsInNeed(options, *model, priors);
    if (!needed.stddevs.empty()) {
      scales = DepthScalesOfModel(*priors.depths, *model);
    }
  }
  std::vector<Eigen::Vector3d> points;
  std::vector<PositioningObservation> observations;
  for (const colmap::point3D_t point_id : point_ids) {
    const colmap::Point3D& point = model->Point3D(point_id);
    for (const colmap::TrackElement& element : point.Track().Elements()) {
      PositioningObservation observation;
      observation.camera = index.Of(element.image_id);
      observation.point = int(points.size());
      const Eigen::Vector3d ray_in_cam = RayInCam(*model, element);
      observation.ray_in_world =
          CamFromWorld(model->Image(element.image_id)).rotation.conjugate() *
          ray_in_cam;
      const auto scale = scales.find(element.image_id);
      if (needed.Has(element.image_id) && scale != scales.end()) {
        SetLogDistance(scale->second.scale *
                           priors.depths->at(element.image_id)
                               .depths[element.point2D_idx] /
                           ray_in_cam.z(),
                       needed.stddevs.at(element.image_id),
                       &observation);
      }
      observations.push_back(observation);
    }
    points.push_back(point.XYZ());
  }
  GlobalPositioningOptions positioning = options.global_positioning;
  positioning.num_threads = EffectiveNumThreads(options.num_threads);
  const GlobalPositioningSummary summary = SolveGlobalPositioning(
      observations, index.Of(fixed_image), positioning, &centers, &points);
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

DepthPriors PriorsInNeed(const ModelRefinementOptions& options,
                         const colmap::Reconstruction& model,
                         const DepthPriors& priors) {
  DepthPriors needed = {priors.depths, {}};
  for (const auto& [image_id, num_points] :
       Triangulation(options, model).num_points) {
    const auto it = priors.stddevs.find(image_id);
    if (num_points < options.min_num_triangulated_per_image &&
        it != priors.stddevs.end()) {
      needed.stddevs.insert(*it);
    }
  }
  return needed;
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

void BuildCorrespondenceGraph(const Scene& scene,
                              const PairGeometries& pairs,
                              const PairVerificationOptions& verification,
                              double max_epipolar_error_px,
                              const colmap::Reconstruction& model,
                              colmap::CorrespondenceGraph* graph) {
  for (const auto& [image_id, image] : model.Images()) {
    graph->AddImage(image_id, image.NumPoints2D());
  }
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto pair = pairs.find(pair_id);
    if (!model.ExistsImage(image_id1) || !model.ExistsImage(image_id2) ||
        !model.IsImageRegistered(image_id1) ||
        !model.IsImageRegistered(image_id2) ||
        (pair != pairs.end() && StaysOut(pair->second.status))) {
      continue;
    }
    const colmap::FeatureMatches consistent = MatchesOnEpipolarLines(
        model, image_id1, image_id2, matches, max_epipolar_error_px);
    if (double(consistent.size()) >=
        std::max<double>(
            verification.min_num_inliers,
            verification.min_inlier_ratio * double(matches.size()))) {
      graph->AddCorrespondences(image_id1, image_id2, consistent);
    }
  }
}

size_t Retriangulate(const ModelRefinementOptions& options,
                     const colmap::CorrespondenceGraph& graph,
                     colmap::Reconstruction* model) {
  colmap::IncrementalTriangulator::Options triangulation;
  triangulation.complete_max_reproj_error = options.max_completion_error_px;
  triangulation.merge_max_reproj_error = options.max_completion_error_px;
  triangulation.min_angle = std::max(options.min_triangulation_angle_deg, 1e-3);
  colmap::IncrementalTriangulator triangulator(&graph, model);
  const size_t num_before = model->ComputeNumObservations();
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    ThrowIfCancelled();
    triangulator.TriangulateImage(triangulation, image_id);
  }
  triangulator.CompleteAllTracks(triangulation);
  triangulator.MergeAllTracks(triangulation);
  return model->ComputeNumObservations() - num_before;
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
    const ModelRefinementOptions& options, colmap::Reconstruction* model) {
  std::map<colmap::image_t, std::string> filtered;
  const std::set<colmap::camera_t> implausible = ImplausibleCameras(*model);
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    const colmap::Image& image = model->Image(image_id);
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
