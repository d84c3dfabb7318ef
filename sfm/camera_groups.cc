#include "sfm/camera_groups.h"

#include "estimators/median.h"
#include "sfm/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace dgsfm {

namespace {

// Standard deviation of ties of parameters that do not differ, over that of
// the data: any stiffer slows the solver down and gains nothing.
constexpr double kStiffness = 0.1;

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
  group.variance_factor = same.variance_factor;
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

// Cameras that may be the same, and how many share that.
struct CameraClass {
  std::vector<PosteriorBlock> blocks;
  std::vector<int> refined;
  CameraEstimates estimates;
  CameraGroupingOptions options;
};

std::vector<CameraClass> ClassesOf(const CameraGroupingOptions& options,
                                   const CameraBeliefs& beliefs,
                                   const IntrinsicsPosterior& posterior,
                                   const colmap::Reconstruction& model) {
  std::map<CameraKind, std::vector<PosteriorBlock>> blocks_of;
  int first_param = 0;
  for (const colmap::camera_t camera_id : posterior.camera_ids) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    if (posterior.covariance(first_param, first_param) > 0) {
      blocks_of[KindOf(beliefs.given, beliefs.exif, camera_id)].push_back(
          {camera_id, first_param});
    }
    first_param += int(given.NumParams());
  }
  std::vector<CameraClass> classes;
  for (const auto& [key, blocks] : blocks_of) {
    if (blocks.size() < 2) continue;
    const double share =
        double(blocks.size()) / double(posterior.camera_ids.size());
    CameraClass& camera_class = classes.emplace_back();
    camera_class.blocks = blocks;
    camera_class.refined = RefinedParams(blocks[0], posterior, model);
    camera_class.estimates =
        EstimatesOf(blocks, camera_class.refined, posterior, model);
    camera_class.options = options;
    camera_class.options.prior_odds =
        std::max(options.prior_odds, share * share);
  }
  return classes;
}

// Mean deviation of the principal points of some cameras from the given ones;
// nothing if they are held or not seen.
std::optional<CameraDeviation> PrincipalPointDeviation(
    const std::vector<colmap::camera_t>& camera_ids,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior) {
  // Weights of the parameters in the mean, a row for each coordinate.
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(2, posterior.params.size());
  Eigen::VectorXd given_params(posterior.params.size());
  Eigen::Index first_param = 0;
  for (const colmap::camera_t camera_id : posterior.camera_ids) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    const auto num_params = Eigen::Index(given.NumParams());
    given_params.segment(first_param, num_params) =
        Eigen::Map<const Eigen::VectorXd>(given.ParamsData(), num_params);
    if (std::binary_search(camera_ids.begin(), camera_ids.end(), camera_id)) {
      for (Eigen::Index i = 0; i < 2; ++i) {
        mean(i, first_param + Eigen::Index(given.PrincipalPointIdxs()[i])) = 1;
      }
    }
    first_param += num_params;
  }
  if (mean.isZero(0)) return std::nullopt;
  mean /= mean.row(0).sum();
  const CameraDeviation deviation = {
      mean * (posterior.params - given_params),
      mean * posterior.covariance * mean.transpose()};
  if (!(deviation.covariance.diagonal().minCoeff() > 0)) return std::nullopt;
  return deviation;
}

size_t LargerSide(const colmap::Camera& camera) {
  return std::max(camera.Width(), camera.Height());
}

}  // namespace

CameraKind KindOf(const CameraMap& given,
                  const std::map<colmap::camera_t, ImageExif>& exif,
                  colmap::camera_t camera_id) {
  const colmap::Camera& camera = given.at(camera_id);
  const auto found = exif.find(camera_id);
  return {
      camera.ModelId(),
      camera.Width(),
      camera.Height(),
      found == exif.end() ? "" : found->second.camera,
      camera.HasPriorFocalLength() ? camera.Params() : std::vector<double>()};
}

std::vector<CameraGroup> FindCameraGroups(const CameraGroupingOptions& options,
                                          const CameraBeliefs& beliefs,
                                          const IntrinsicsPosterior& posterior,
                                          const colmap::Reconstruction& model) {
  std::vector<CameraGroup> groups;
  for (const CameraClass& camera_class :
       ClassesOf(options, beliefs, posterior, model)) {
    for (const SameCameras& same :
         GroupCameras(camera_class.options, camera_class.estimates)) {
      groups.push_back(GroupOf(
          same, camera_class.blocks, camera_class.refined, posterior, model));
    }
  }
  return groups;
}

std::vector<CameraGroup> FindCameraClasses(
    const CameraGroupingOptions& options,
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  std::map<CameraKind, std::set<colmap::camera_t>> classes;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    if (PriorStddevs(prior, beliefs, camera_id)(0) > 0) {
      classes[KindOf(beliefs.given, beliefs.exif, camera_id)].insert(camera_id);
    }
  }
  std::vector<CameraGroup> groups;
  for (const auto& [key, camera_ids] : classes) {
    if (camera_ids.size() < size_t(options.min_num_cameras)) continue;
    groups.emplace_back().camera_ids.assign(camera_ids.begin(),
                                            camera_ids.end());
  }
  return groups;
}

std::vector<CameraGroup> FindCandidateGroups(
    const CameraGroupingOptions& options,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model) {
  std::vector<CameraGroup> groups;
  for (const CameraClass& camera_class :
       ClassesOf(options, beliefs, posterior, model)) {
    for (const std::vector<int>& cameras :
         ClusterByFocal(camera_class.options, camera_class.estimates)) {
      if (cameras.size() < size_t(options.min_num_cameras)) continue;
      CameraGroup& group = groups.emplace_back();
      for (const int camera : cameras) {
        group.camera_ids.push_back(camera_class.blocks[camera].camera_id);
      }
    }
  }
  return groups;
}

std::set<colmap::camera_t> FindGivenPrincipalPoints(
    const CameraGroupingOptions& options,
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior) {
  std::set<colmap::camera_t> given_ids;
  for (const CameraGroup& group : beliefs.groups) {
    const auto deviation =
        PrincipalPointDeviation(group.camera_ids, beliefs, posterior);
    const double prior_stddev =
        prior.principal_point_stddev_ratio *
        double(LargerSide(beliefs.given.at(group.camera_ids.front())));
    if (deviation && LogOddsOfDeviation(
                         *deviation, group.variance_factor, prior_stddev) < 0) {
      given_ids.insert(group.camera_ids.begin(), group.camera_ids.end());
    }
  }

  std::vector<colmap::camera_t> camera_ids;
  std::vector<CameraDeviation> deviations;
  for (const colmap::camera_t camera_id : posterior.camera_ids) {
    const bool is_grouped =
        std::any_of(beliefs.groups.begin(),
                    beliefs.groups.end(),
                    [id = camera_id](const CameraGroup& group) {
                      return group.Contains(id);
                    });
    const auto deviation =
        PrincipalPointDeviation({camera_id}, beliefs, posterior);
    if (is_grouped || !deviation) continue;
    camera_ids.push_back(camera_id);
    deviations.push_back(*deviation);
  }
  const std::vector<char> deviating = DeviatingCameras(options, deviations);
  for (size_t i = 0; i < camera_ids.size(); ++i) {
    if (!deviating[i]) given_ids.insert(camera_ids[i]);
  }
  return given_ids;
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
