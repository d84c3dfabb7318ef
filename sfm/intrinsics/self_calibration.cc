#include "sfm/intrinsics/self_calibration.h"

#include "estimators/median.h"
#include "sfm/mapping/model_refinement.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Rounds until groups stay the same.
constexpr int kMaxNumGroupingRounds = 3;
// Iterations after which right ties have hardly anything left to gain.
constexpr int kMaxNumTrialIterations = 30;

bool AreSame(const std::vector<CameraGroup>& groups1,
             const std::vector<CameraGroup>& groups2) {
  if (groups1.size() != groups2.size()) return false;
  for (size_t i = 0; i < groups1.size(); ++i) {
    if (groups1[i].camera_ids != groups2[i].camera_ids ||
        groups1[i].IsRigid() != groups2[i].IsRigid()) {
      return false;
    }
  }
  return true;
}

CameraBeliefs WithGroups(CameraBeliefs beliefs,
                         const std::vector<CameraGroup>& groups) {
  beliefs.groups.insert(beliefs.groups.end(), groups.begin(), groups.end());
  return beliefs;
}

struct TiedModel {
  std::vector<CameraGroup> groups;
  colmap::Reconstruction model;
};

// Ties cameras, and renews the groups by what the tied model shows until they
// stay the same. Nothing if no group is left.
std::optional<TiedModel> Tie(const SelfCalibrationOptions& options,
                             const CameraBeliefs& beliefs,
                             const colmap::Reconstruction& model,
                             std::vector<CameraGroup> groups) {
  for (int round = 0; round < kMaxNumGroupingRounds; ++round) {
    if (groups.empty()) return std::nullopt;
    TiedModel tied = {groups, model};
    if (!options.adjust(
            WithGroups(beliefs, groups), kMaxNumTrialIterations, &tied.model)) {
      return std::nullopt;
    }
    const std::optional<IntrinsicsPosterior> posterior =
        EstimateIntrinsicsPosterior(
            options.bundle_adjustment, beliefs, tied.model);
    if (!posterior) return std::nullopt;
    groups =
        FindCameraGroups(options.grouping, beliefs, *posterior, tied.model);
    const bool is_last = round + 1 == kMaxNumGroupingRounds;
    if (is_last || AreSame(groups, tied.groups)) return tied;
  }
  return std::nullopt;
}

// Groups of cameras in no group of a freely adjusted model; moves it to its
// adjustment with them.
std::vector<CameraGroup> FindNewGroups(const SelfCalibrationOptions& options,
                                       const CameraBeliefs& beliefs,
                                       colmap::Reconstruction* model) {
  const std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(options.bundle_adjustment, beliefs, *model);
  if (!posterior) return {};
  for (const auto find : {&FindCandidateGroups, &FindCameraGroups}) {
    std::optional<TiedModel> tied =
        Tie(options,
            beliefs,
            *model,
            find(options.grouping, beliefs, *posterior, *model));
    if (!tied) continue;
    *model = std::move(tied->model);
    return tied->groups;
  }
  return {};
}

// All cameras whose principal points the model leaves open or that must stay.
std::set<colmap::camera_t> HeldPrincipalPoints(
    const SelfCalibrationOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  const std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(options.bundle_adjustment, beliefs, model);
  if (!posterior) {
    std::set<colmap::camera_t> all;
    for (const auto& [camera_id, camera] : model.Cameras()) {
      all.insert(camera_id);
    }
    return all;
  }
  return FindHeldPrincipalPoints(options.grouping,
                                 options.bundle_adjustment.intrinsics,
                                 beliefs,
                                 *posterior,
                                 model);
}

void ResetPrincipalPoints(const CameraBeliefs& beliefs,
                          colmap::Reconstruction* model) {
  for (const colmap::camera_t camera_id : beliefs.held_principal_points) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    for (const size_t idx : given.PrincipalPointIdxs()) {
      model->Camera(camera_id).Params(idx) = given.Params(idx);
    }
  }
}

// Whether any two registered images share a camera, or cameras a group.
bool SharesIntrinsics(const CameraBeliefs& beliefs,
                      const colmap::Reconstruction& model) {
  if (!beliefs.groups.empty()) return true;
  std::set<colmap::camera_t> camera_ids;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    camera_ids.insert(model.Image(image_id).CameraId());
  }
  return camera_ids.size() < model.NumRegImages();
}

// Whether an adjustment slid along directions that nothing determines, to
// intrinsics that no real camera has. Comparing focal lengths with those of the
// held model would not do: where images are crops, that is wrong itself.
bool HasRunAway(const colmap::Reconstruction& model,
                const colmap::Reconstruction& calibrated) {
  return ImplausibleCameras(calibrated).size() >
         ImplausibleCameras(model).size();
}

}  // namespace

void TieCameraClasses(const IntrinsicsPriorOptions& prior,
                      CameraBeliefs* beliefs,
                      colmap::Reconstruction* model) {
  beliefs->groups = FindCameraClasses(prior, *beliefs, *model);
  for (const CameraGroup& group : beliefs->groups) {
    std::vector<double> focals_px;
    for (const colmap::camera_t camera_id : group.camera_ids) {
      focals_px.push_back(model->Camera(camera_id).MeanFocalLength());
    }
    const double focal_px = Median(focals_px);
    for (const colmap::camera_t camera_id : group.camera_ids) {
      colmap::Camera& camera = model->Camera(camera_id);
      for (const size_t idx : camera.FocalLengthIdxs()) {
        camera.Params(idx) = focal_px;
      }
    }
  }
}

std::vector<colmap::image_t> FindContradictingImages(
    const SelfCalibrationOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  if (!SharesIntrinsics(beliefs, model)) return {};
  BundleAdjustmentOptions adjustment = options.bundle_adjustment;
  adjustment.intrinsics.refine_principal_point = false;
  const std::optional<IntrinsicsPosterior> by_image =
      EstimateIntrinsicsPosterior(
          adjustment, beliefs, model, IntrinsicsBlocks::BY_IMAGE);
  if (!by_image) return {};
  return FindDeviatingImages(options.grouping, beliefs, *by_image, model);
}

CameraBeliefs CalibrateModel(const SelfCalibrationOptions& options,
                             const CameraBeliefs& beliefs,
                             colmap::Reconstruction* model) {
  const int max_num_iterations = options.bundle_adjustment.max_num_iterations;
  CameraBeliefs held = beliefs;
  for (const auto& [camera_id, camera] : model->Cameras()) {
    held.held_principal_points.insert(camera_id);
  }
  colmap::Reconstruction calibrated = *model;
  if (!options.adjust(beliefs, max_num_iterations, &calibrated)) return held;
  const bool has_untied =
      std::any_of(model->Cameras().begin(),
                  model->Cameras().end(),
                  [&](const auto& camera) {
                    return beliefs.GroupOf(camera.first) == nullptr;
                  });
  std::vector<CameraGroup> groups;
  if (has_untied && options.tie_cameras)
    groups = FindNewGroups(options, beliefs, &calibrated);
  CameraBeliefs learned = WithGroups(beliefs, groups);
  learned.held_principal_points =
      HeldPrincipalPoints(options, learned, calibrated);
  if (groups.empty() &&
      learned.held_principal_points.size() == model->NumCameras()) {
    return held;
  }
  if (!learned.held_principal_points.empty()) {
    ResetPrincipalPoints(learned, &calibrated);
    if (!options.adjust(learned, max_num_iterations, &calibrated)) return held;
  }
  if (HasRunAway(*model, calibrated)) {
    LOG(WARNING) << "Freed intrinsics run away: principal points stay at the "
                    "given ones";
    return held;
  }
  *model = std::move(calibrated);
  return learned;
}

std::map<colmap::camera_t, CameraResult> SummarizeCameras(
    const BundleAdjustmentOptions& options,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  std::map<colmap::camera_t, CameraResult> results;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    CameraResult& result = results[camera_id];
    result.params = camera.Params();
    const Eigen::VectorXd stddevs =
        PriorStddevs(options.intrinsics, beliefs, camera_id);
    result.prior_stddevs.assign(stddevs.begin(), stddevs.end());
    result.group = camera_id;
  }
  for (const CameraGroup& group : beliefs.groups) {
    for (const colmap::camera_t camera_id : group.camera_ids) {
      CameraResult& result = results.at(camera_id);
      result.group = group.camera_ids.front();
      result.group_stddevs.assign(group.stddevs.begin(), group.stddevs.end());
    }
  }
  const std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(options, beliefs, model);
  if (!posterior) return results;
  for (auto& [camera_id, result] : results) {
    const std::optional<Eigen::Index> first = posterior->FirstParamOf(
        result.group_stddevs.empty() ? result.group : camera_id);
    if (!first) continue;
    const Eigen::VectorXd stddevs =
        posterior->covariance.diagonal()
            .segment(*first, Eigen::Index(result.params.size()))
            .cwiseSqrt();
    result.stddevs.assign(stddevs.begin(), stddevs.end());
  }
  return results;
}

}  // namespace dgsfm
