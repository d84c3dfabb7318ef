#include "sfm/camera_groups.h"

#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace dgsfm {

namespace {

// Standard deviation of ties of parameters that do not differ, over that of
// the data: any stiffer slows the solver down and gains nothing.
constexpr double kStiffness = 0.1;

using CameraClass = std::tuple<int, size_t, size_t>;

// A camera's place in the posterior.
struct PosteriorBlock {
  colmap::camera_t camera_id = 0;
  int first_param = 0;
};

// Focal lengths come first in all of COLMAP's models.
bool IsFocal(const colmap::Camera& camera, int param) {
  return param < int(camera.FocalLengthIdxs().size());
}

// Parameters of a camera that were refined.
std::vector<int> RefinedParams(const PosteriorBlock& block,
                               const IntrinsicsPosterior& posterior,
                               const colmap::Reconstruction& model) {
  std::vector<int> refined;
  for (int i = 0; i < int(model.Camera(block.camera_id).NumParams()); ++i) {
    const int param = block.first_param + i;
    if (posterior.covariance(param, param) > 0) refined.push_back(i);
  }
  return refined;
}

// Focal lengths as logarithms.
CameraEstimates EstimatesOf(const std::vector<PosteriorBlock>& blocks,
                            const std::vector<int>& refined,
                            const IntrinsicsPosterior& posterior,
                            const colmap::Reconstruction& model) {
  const colmap::Camera& camera = model.Camera(blocks[0].camera_id);
  CameraEstimates estimates;
  estimates.num_params_per_camera = int(refined.size());
  std::vector<int> params;
  std::vector<double> scales;
  for (const PosteriorBlock& block : blocks) {
    for (const int i : refined) {
      params.push_back(block.first_param + i);
      scales.push_back(IsFocal(camera, i) ? 1 / posterior.params(params.back())
                                          : 1);
    }
  }
  const auto size = Eigen::Index(params.size());
  estimates.params.resize(size);
  estimates.covariance.resize(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    const double value = posterior.params(params[i]);
    estimates.params(i) = scales[i] == 1 ? value : std::log(value);
    for (Eigen::Index j = 0; j < size; ++j) {
      estimates.covariance(i, j) =
          scales[i] * scales[j] * posterior.covariance(params[i], params[j]);
    }
  }
  return estimates;
}

CameraGroup GroupOf(const SameCameras& same,
                    const std::vector<PosteriorBlock>& blocks,
                    const std::vector<int>& refined,
                    const IntrinsicsPosterior& posterior,
                    const colmap::Reconstruction& model) {
  CameraGroup group;
  for (const int camera : same.cameras) {
    group.camera_ids.push_back(blocks[camera].camera_id);
  }
  if (same.stddevs.isZero(0)) return group;
  const colmap::Camera& camera = model.Camera(group.camera_ids[0]);
  group.stddevs = Eigen::VectorXd::Zero(Eigen::Index(camera.NumParams()));
  for (size_t i = 0; i < refined.size(); ++i) {
    std::vector<double> stddevs;
    for (const int member : same.cameras) {
      const int param = blocks[member].first_param + refined[i];
      stddevs.push_back(std::sqrt(posterior.covariance(param, param)));
    }
    const double unit =
        IsFocal(camera, refined[i]) ? camera.Params(size_t(refined[i])) : 1;
    group.stddevs(refined[i]) = std::max(unit * same.stddevs(Eigen::Index(i)),
                                         kStiffness * Median(stddevs));
  }
  return group;
}

}  // namespace

std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model) {
  std::map<CameraClass, std::vector<PosteriorBlock>> classes;
  int first_param = 0;
  for (const colmap::camera_t camera_id : posterior.camera_ids) {
    const colmap::Camera& camera = model.Camera(camera_id);
    if (!camera.HasPriorFocalLength() &&
        posterior.covariance(first_param, first_param) > 0) {
      classes[{camera.ModelId(), camera.Width(), camera.Height()}].push_back(
          {camera_id, first_param});
    }
    first_param += int(camera.NumParams());
  }
  std::vector<CameraGroup> groups;
  for (const auto& [camera_class, blocks] : classes) {
    if (blocks.size() < 2) continue;
    const std::vector<int> refined = RefinedParams(blocks[0], posterior, model);
    const CameraEstimates estimates =
        EstimatesOf(blocks, refined, posterior, model);
    for (const SameCameras& same : GroupCameras(options, estimates)) {
      groups.push_back(GroupOf(same, blocks, refined, posterior, model));
    }
  }
  return groups;
}

}  // namespace dgsfm
