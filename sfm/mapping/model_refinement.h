// Global positioning of a colmap::Reconstruction, and the filters between its
// adjustments.

#pragma once

#include "estimators/optimization/global_positioning.h"
#include "sfm/mapping/bundle_adjustment.h"
#include "sfm/mapping/metric_scale.h"
#include "sfm/view_graph/view_graph.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <optional>
#include <set>
#include <string>

namespace dgsfm {

struct ModelRefinementOptions {
  GlobalPositioningOptions global_positioning;
  // Observations that are off their point by more than this after global
  // positioning are removed [deg].
  double max_angular_error_deg = 2.0;

  // Rounds of bundle adjustment, with a filter after each.
  int num_bundle_adjustment_rounds = 3;
  BundleAdjustmentOptions bundle_adjustment;
  // Reprojection error of the filter after the last round [px]; the rounds
  // before use 2, 3, ... times it.
  double max_reprojection_error_px = 4.0;
  // Points whose rays all enclose less than this are removed [deg] ...
  double min_triangulation_angle_deg = 1.5;
  // ... unless an image that sees them has fewer other points than this: they
  // still hold its rotation.
  int min_num_triangulated_per_image = 100;
  // Whether the adjustment after retriangulation, when the model is complete,
  // frees the principal points within their prior.
  bool refine_principal_point = true;

  // Distance from the epipolar line of matches for retriangulation [px].
  double max_epipolar_error_px = 2.0;
  // Reprojection error to complete and merge tracks [px].
  double max_completion_error_px = 4.0;
  // Points of two images are removed after retriangulation if their distance
  // from a camera is more than this factor off that of all their neighbours in
  // the image; at least 1, 0 = off.
  double max_neighbor_distance_ratio = 1.15;
  // Images with fewer points than this are not registered.
  int min_num_points_per_image = 10;

  bool IsValid(std::string* error) const;
};

// Refines centres and points with fixed rotations (DGSfM Eq. 17). The centre
// of fixed_image stays, unless there are center_priors, which then hold the
// model. Images of a frame move together. Returns the solver's summary.
GlobalPositioningSummary PositionCameras(
    const GlobalPositioningOptions& options,
    int num_threads,
    colmap::image_t fixed_image,
    colmap::Reconstruction* model,
    const FrameMembers& frames = {},
    const CenterPriors& center_priors = {});

// Removes observations more than max_angle_deg off their point or behind the
// camera, and points left with one; returns the number of observations.
size_t FilterObservationsByAngle(double max_angle_deg,
                                 colmap::Reconstruction* model);

// Removes observations with large reprojection error or behind the camera and
// points with a small triangulation angle that no image is in need of; returns
// the number of observations.
size_t FilterObservations(const ModelRefinementOptions& options,
                          double error_factor,
                          colmap::Reconstruction* model);

// Cameras of registered images whose focal length or distortion no real camera
// has.
std::set<colmap::camera_t> ImplausibleCameras(
    const colmap::Reconstruction& model);

// De-registers images with too few points or implausible intrinsics and
// returns them with the reason. Images of a frame that has enough points in
// another image stay.
std::map<colmap::image_t, std::string> FilterImages(
    const ModelRefinementOptions& options,
    const FrameMembers& frames,
    colmap::Reconstruction* model);

// Whether two rays of a point enclose at least min_angle [rad].
bool IsTriangulated(const colmap::Point3D& point,
                    const ImageCenters& centers,
                    double min_angle);

// Stores the mean reprojection error of each point in it [px].
void UpdatePointErrors(colmap::Reconstruction* model);

}  // namespace dgsfm
