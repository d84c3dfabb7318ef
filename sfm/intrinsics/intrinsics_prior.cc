#include "sfm/intrinsics/intrinsics_prior.h"

#include "colmap_ext/check.h"
#include "estimators/option_check.h"
#include "sfm/intrinsics/prior_trust.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dgsfm {

bool IntrinsicsPriorOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .Above("focal_length_stddev_ratio", focal_length_stddev_ratio, 0)
      .Above("unknown_log_focal_stddev", unknown_log_focal_stddev, 0)
      .Above("principal_point_stddev_ratio", principal_point_stddev_ratio, 0)
      .Above("crop_factor", crop_factor, 0)
      .Above("extra_params_stddev", extra_params_stddev, 0)
      .Above("keypoint_stddev_px", keypoint_stddev_px, 0)
      .AreKept();
}

CameraBeliefs GivenBeliefs(const Scene& scene) {
  CameraBeliefs beliefs;
  beliefs.given = scene.cameras;
  for (const auto& [image_id, image] : scene.images) {
    const auto exif = scene.exif.find(image.CameraId());
    const bool is_named =
        exif != scene.exif.end() && !exif->second.camera.empty();
    // The first image of each camera gives the label.
    beliefs.labels.emplace(
        image.CameraId(),
        is_named ? exif->second.camera
                 : image.Name().substr(0, image.Name().rfind('/') + 1));
  }
  for (const auto& [camera_id, camera] : scene.cameras) {
    const FocalPrior prior = FocalPriorOf(scene, camera_id);
    if (!camera.HasPriorFocalLength() && prior.Exists()) {
      beliefs.focal_priors[camera_id] = prior;
    }
  }
  return beliefs;
}

Eigen::VectorXd PriorMean(const CameraBeliefs& beliefs,
                          colmap::camera_t camera_id) {
  const colmap::Camera& camera = beliefs.given.at(camera_id);
  Eigen::VectorXd mean = Eigen::Map<const Eigen::VectorXd>(
      camera.ParamsData(), Eigen::Index(camera.NumParams()));
  const auto prior = beliefs.focal_priors.find(camera_id);
  if (prior != beliefs.focal_priors.end()) {
    for (const size_t idx : camera.FocalLengthIdxs()) {
      mean(Eigen::Index(idx)) = prior->second.focal_px;
    }
  }
  return mean;
}

Eigen::VectorXd PriorStddevs(const IntrinsicsPriorOptions& options,
                             const CameraBeliefs& beliefs,
                             colmap::camera_t camera_id) {
  const colmap::Camera& camera = beliefs.given.at(camera_id);
  Eigen::VectorXd stddevs = Eigen::VectorXd::Zero(camera.NumParams());
  if (beliefs.held_cameras.count(camera_id) > 0) return stddevs;
  const auto set = [&](const std::vector<size_t>& idxs, double stddev) {
    for (const size_t idx : idxs) stddevs(Eigen::Index(idx)) = stddev;
  };
  if (options.refine_focal_length) {
    const auto prior = beliefs.focal_priors.find(camera_id);
    set(camera.FocalLengthIdxs(),
        camera.HasPriorFocalLength()
            ? options.focal_length_stddev_ratio * camera.MeanFocalLength()
        : prior != beliefs.focal_priors.end()
            ? prior->second.log_stddev * prior->second.focal_px
            : options.unknown_log_focal_stddev * camera.MeanFocalLength());
  }
  if (options.refine_extra_params &&
      beliefs.held_distortions.count(camera_id) == 0) {
    set(camera.ExtraParamsIdxs(), options.extra_params_stddev);
  }
  if (options.refine_principal_point && !camera.HasPriorFocalLength() &&
      beliefs.held_principal_points.count(camera_id) == 0) {
    set(camera.PrincipalPointIdxs(),
        options.principal_point_stddev_ratio * LargerSide(camera));
  }
  return stddevs;
}

std::vector<RobustPrior> SplitPriors(const IntrinsicsPriorOptions& options,
                                     const CameraBeliefs& beliefs,
                                     colmap::camera_t camera_id) {
  const colmap::Camera& camera = beliefs.given.at(camera_id);
  const Eigen::VectorXd stddevs = PriorStddevs(options, beliefs, camera_id);
  const bool is_calibrated = camera.HasPriorFocalLength();
  RobustPrior exact = {{}, std::numeric_limits<double>::infinity()};
  RobustPrior focals = {{}, options.crop_factor};
  RobustPrior centers = {{}, options.crop_factor};
  const auto contains = [](const std::vector<size_t>& idxs, Eigen::Index i) {
    return std::find(idxs.begin(), idxs.end(), size_t(i)) != idxs.end();
  };
  for (Eigen::Index i = 0; i < stddevs.size(); ++i) {
    if (stddevs(i) == 0 || !std::isfinite(stddevs(i))) continue;
    if (contains(camera.PrincipalPointIdxs(), i)) {
      centers.idxs.push_back(i);
    } else if (!is_calibrated && contains(camera.FocalLengthIdxs(), i)) {
      focals.idxs.push_back(i);
    } else {
      exact.idxs.push_back(i);
    }
  }
  std::vector<RobustPrior> priors;
  for (const RobustPrior& prior : {exact, focals, centers}) {
    if (!prior.idxs.empty()) priors.push_back(prior);
  }
  return priors;
}

bool CameraGroup::Contains(colmap::camera_t camera_id) const {
  return std::binary_search(camera_ids.begin(), camera_ids.end(), camera_id);
}

const CameraGroup* CameraBeliefs::GroupOf(colmap::camera_t camera_id) const {
  for (const CameraGroup& group : groups) {
    if (group.Contains(camera_id)) return &group;
  }
  return nullptr;
}

colmap::camera_t CameraBeliefs::FirstOfGroup(colmap::camera_t camera_id) const {
  const CameraGroup* group = GroupOf(camera_id);
  return group ? group->camera_ids.front() : camera_id;
}

size_t CameraBeliefs::NumTiedCameras() const {
  size_t num_cameras = 0;
  for (const CameraGroup& group : groups) {
    num_cameras += group.camera_ids.size();
  }
  return num_cameras;
}

std::vector<double> MeanParams(const CameraGroup& group,
                               const colmap::Reconstruction& model) {
  DGSFM_CHECK(!group.camera_ids.empty());
  std::vector<double> mean(model.Camera(group.camera_ids.front()).NumParams());
  for (const colmap::camera_t camera_id : group.camera_ids) {
    const colmap::Camera& camera = model.Camera(camera_id);
    DGSFM_CHECK(camera.NumParams() == mean.size());
    for (size_t i = 0; i < mean.size(); ++i) {
      mean[i] += camera.Params(i) / double(group.camera_ids.size());
    }
  }
  return mean;
}

}  // namespace dgsfm
