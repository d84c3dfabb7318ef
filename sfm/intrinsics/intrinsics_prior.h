// What bundle adjustment believes about intrinsics: priors of single cameras,
// and groups of cameras that share them.

#pragma once

#include "colmap_ext/scene.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct IntrinsicsPriorOptions {
  bool refine_focal_length = true;
  bool refine_extra_params = true;
  // Only of cameras that are not calibrated: a given calibration keeps its
  // principal point.
  bool refine_principal_point = false;
  // Standard deviation of the focal lengths of calibrated cameras [1].
  double focal_length_stddev_ratio = 0.01;
  // Standard deviation of the logarithm of focal lengths of which nothing is
  // known, about the guess in the database [1]. It stops what data do not.
  double unknown_log_focal_stddev = 0.5;
  // Standard deviation of the principal point about that of the database, as a
  // share of the larger image side [1].
  double principal_point_stddev_ratio = 0.01;
  // Deviations of principal points, and of focal lengths that are not
  // calibrated, beyond this many standard deviations count less and less
  // (Cauchy): crops may be far off [1].
  double crop_factor = 2;
  // Standard deviation of the distortion parameters about those of the database
  // [1].
  double extra_params_stddev = 0.1;
  // Standard deviation of key points that the priors are weighed against [px].
  double keypoint_stddev_px = 0.5;

  bool IsValid(std::string* error) const;
};

// Cameras of one model and image size that share their parameters.
struct CameraGroup {
  // Ascending.
  std::vector<colmap::camera_t> camera_ids;

  bool Contains(colmap::camera_t camera_id) const;
};

// What is believed about the intrinsics of all cameras.
struct CameraBeliefs {
  // As the database has them: the means of the priors.
  CameraMap given;
  // Cameras whose principal points are held at the given ones.
  std::set<colmap::camera_t> held_principal_points;
  // Cameras whose distortions are held at the given ones.
  std::set<colmap::camera_t> held_distortions;
  // Disjoint.
  std::vector<CameraGroup> groups;
  // Cameras with different labels are different: camera and zoom as EXIF data
  // have them, where these are at hand, else the folder of the images.
  std::map<colmap::camera_t, std::string> labels;
  // Soft priors of the focal lengths of cameras that are not calibrated.
  std::map<colmap::camera_t, FocalPrior> focal_priors;
  // Cameras all of whose parameters are held as they are.
  std::set<colmap::camera_t> held_cameras;

  // The group that a camera is in, or null.
  const CameraGroup* GroupOf(colmap::camera_t camera_id) const;
  // The first camera of its group, or the camera itself.
  colmap::camera_t FirstOfGroup(colmap::camera_t camera_id) const;
  size_t NumTiedCameras() const;
};

// What is known of the cameras of a scene before they are looked at.
CameraBeliefs GivenBeliefs(const Scene& scene);

// Means of the priors of the parameters of a camera [px, 1]: the given values,
// but for focal lengths with a soft prior.
Eigen::VectorXd PriorMean(const CameraBeliefs& beliefs,
                          colmap::camera_t camera_id);

// Standard deviation of each parameter of a camera about that [px, 1]: 0 where
// it is held.
Eigen::VectorXd PriorStddevs(const IntrinsicsPriorOptions& options,
                             const CameraBeliefs& beliefs,
                             colmap::camera_t camera_id);

// Parameters whose prior is one term with a loss of its own.
struct RobustPrior {
  // With a finite, positive standard deviation.
  std::vector<Eigen::Index> idxs;
  // Scale of the Cauchy loss [standard deviations]; infinite = no loss.
  double loss_scale = 0;
};
std::vector<RobustPrior> SplitPriors(const IntrinsicsPriorOptions& options,
                                     const CameraBeliefs& beliefs,
                                     colmap::camera_t camera_id);

std::vector<double> MeanParams(const CameraGroup& group,
                               const colmap::Reconstruction& model);

}  // namespace dgsfm
