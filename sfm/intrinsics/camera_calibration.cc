#include "sfm/intrinsics/camera_calibration.h"

#include "estimators/averaging/focal_population.h"
#include "estimators/median.h"
#include "sfm/intrinsics/camera_groups.h"
#include "sfm/intrinsics/prior_trust.h"

#include <cmath>

namespace dgsfm {

namespace {

void SetFocalLength(double focal_length_px, colmap::Camera* camera) {
  for (const size_t idx : camera->FocalLengthIdxs()) {
    camera->Params(idx) = focal_length_px;
  }
}

using FocalEstimates = std::map<colmap::camera_t, std::vector<double>>;

// Where nearly all pairs of a camera leave its focal length open, what the
// others estimate are chance results.
FocalEstimates EstimatesOfPairs(const PairGeometries& pairs,
                                const Scene& scene) {
  constexpr double kMinShareOfPairs = 0.1;
  FocalEstimates estimates;
  std::map<colmap::camera_t, size_t> num_pairs;
  const auto add =
      [&](colmap::image_t image_id, bool is_estimated, double focal_length_px) {
        const colmap::camera_t camera_id = scene.images.at(image_id).CameraId();
        ++num_pairs[camera_id];
        if (is_estimated) estimates[camera_id].push_back(focal_length_px);
      };
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    add(image_id1, pair.estimated_focal1, pair.focal_length1_px);
    add(image_id2, pair.estimated_focal2, pair.focal_length2_px);
  }
  for (auto& [camera_id, values] : estimates) {
    if (double(values.size()) <
        kMinShareOfPairs * double(num_pairs[camera_id])) {
      values.clear();
    }
  }
  return estimates;
}

// Sets the median of the logarithms. False if there are no estimates.
bool SetAverage(const std::vector<double>& estimates_px,
                CameraFocal* focal,
                colmap::Camera* camera) {
  if (estimates_px.empty()) return false;
  std::vector<double> logs;
  for (const double estimate_px : estimates_px) {
    logs.push_back(std::log(estimate_px));
  }
  const double median = Median(logs);
  focal->num_estimates = logs.size();
  focal->log_spread = RobustStddev(logs, median);
  SetFocalLength(std::exp(median), camera);
  return true;
}

// Cameras that may be the same are averaged with each other.
void ShrinkToPopulations(Scene* scene,
                         std::map<colmap::camera_t, CameraFocal>* focals) {
  std::map<int, std::vector<colmap::camera_t>> populations;
  for (const auto& [camera_id, kind] : CameraKinds(GivenBeliefs(*scene))) {
    if (focals->at(camera_id).source == FocalSource::PRIOR) continue;
    populations[kind].push_back(camera_id);
  }
  for (const auto& [kind, camera_ids] : populations) {
    std::vector<CameraFocalEstimate> estimates;
    for (const colmap::camera_t camera_id : camera_ids) {
      const CameraFocal& focal = focals->at(camera_id);
      estimates.push_back(
          {std::log(focal.focal_length_px),
           focal.log_spread,
           focal.source == FocalSource::PAIRS ? int(focal.num_estimates) : 0});
    }
    const std::vector<double> shrunk = ShrinkLogFocals(estimates);
    for (size_t i = 0; i < shrunk.size(); ++i) {
      CameraFocal& focal = focals->at(camera_ids[i]);
      if (focal.source == FocalSource::DEFAULT) {
        focal.source = FocalSource::SIMILAR_CAMERAS;
      } else if (focal.source != FocalSource::PAIRS) {
        continue;
      }
      focal.focal_length_px = std::exp(shrunk[i]);
      SetFocalLength(focal.focal_length_px, &scene->cameras.at(camera_ids[i]));
    }
  }
}

// Differences beyond this many standard deviations tell of a crop.
constexpr double kMaxExifDeviation = 2;
// Smallest standard deviation of a median of few estimates, whatever their
// spread.
constexpr double kMinPairsLogStddev = 0.02;

// A camera whose image is a crop has EXIF data that are wrong.
void AddExif(const FocalPrior& exif,
             CameraFocal* focal,
             colmap::Camera* camera) {
  const double exif_log_focal = std::log(exif.focal_px);
  if (focal->source != FocalSource::PAIRS) {
    focal->source = FocalSource::EXIF;
    SetFocalLength(std::exp(exif_log_focal), camera);
    return;
  }
  const double pairs_variance =
      focal->log_spread * focal->log_spread / double(focal->num_estimates) +
      kMinPairsLogStddev * kMinPairsLogStddev;
  const double exif_variance = exif.log_stddev * exif.log_stddev;
  const double difference =
      exif_log_focal - std::log(camera->MeanFocalLength());
  if (std::abs(difference) >
      kMaxExifDeviation * std::sqrt(pairs_variance + exif_variance)) {
    return;
  }
  SetFocalLength(
      camera->MeanFocalLength() * std::exp(difference * pairs_variance /
                                           (pairs_variance + exif_variance)),
      camera);
}

}  // namespace

std::string FocalSourceName(FocalSource source) {
  switch (source) {
    case FocalSource::PRIOR:
      return "prior";
    case FocalSource::PAIRS:
      return "pairs";
    case FocalSource::EXIF:
      return "exif";
    case FocalSource::SIMILAR_CAMERAS:
      return "similar_cameras";
    case FocalSource::DEFAULT:
      return "default";
  }
  return "default";
}

std::map<colmap::camera_t, CameraFocal> AverageFocalsOfCameras(
    const PairGeometries& pairs, bool relate_cameras, Scene* scene) {
  FocalEstimates estimates = EstimatesOfPairs(pairs, *scene);
  std::map<colmap::camera_t, CameraFocal> focals;
  for (auto& [camera_id, camera] : scene->cameras) {
    CameraFocal& focal = focals[camera_id];
    if (camera.HasPriorFocalLength()) {
      focal.source = FocalSource::PRIOR;
    } else if (SetAverage(estimates[camera_id], &focal, &camera)) {
      focal.source = FocalSource::PAIRS;
    }
    const FocalPrior exif = FocalPriorOf(*scene, camera_id);
    if (focal.source != FocalSource::PRIOR && exif.Exists()) {
      AddExif(exif, &focal, &camera);
    }
    focal.focal_length_px = camera.MeanFocalLength();
  }
  if (relate_cameras) ShrinkToPopulations(scene, &focals);
  return focals;
}

}  // namespace dgsfm
