#include "sfm/intrinsics/camera_calibration.h"

#include "estimators/averaging/focal_population.h"
#include "estimators/two_view/two_view_model.h"
#include "sfm/intrinsics/camera_groups.h"
#include "sfm/intrinsics/prior_trust.h"

#include <algorithm>
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

// False if there are no estimates.
bool SetAverage(const std::vector<double>& estimates,
                CameraFocal* focal,
                colmap::Camera* camera) {
  const auto averaged = AverageFocals(estimates);
  if (!averaged) return false;
  focal->num_estimates = estimates.size();
  focal->log_spread = averaged->log_spread;
  SetFocalLength(averaged->focal_length_px, camera);
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

Eigen::Matrix3d FundamentalOfPair(const PairGeometry& pair) {
  TwoViewModel model;
  model.rotation = pair.cam2_from_cam1.rotation.toRotationMatrix();
  model.translation = pair.cam2_from_cam1.translation;
  model.focal1 = pair.focal_length1_px;
  model.focal2 = pair.focal_length2_px;
  return model.FundamentalMatrix();
}

void CalibrateFromFundamentals(
    const PairGeometries& pairs,
    Scene* scene,
    std::map<colmap::camera_t, CameraFocal>* focals) {
  std::vector<colmap::camera_t> camera_ids;
  std::vector<double> focal_lengths_px;
  std::vector<char> known;
  for (const auto& [camera_id, focal] : *focals) {
    camera_ids.push_back(camera_id);
    focal_lengths_px.push_back(focal.focal_length_px);
    known.push_back(focal.source == FocalSource::PRIOR ||
                    focal.source == FocalSource::PAIRS ||
                    focal.source == FocalSource::EXIF);
  }
  if (std::all_of(known.begin(), known.end(), [](char k) { return k; })) {
    return;
  }
  const auto index_of = [&](colmap::image_t image_id) {
    const colmap::camera_t camera_id = scene->images.at(image_id).CameraId();
    return int(
        std::lower_bound(camera_ids.begin(), camera_ids.end(), camera_id) -
        camera_ids.begin());
  };
  std::vector<PairFundamental> fundamentals;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID ||
        pair.cam2_from_cam1.translation.norm() == 0) {
      continue;
    }
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    PairFundamental fundamental;
    fundamental.camera1 = index_of(image_id1);
    fundamental.camera2 = index_of(image_id2);
    fundamental.F = FundamentalOfPair(pair);
    fundamentals.push_back(fundamental);
  }
  if (fundamentals.empty()) return;
  const std::vector<char> estimated =
      CalibrateViewGraph(fundamentals, known, {}, &focal_lengths_px);
  for (size_t i = 0; i < camera_ids.size(); ++i) {
    if (known[i] || !estimated[i]) continue;
    (*focals)[camera_ids[i]] = {FocalSource::VIEW_GRAPH, focal_lengths_px[i]};
    SetFocalLength(focal_lengths_px[i], &scene->cameras.at(camera_ids[i]));
  }
}

}  // namespace

std::string FocalSourceName(FocalSource source) {
  switch (source) {
    case FocalSource::PRIOR:
      return "prior";
    case FocalSource::PAIRS:
      return "pairs";
    case FocalSource::VIEW_GRAPH:
      return "view_graph";
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
  CalibrateFromFundamentals(pairs, scene, &focals);
  return focals;
}

}  // namespace dgsfm
