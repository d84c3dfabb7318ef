#include "sfm/camera_groups.h"

#include "estimators/median.h"
#include "sfm/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <utility>

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
    const double share =
        double(blocks.size()) / double(posterior.camera_ids.size());
    CameraGroupingOptions class_options = options;
    class_options.prior_odds = std::max(options.prior_odds, share * share);
    const std::vector<int> refined = RefinedParams(blocks[0], posterior, model);
    const CameraEstimates estimates =
        EstimatesOf(blocks, refined, posterior, model);
    for (const SameCameras& same : GroupCameras(class_options, estimates)) {
      groups.push_back(GroupOf(same, blocks, refined, posterior, model));
    }
  }
  return groups;
}

bool PrincipalPointsAreAsGiven(const CameraGroupingOptions& options,
                               const CameraMap& prior_cameras,
                               const IntrinsicsPosterior& posterior) {
  std::vector<int> params;
  std::vector<double> deviations;
  int first_param = 0;
  for (const colmap::camera_t camera_id : posterior.camera_ids) {
    const colmap::Camera& prior = prior_cameras.at(camera_id);
    for (const size_t idx : prior.PrincipalPointIdxs()) {
      const int param = first_param + int(idx);
      if (posterior.covariance(param, param) == 0) continue;
      params.push_back(param);
      deviations.push_back(posterior.params(param) - prior.Params(idx));
    }
    first_param += int(prior.NumParams());
  }
  const auto size = Eigen::Index(params.size());
  Eigen::MatrixXd covariance(size, size);
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j < size; ++j) {
      covariance(i, j) = posterior.covariance(params[i], params[j]);
    }
  }
  return AreConsistentWithZero(
      options,
      Eigen::Map<const Eigen::VectorXd>(deviations.data(), size),
      covariance);
}

void ResetPrincipalPoints(const CameraMap& prior_cameras,
                          colmap::Reconstruction* model) {
  std::vector<colmap::camera_t> camera_ids;
  for (const auto& [camera_id, camera] : model->Cameras()) {
    camera_ids.push_back(camera_id);
  }
  for (const colmap::camera_t camera_id : camera_ids) {
    const colmap::Camera& prior = prior_cameras.at(camera_id);
    for (const size_t idx : prior.PrincipalPointIdxs()) {
      model->Camera(camera_id).Params(idx) = prior.Params(idx);
    }
  }
}

void ShareIntrinsics(const std::vector<CameraGroup>& groups,
                     colmap::Reconstruction* model) {
  colmap::Reconstruction shared;
  for (const auto& [image_id, original] : model->Images()) {
    colmap::Image image = original;
    for (const CameraGroup& group : groups) {
      if (group.IsRigid() && group.Contains(image.CameraId())) {
        image.SetCameraId(group.camera_ids.front());
      }
    }
    if (!shared.ExistsCamera(image.CameraId())) {
      shared.AddCamera(model->Camera(image.CameraId()));
    }
    for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
      if (image.Point2D(i).HasPoint3D()) image.ResetPoint3DForPoint2D(i);
    }
    image.SetRegistered(false);
    shared.AddImage(image);
    if (original.IsRegistered()) shared.RegisterImage(image_id);
  }
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const colmap::Point3D& point = model->Point3D(point_id);
    const colmap::point3D_t shared_id =
        shared.AddPoint3D(point.XYZ(), point.Track(), point.Color());
    shared.Point3D(shared_id).SetError(point.Error());
  }
  *model = std::move(shared);
}

void KeepGroupsOf(const colmap::Reconstruction& model,
                  std::vector<CameraGroup>* groups) {
  for (CameraGroup& group : *groups) {
    std::vector<colmap::camera_t>& ids = group.camera_ids;
    ids.erase(std::remove_if(ids.begin(),
                             ids.end(),
                             [&](colmap::camera_t camera_id) {
                               return !model.ExistsCamera(camera_id);
                             }),
              ids.end());
  }
  groups->erase(std::remove_if(groups->begin(),
                               groups->end(),
                               [](const CameraGroup& group) {
                                 return group.camera_ids.size() < 2;
                               }),
                groups->end());
}

}  // namespace dgsfm
