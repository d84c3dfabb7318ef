#include "sfm/intrinsics/self_calibration.h"

#include "estimators/median.h"
#include "sfm/intrinsics/intrinsics_evidence.h"
#include "sfm/mapping/model_refinement.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Sets the principal points and distortions that are held.
void ResetHeldParams(const CameraBeliefs& beliefs,
                     colmap::Reconstruction* model) {
  const auto reset = [&](const std::set<colmap::camera_t>& camera_ids,
                         const std::vector<size_t>& (colmap::Camera::*idxs)()
                             const) {
    for (const colmap::camera_t camera_id : camera_ids) {
      const colmap::Camera& given = beliefs.given.at(camera_id);
      for (const size_t idx : (given.*idxs)()) {
        model->Camera(camera_id).Params(idx) = given.Params(idx);
      }
    }
  };
  reset(beliefs.held_principal_points, &colmap::Camera::PrincipalPointIdxs);
  reset(beliefs.held_distortions, &colmap::Camera::ExtraParamsIdxs);
}

// Drops groups of so few images of a large model that hardly two would be among
// those that show whether their focal lengths are the same.
void DropGroupsThatAreNotJudged(const colmap::Reconstruction& model,
                                std::vector<CameraGroup>* groups) {
  const double share =
      double(kMaxNumPosteriorImages) / double(model.NumRegImages());
  if (share >= 1) return;
  std::map<colmap::camera_t, int> num_images;
  for (const colmap::image_t image_id : model.RegImageIds()) {
    ++num_images[model.Image(image_id).CameraId()];
  }
  const auto is_small = [&](const CameraGroup& group) {
    int count = 0;
    for (const colmap::camera_t camera_id : group.camera_ids) {
      count += num_images[camera_id];
    }
    return share * count < 2;
  };
  groups->erase(std::remove_if(groups->begin(), groups->end(), is_small),
                groups->end());
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
  DropGroupsThatAreNotJudged(*model, &beliefs->groups);
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
      EstimateIntrinsicsPosterior(adjustment,
                                  options.num_threads,
                                  beliefs,
                                  model,
                                  IntrinsicsBlocks::BY_IMAGE);
  if (!by_image) return {};
  return FindDeviatingImages(beliefs, *by_image, model);
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
  const std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(
          options.bundle_adjustment, options.num_threads, beliefs, calibrated);
  if (!posterior) return held;
  const IntrinsicsPriorOptions& prior = options.bundle_adjustment.intrinsics;
  CameraBeliefs learned = beliefs;
  learned.held_principal_points =
      FindHeldPrincipalPoints(prior, beliefs, *posterior, calibrated);
  if (MayDrift(*model)) {
    learned.held_distortions =
        FindHeldDistortions(prior, beliefs, *posterior, calibrated);
  }
  if (learned.held_principal_points == held.held_principal_points &&
      learned.held_distortions.empty()) {
    return held;
  }
  if (!learned.held_principal_points.empty() ||
      !learned.held_distortions.empty()) {
    ResetHeldParams(learned, &calibrated);
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
    int num_threads,
    const CameraBeliefs& beliefs,
    const colmap::Reconstruction& model) {
  std::map<colmap::camera_t, CameraResult> results;
  for (const auto& [camera_id, camera] : model.Cameras()) {
    CameraResult& result = results[camera_id];
    result.params = camera.Params();
    const Eigen::VectorXd stddevs =
        PriorStddevs(options.intrinsics, beliefs, camera_id);
    result.prior_stddevs.assign(stddevs.begin(), stddevs.end());
    result.group = beliefs.FirstOfGroup(camera_id);
  }
  const std::optional<IntrinsicsPosterior> posterior =
      EstimateIntrinsicsPosterior(options, num_threads, beliefs, model);
  if (!posterior) return results;
  for (auto& [camera_id, result] : results) {
    const auto first = posterior->first_params.find(result.group);
    if (first == posterior->first_params.end()) continue;
    const Eigen::VectorXd stddevs =
        posterior->covariance.diagonal()
            .segment(first->second, Eigen::Index(result.params.size()))
            .cwiseSqrt();
    result.stddevs.assign(stddevs.begin(), stddevs.end());
  }
  return results;
}

}  // namespace dgsfm
