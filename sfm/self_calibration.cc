#include "sfm/self_calibration.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace dgsfm {

namespace {

// Rounds until groups stay the same.
constexpr int kMaxNumGroupingRounds = 3;
// Iterations by which right ties have hardly anything left to gain, ...
constexpr int kMaxNumTrialIterations = 30;
// ... and by which wrong ones show: they cost this many times what errors
// explain.
constexpr int kNumScoutIterations = 8;
constexpr double kHopelessFactor = 10;

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

// Adjustments of a model under changing beliefs.
class TiedModels {
 public:
  TiedModels(const SelfCalibrationOptions& options,
             colmap::image_t fixed_image,
             const CameraBeliefs& beliefs,
             const colmap::Reconstruction& model)
      : options_(options),
        fixed_image_(fixed_image),
        beliefs_(beliefs),
        model_(model) {
    colmap::Reconstruction evaluated = model;
    free_cost_ = Adjust(1, {}, &evaluated);
  }

  struct Tied {
    std::vector<CameraGroup> groups;
    colmap::Reconstruction model;
    // Whether independent image errors explain what the ties cost.
    bool is_certain = false;
  };
  // The model with ties; nothing if no errors explain what they cost.
  std::optional<Tied> Tie(const std::vector<CameraGroup>& groups) const {
    Tied tied = {groups, model_, false};
    int num_ties = 0;
    for (const CameraGroup& group : groups) {
      num_ties += int(group.camera_ids.size() - 1) *
                  int(model_.Camera(group.camera_ids.front()).NumParams());
    }
    const auto is_plausible = [&](double increase, double factor) {
      return AreTiesPlausible(options_.grouping, increase / factor, num_ties);
    };
    const double max_factor = options_.grouping.max_variance_factor;
    const std::optional<double> scouted =
        CostOfTies(kNumScoutIterations, groups, &tied.model);
    if (!scouted || !is_plausible(*scouted, kHopelessFactor * max_factor)) {
      return std::nullopt;
    }
    const std::optional<double> increase =
        CostOfTies(kMaxNumTrialIterations, groups, &tied.model);
    if (!increase || !is_plausible(*increase, max_factor)) return std::nullopt;
    tied.is_certain = is_plausible(*increase, 1);
    return tied;
  }

 private:
  // What an adjustment with ties ends above the free one, in units of the
  // variance of image errors.
  std::optional<double> CostOfTies(int max_num_iterations,
                                   const std::vector<CameraGroup>& groups,
                                   colmap::Reconstruction* model) const {
    const std::optional<double> cost =
        Adjust(max_num_iterations, groups, model);
    if (!cost || !free_cost_) return std::nullopt;
    const double variance =
        *free_cost_ / (2 * double(model_.ComputeNumObservations()));
    return variance > 0 ? (*cost - *free_cost_) / variance : 0;
  }

  // Returns the sum of robust squared errors [px^2].
  std::optional<double> Adjust(int max_num_iterations,
                               const std::vector<CameraGroup>& groups,
                               colmap::Reconstruction* model) const {
    CameraBeliefs beliefs = beliefs_;
    beliefs.groups = groups;
    BundleAdjustmentOptions adjustment = options_.bundle_adjustment;
    adjustment.max_num_iterations =
        std::min(adjustment.max_num_iterations, max_num_iterations);
    const std::optional<double> rms = AdjustBundle(
        adjustment, options_.num_threads, fixed_image_, beliefs, {}, model);
    if (!rms) return std::nullopt;
    return *rms * *rms * double(model->ComputeNumObservations());
  }

  const SelfCalibrationOptions& options_;
  const colmap::image_t fixed_image_;
  const CameraBeliefs& beliefs_;
  const colmap::Reconstruction& model_;
  std::optional<double> free_cost_;
};

// Renews groups by what the model tied by them shows until they stay the same;
// nothing if their ties contradict the model.
std::optional<TiedModels::Tied> RenewGroups(
    const SelfCalibrationOptions& options,
    const TiedModels& tied_models,
    const CameraBeliefs& free_beliefs,
    std::vector<CameraGroup> groups) {
  std::optional<TiedModels::Tied> tied;
  for (int round = 0; round < kMaxNumGroupingRounds; ++round) {
    tied = tied_models.Tie(groups);
    if (!tied || tied->is_certain) return tied;
    const std::optional<IntrinsicsPosterior> posterior =
        EstimateIntrinsicsPosterior(
            options.bundle_adjustment, free_beliefs, tied->model);
    if (!posterior) return tied;
    groups = FindCameraGroups(
        options.grouping, free_beliefs, *posterior, tied->model);
    if (groups.empty()) return std::nullopt;
    if (AreSame(groups, tied->groups)) break;
  }
  return tied;
}

// Groups of a model, see CalibrateModel, without a posterior none but whole
// classes.
std::vector<CameraGroup> FindGroups(
    const SelfCalibrationOptions& options,
    const std::optional<IntrinsicsPosterior>& posterior,
    colmap::image_t fixed_image,
    const CameraBeliefs& beliefs,
    colmap::Reconstruction* model) {
  const std::vector<CameraGroup> classes = FindCameraClasses(
      options.grouping, options.bundle_adjustment.intrinsics, beliefs, *model);
  // Groups are parts of classes.
  if (classes.empty()) return {};
  const TiedModels tied_models(options, fixed_image, beliefs, *model);
  std::vector<CameraGroup> last_groups;
  const auto tie = [&](const std::vector<CameraGroup>& groups)
      -> std::optional<TiedModels::Tied> {
    if (groups.empty() || AreSame(groups, last_groups)) return std::nullopt;
    last_groups = groups;
    return RenewGroups(options, tied_models, beliefs, groups);
  };
  std::optional<TiedModels::Tied> tied = tie(classes);
  if (!tied && posterior) {
    tied =
        tie(FindCandidateGroups(options.grouping, beliefs, *posterior, *model));
  }
  if (!tied && posterior) {
    tied = tie(FindCameraGroups(options.grouping, beliefs, *posterior, *model));
  }
  if (!tied) return {};
  *model = std::move(tied->model);
  return tied->groups;
}

void SetPrincipalPoints(const CameraBeliefs& beliefs,
                        colmap::Reconstruction* model) {
  for (const colmap::camera_t camera_id : beliefs.held_principal_points) {
    const colmap::Camera& given = beliefs.given.at(camera_id);
    for (const size_t idx : given.PrincipalPointIdxs()) {
      model->Camera(camera_id).Params(idx) = given.Params(idx);
    }
  }
}

}  // namespace

CameraBeliefs CalibrateModel(const SelfCalibrationOptions& options,
                             colmap::image_t fixed_image,
                             CameraBeliefs beliefs,
                             colmap::Reconstruction* model) {
  std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(options.bundle_adjustment, beliefs, *model);
  beliefs.groups = FindGroups(options, posterior, fixed_image, beliefs, model);
  if (!beliefs.groups.empty()) {
    posterior =
        EstimateIntrinsicsPosterior(options.bundle_adjustment, beliefs, *model);
  }
  if (!posterior) return beliefs;
  beliefs.held_principal_points =
      FindGivenPrincipalPoints(options.grouping,
                               options.bundle_adjustment.intrinsics,
                               beliefs,
                               *posterior);
  SetPrincipalPoints(beliefs, model);
  return beliefs;
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
    const Eigen::VectorXd stddevs = posterior->StddevsOf(
        result.group_stddevs.empty() ? result.group : camera_id, model);
    result.stddevs.assign(stddevs.begin(), stddevs.end());
  }
  return results;
}

}  // namespace dgsfm
