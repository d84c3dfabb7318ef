#include "sfm/intrinsics/camera_groups.h"

#include "estimators/median.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include <Eigen/Eigenvalues>
#include <glog/logging.h>

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
  const std::map<colmap::camera_t, int> kinds = CameraKinds(beliefs);
  std::map<int, std::vector<PosteriorBlock>> blocks_of;
  int first_param = 0;
  for (const colmap::camera_t camera_id : posterior.block_ids) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    if (posterior.covariance(first_param, first_param) > 0 &&
        !beliefs.GroupOf(camera_id)) {
      blocks_of[kinds.at(camera_id)].push_back({camera_id, first_param});
    }
    first_param += int(given.NumParams());
  }
  std::vector<CameraClass> classes;
  for (const auto& [kind, blocks] : blocks_of) {
    if (blocks.size() < 2) continue;
    const double share =
        double(blocks.size()) / double(posterior.block_ids.size());
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

// Differences of values from their weighted mean, over their standard
// deviations [1], which are at least min_stddev.
Eigen::VectorXd DeviationsFromMean(double min_stddev,
                                   const Eigen::VectorXd& values,
                                   const Eigen::MatrixXd& covariance) {
  Eigen::VectorXd weights = covariance.diagonal().cwiseInverse();
  weights /= weights.sum();
  const Eigen::VectorXd cross = covariance * weights;
  const double mean = weights.dot(values);
  const Eigen::ArrayXd variances =
      (covariance.diagonal() - 2 * cross).array() + weights.dot(cross);
  return (values.array() - mean) /
         (variances.max(0) + min_stddev * min_stddev).sqrt();
}

// Mean deviation of the principal points of some cameras from the given ones;
// nothing if they are held or not seen. The covariance is one of the
// posterior's.
std::optional<CameraDeviation> PrincipalPointDeviation(
    const std::vector<colmap::camera_t>& camera_ids,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const Eigen::MatrixXd& covariance,
    const colmap::Reconstruction& model) {
  // Weights of the parameters in the mean, a row for each coordinate.
  Eigen::MatrixXd mean = Eigen::MatrixXd::Zero(2, covariance.cols());
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (const colmap::camera_t camera_id : camera_ids) {
    const auto first_param = posterior.FirstParamOf(camera_id);
    if (!first_param) continue;
    const colmap::Camera& given = beliefs.given.at(camera_id);
    for (Eigen::Index i = 0; i < 2; ++i) {
      const size_t idx = given.PrincipalPointIdxs()[size_t(i)];
      mean(i, *first_param + Eigen::Index(idx)) = 1;
      sum(i) += model.Camera(camera_id).Params(idx) - given.Params(idx);
    }
  }
  if (mean.isZero(0)) return std::nullopt;
  const double count = mean.row(0).sum();
  mean /= count;
  const CameraDeviation deviation = {sum / count,
                                     mean * covariance * mean.transpose()};
  if (!(deviation.covariance.diagonal().minCoeff() > 0)) return std::nullopt;
  return deviation;
}

// Uncertainty of a principal point, over that of its prior, up to which it
// counts as determined.
constexpr double kMaxUncertaintyRatio = 0.5;

// Standard deviation in the least certain direction.
double MaxStddev(const CameraDeviation& deviation) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      deviation.covariance);
  return std::sqrt(eigen.eigenvalues().maxCoeff());
}

}  // namespace

std::map<colmap::camera_t, int> CameraKinds(const CameraBeliefs& beliefs) {
  // Focal lengths from EXIF data that are farther apart are different zooms:
  // those of one zoom differ by rounding only.
  constexpr double kMaxLogFocalDifference = 0.002;
  using Key =
      std::tuple<int, size_t, size_t, std::string, std::vector<double>, bool>;
  struct Member {
    double log_focal = 0;
    colmap::camera_t camera_id = colmap::kInvalidCameraId;
  };
  std::map<Key, std::vector<Member>> classes;
  for (const auto& [camera_id, camera] : beliefs.given) {
    const auto label = beliefs.labels.find(camera_id);
    const auto prior = beliefs.focal_priors.find(camera_id);
    const bool has_prior = prior != beliefs.focal_priors.end();
    const Key key = {
        camera.ModelId(),
        camera.Width(),
        camera.Height(),
        label == beliefs.labels.end() ? "" : label->second,
        camera.HasPriorFocalLength() ? camera.Params() : std::vector<double>(),
        has_prior};
    classes[key].push_back(
        {has_prior ? std::log(prior->second.focal_px) : 0, camera_id});
  }
  std::map<colmap::camera_t, int> kinds;
  int kind = 0;
  for (auto& [key, members] : classes) {
    std::stable_sort(
        members.begin(), members.end(), [](const Member& a, const Member& b) {
          return a.log_focal < b.log_focal;
        });
    double first_log_focal = 0;
    for (size_t i = 0; i < members.size(); ++i) {
      if (i == 0 ||
          members[i].log_focal - first_log_focal > kMaxLogFocalDifference) {
        ++kind;
        first_log_focal = members[i].log_focal;
      }
      kinds[members[i].camera_id] = kind;
    }
  }
  return kinds;
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
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  const std::map<colmap::camera_t, int> kinds = CameraKinds(beliefs);
  std::map<int, std::set<colmap::camera_t>> classes;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    if (PriorStddevs(prior, beliefs, camera_id)(0) > 0) {
      classes[kinds.at(camera_id)].insert(camera_id);
    }
  }
  std::vector<CameraGroup> groups;
  for (const auto& [kind, camera_ids] : classes) {
    if (camera_ids.size() < 2) continue;
    groups.emplace_back().camera_ids.assign(camera_ids.begin(),
                                            camera_ids.end());
  }
  return groups;
}

std::vector<colmap::image_t> FindDeviatingImages(
    const CameraGroupingOptions& options,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& by_image,
    const colmap::Reconstruction& model) {
  struct Focal {
    colmap::image_t image_id;
    Eigen::Index param;
  };
  // Focal lengths of images that share intrinsics, where these are refined.
  std::map<colmap::camera_t, std::vector<Focal>> shared;
  Eigen::Index first_param = 0;
  for (size_t i = 0; i < by_image.block_ids.size(); ++i) {
    const colmap::image_t image_id = by_image.block_ids[i];
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    const CameraGroup* group = beliefs.RigidGroupOf(camera_id);
    if (by_image.covariance(first_param, first_param) > 0) {
      shared[group ? group->camera_ids.front() : camera_id].push_back(
          {image_id, first_param});
    }
    first_param += by_image.num_params[i];
  }
  std::vector<colmap::image_t> deviating;
  for (const auto& [camera_id, focals] : shared) {
    if (focals.size() < 2) continue;
    const auto count = Eigen::Index(focals.size());
    Eigen::VectorXd logs(count);
    Eigen::MatrixXd covariance(count, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      const double focal = model.Camera(camera_id).MeanFocalLength();
      // The step of the logarithm.
      logs(i) = by_image.params(focals[size_t(i)].param) / focal - 1;
      for (Eigen::Index j = 0; j < count; ++j) {
        covariance(i, j) = by_image.covariance(focals[size_t(i)].param,
                                               focals[size_t(j)].param) /
                           (focal * focal);
      }
    }
    const Eigen::VectorXd deviations =
        DeviationsFromMean(options.min_log_focal_stddev, logs, covariance);
    const double rms = std::sqrt(deviations.squaredNorm() / double(count));
    VLOG(1) << "Camera " << camera_id << ": focal lengths of " << count
            << " images differ by " << rms << " standard deviations, at most "
            << deviations.cwiseAbs().maxCoeff();
    for (Eigen::Index i = 0; i < count; ++i) {
      if (rms > options.max_rms_focal_deviation ||
          std::abs(deviations(i)) > options.max_focal_deviation) {
        deviating.push_back(focals[size_t(i)].image_id);
      }
    }
  }
  std::sort(deviating.begin(), deviating.end());
  return deviating;
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

std::set<colmap::camera_t> FindHeldPrincipalPoints(
    const CameraGroupingOptions& options,
    const IntrinsicsPriorOptions& prior,
    const CameraBeliefs& beliefs,
    const IntrinsicsPosterior& posterior,
    const colmap::Reconstruction& model) {
  // Cameras that share a principal point, in all their images.
  struct Owner {
    std::vector<colmap::camera_t> camera_ids;
    int num_images = 0;
  };
  std::map<colmap::camera_t, Owner> owners;
  for (const CameraGroup& group : beliefs.groups) {
    owners[group.camera_ids.front()].camera_ids = group.camera_ids;
  }
  for (const colmap::image_t image_id : model.RegImageIds()) {
    const colmap::camera_t camera_id = model.Image(image_id).CameraId();
    const CameraGroup* group = beliefs.GroupOf(camera_id);
    Owner& owner = owners[group ? group->camera_ids.front() : camera_id];
    if (!group) owner.camera_ids = {camera_id};
    ++owner.num_images;
  }

  std::vector<const Owner*> judged;
  std::vector<CameraDeviation> deviations;
  std::set<colmap::camera_t> held;
  for (const auto& [camera_id, owner] : owners) {
    const auto deviation = PrincipalPointDeviation(
        owner.camera_ids, beliefs, posterior, posterior.covariance, model);
    if (deviation) {
      judged.push_back(&owner);
      deviations.push_back(*deviation);
    } else {
      held.insert(owner.camera_ids.begin(), owner.camera_ids.end());
    }
  }
  const std::vector<char> deviating = DeviatingCameras(options, deviations);
  for (size_t i = 0; i < judged.size(); ++i) {
    const std::vector<colmap::camera_t>& ids = judged[i]->camera_ids;
    const double stddev_px = prior.principal_point_stddev_ratio *
                             LargerSide(beliefs.given.at(ids.front()));
    const bool is_crop = deviating[i] && deviations[i].values.norm() >
                                             prior.crop_factor * stddev_px;
    const CameraDeviation by_keypoints = *PrincipalPointDeviation(
        ids, beliefs, posterior, posterior.keypoint_covariance, model);
    VLOG(1) << "Principal point of camera " << ids.front() << ": uncertainty "
            << MaxStddev(deviations[i]) / stddev_px << " of the prior's, "
            << MaxStddev(by_keypoints) / stddev_px
            << " by errors of key points alone, off by "
            << deviations[i].values.transpose() << " px";
    const bool is_determined =
        judged[i]->num_images > 1 &&
        MaxStddev(deviations[i]) < kMaxUncertaintyRatio * stddev_px &&
        LogOddsOfDeviation(by_keypoints, stddev_px) > 0;
    if (!is_crop && !is_determined) held.insert(ids.begin(), ids.end());
  }
  return held;
}

void RenameCameras(const std::map<colmap::camera_t, colmap::camera_t>& new_ids,
                   colmap::Reconstruction* model) {
  colmap::Reconstruction renamed;
  for (const auto& [image_id, original] : model->Images()) {
    colmap::Image image = original;
    const auto new_id = new_ids.find(image.CameraId());
    if (new_id != new_ids.end()) image.SetCameraId(new_id->second);
    if (!renamed.ExistsCamera(image.CameraId())) {
      colmap::Camera camera = model->Camera(original.CameraId());
      camera.SetCameraId(image.CameraId());
      renamed.AddCamera(camera);
    }
    for (colmap::point2D_t i = 0; i < image.NumPoints2D(); ++i) {
      if (image.Point2D(i).HasPoint3D()) image.ResetPoint3DForPoint2D(i);
    }
    image.SetRegistered(false);
    renamed.AddImage(image);
    if (original.IsRegistered()) renamed.RegisterImage(image_id);
  }
  for (const colmap::point3D_t point_id : SortedPoints(*model)) {
    const colmap::Point3D& point = model->Point3D(point_id);
    const colmap::point3D_t renamed_id =
        renamed.AddPoint3D(point.XYZ(), point.Track(), point.Color());
    renamed.Point3D(renamed_id).SetError(point.Error());
  }
  *model = std::move(renamed);
}

std::map<colmap::camera_t, colmap::camera_t> FirstOfRigidGroups(
    const std::vector<CameraGroup>& groups) {
  std::map<colmap::camera_t, colmap::camera_t> first_ids;
  for (const CameraGroup& group : groups) {
    if (!group.IsRigid()) continue;
    for (const colmap::camera_t camera_id : group.camera_ids) {
      first_ids[camera_id] = group.camera_ids.front();
    }
  }
  return first_ids;
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
