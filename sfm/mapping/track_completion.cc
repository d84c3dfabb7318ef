#include "sfm/mapping/track_completion.h"

#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "estimators/optimization/ray_intersection.h"
#include "sfm/mapping/model_access.h"

#include <optional>
#include <utility>

namespace dgsfm {

namespace {

// Factor of the error up to which elements belong to a point: points are not
// adjusted yet.
constexpr double kErrorFactor = 2;
// Tracks that a thread goes through at a time.
constexpr size_t kNumTracksPerItem = 1000;

// What a track adds to a model.
struct Addition {
  // Kept as it is, or invalid: a new point.
  colmap::point3D_t point_id = colmap::kInvalidPoint3DId;
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  std::vector<colmap::TrackElement> elements;
};

std::vector<colmap::TrackElement> ElementsAtPoint(
    const std::vector<colmap::TrackElement>& elements,
    const Eigen::Vector3d& xyz,
    double max_error_px,
    const colmap::Reconstruction& model) {
  std::vector<colmap::TrackElement> kept;
  for (const colmap::TrackElement& element : elements) {
    if (IsAtProjection(model, element, xyz, max_error_px)) {
      kept.push_back(element);
    }
  }
  return kept;
}

std::optional<Eigen::Vector3d> Triangulate(
    const std::vector<colmap::TrackElement>& elements,
    double min_angle_deg,
    const colmap::Reconstruction& model) {
  std::vector<Eigen::Vector3d> centers, rays;
  for (const colmap::TrackElement& element : elements) {
    const Rigid3d cam_from_world = CamFromWorld(model.Image(element.image_id));
    centers.push_back(cam_from_world.TargetOriginInSource());
    rays.push_back(cam_from_world.rotation.conjugate() *
                   RayInCam(model, element));
  }
  return TriangulateRays(centers, rays, min_angle_deg);
}

// Nothing to add has no elements.
Addition AdditionBy(const colmap::Track& track,
                    const ModelRefinementOptions& options,
                    const colmap::Reconstruction& model) {
  Addition addition;
  std::vector<colmap::TrackElement> open;
  for (const colmap::TrackElement& element : track.Elements()) {
    if (!IsRegistered(model, element.image_id)) continue;
    const colmap::Point2D& feature =
        model.Image(element.image_id).Point2D(element.point2D_idx);
    if (!feature.HasPoint3D()) {
      open.push_back(element);
    } else if (addition.point_id == colmap::kInvalidPoint3DId) {
      addition.point_id = feature.Point3DId();
    }
  }
  const double max_error_px = kErrorFactor * options.max_completion_error_px;
  if (addition.point_id != colmap::kInvalidPoint3DId) {
    addition.elements = ElementsAtPoint(
        open, model.Point3D(addition.point_id).XYZ(), max_error_px, model);
    return addition;
  }
  // Elements that are off pull at the first intersection.
  addition.elements = std::move(open);
  for (int round = 0; round < 2 && addition.elements.size() >= 2; ++round) {
    const auto xyz = Triangulate(
        addition.elements, options.min_triangulation_angle_deg, model);
    if (!xyz) return Addition();
    addition.xyz = *xyz;
    const size_t num_elements = addition.elements.size();
    addition.elements =
        ElementsAtPoint(addition.elements, *xyz, max_error_px, model);
    if (addition.elements.size() == num_elements) return addition;
  }
  return addition.elements.size() < 2 ? Addition() : addition;
}

}  // namespace

size_t AddTracks(const std::vector<colmap::Track>& tracks,
                 const ModelRefinementOptions& options,
                 int num_threads,
                 colmap::Reconstruction* model) {
  std::vector<Addition> additions(tracks.size());
  ParallelFor((tracks.size() + kNumTracksPerItem - 1) / kNumTracksPerItem,
              num_threads,
              [&](size_t item) {
                const size_t end =
                    std::min(tracks.size(), (item + 1) * kNumTracksPerItem);
                for (size_t i = item * kNumTracksPerItem; i < end; ++i) {
                  additions[i] = AdditionBy(tracks[i], options, *model);
                }
              });
  size_t num_added = 0;
  for (Addition& addition : additions) {
    num_added += addition.elements.size();
    if (addition.elements.empty()) continue;
    if (addition.point_id == colmap::kInvalidPoint3DId) {
      colmap::Track track;
      track.AddElements(addition.elements);
      model->AddPoint3D(addition.xyz, track);
      continue;
    }
    for (const colmap::TrackElement& element : addition.elements) {
      model->AddObservation(addition.point_id, element);
    }
  }
  return num_added;
}

}  // namespace dgsfm
