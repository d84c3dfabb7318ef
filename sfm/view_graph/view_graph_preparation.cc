#include "sfm/view_graph/view_graph_preparation.h"

#include "colmap_ext/parallel.h"
#include "sfm/intrinsics/prior_trust.h"
#include "sfm/verification/depth_kind.h"
#include "sfm/verification/depth_reliability.h"
#include "sfm/verification/static_background.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

// Share of maps that contradict their pairs beyond which something common to
// all is wrong.
constexpr double kMaxUnreliableShare = 0.3;
// Distance between key points at rest [largest epipolar error of an inlier].
constexpr double kMaxMotion = 3;
// Share of valid pairs that see one plane beyond which a warning is due.
constexpr double kMaxPlanarShare = 0.8;

// Relative difference from averaged focal lengths up to which pairs are not
// verified again: calibrated ones are not better.
constexpr double kMaxFocalDifference = 0.01;
// Averaged focal lengths are wrong where pairs lose more than a tenth of their
// inliers by them; at most so many pairs are tried first.
constexpr double kMinShareOfInliersKept = 0.9;
constexpr size_t kMaxNumSampledPairs = 500;

// Whether the focal lengths of a pair may be far off: without depth, or where
// its matches leave them open. The others gain nothing from averaged ones.
bool LacksFocals(const PairGeometry& pair) {
  return !pair.has_scale || pair.Has(PairDegeneracy::WEAK_FOCAL1) ||
         pair.Has(PairDegeneracy::WEAK_FOCAL2);
}

// Whether the focal lengths of a pair differ from those of its cameras.
bool HasOtherFocals(const Scene& scene,
                    colmap::image_pair_t pair_id,
                    const PairGeometry& pair) {
  const auto differs = [&](colmap::image_t image_id, double focal_length_px) {
    const colmap::Camera& camera =
        scene.cameras.at(scene.images.at(image_id).CameraId());
    return !(std::abs(focal_length_px / camera.MeanFocalLength() - 1) <=
             kMaxFocalDifference);
  };
  const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
  return differs(image_id1, pair.focal_length1_px) ||
         differs(image_id2, pair.focal_length2_px);
}

std::vector<colmap::image_t> ImagesOf(const KeypointDepthMap& depths) {
  std::vector<colmap::image_t> image_ids;
  for (const auto& [image_id, image_depths] : depths) {
    image_ids.push_back(image_id);
  }
  return image_ids;
}

// Images whose depth maps are not used, in increasing order, with the reasons
// in the log.
std::vector<colmap::image_t> FindUnusableDepths(const Scene& scene,
                                                const PairGeometries& pairs,
                                                const KeypointDepthMap& depths,
                                                MappingLog* log) {
  const std::string what_is_wrong =
      ExplainWrongKindByPairs(scene, pairs, depths);
  if (!what_is_wrong.empty()) {
    // The finished models show it as well, for the report.
    LOG(WARNING) << "No depth map is used: " << what_is_wrong;
    return ImagesOf(depths);
  }
  std::set<colmap::image_t> unusable;
  for (const auto& [image_id, image_depths] : depths) {
    if (HasOneValue(image_depths)) unusable.insert(image_id);
  }
  if (!unusable.empty()) {
    log->Warn(std::to_string(unusable.size()) +
              " depth maps have one value everywhere and are not used");
  }
  size_t num_contradicting = 0;
  for (const colmap::image_t image_id : FindUnreliableDepths(pairs)) {
    if (!unusable.insert(image_id).second) continue;
    ++num_contradicting;
    LOG(WARNING) << "The depth map of image '"
                 << scene.images.at(image_id).Name()
                 << "' contradicts its matches and is not used";
  }
  if (double(num_contradicting) > kMaxUnreliableShare * double(depths.size())) {
    log->Warn(std::to_string(num_contradicting) +
              " depth maps contradict the matches and are not used: check that "
              "they belong to the images (orientation, cropping), and that the "
              "camera model fits the lens");
  }
  return {unusable.begin(), unusable.end()};
}

void VerifyAgain(PairStage stage,
                 const PairVerificationOptions& verification,
                 std::vector<colmap::image_pair_t> pair_ids,
                 const Scene& scene,
                 const KeypointDepthMap& depths,
                 PairGeometries* pairs) {
  SortLongestFirst(*pairs, &pair_ids);
  ParallelFor(pair_ids.size(), verification.num_threads, [&](size_t i) {
    const colmap::image_pair_t pair_id = pair_ids[i];
    pairs->at(pair_id).Replace(
        stage,
        VerifyPair(
            scene, depths, pair_id, MatchesOf(scene, pair_id), verification));
  });
}

size_t NumInliersOfValid(const PairGeometry& pair) {
  return pair.status == PairStatus::VALID ? pair.NumInliers() : 0;
}

// Share of the inliers before that the pairs still have.
double ShareOfInliersKept(const PairGeometries& before,
                          const PairGeometries& pairs) {
  size_t num_before = 0, num_now = 0;
  for (const auto& [pair_id, pair] : before) {
    num_before += NumInliersOfValid(pair);
    num_now += NumInliersOfValid(pairs.at(pair_id));
  }
  return num_before == 0 ? 1 : double(num_now) / double(num_before);
}

// Verifies pairs with averaged focal lengths, unless a sample of them shows
// that these are not the focal lengths of the pairs.
void VerifyWithAverages(const PairVerificationOptions& verification,
                        const std::vector<colmap::image_pair_t>& pair_ids,
                        const Scene& scene,
                        const KeypointDepthMap& depths,
                        PairGeometries* pairs,
                        StageTimer* timer) {
  std::vector<colmap::image_pair_t> sample, others;
  PairGeometries before;
  const size_t interval = pair_ids.size() / kMaxNumSampledPairs + 1;
  for (size_t i = 0; i < pair_ids.size(); ++i) {
    if (i % interval > 0) {
      others.push_back(pair_ids[i]);
      continue;
    }
    sample.push_back(pair_ids[i]);
    before[pair_ids[i]] = pairs->at(pair_ids[i]);
  }
  const auto verify = [&](const std::vector<colmap::image_pair_t>& ids) {
    VerifyAgain(
        PairStage::REVERIFICATION, verification, ids, scene, depths, pairs);
  };
  verify(sample);
  const double share = ShareOfInliersKept(before, *pairs);
  const bool is_better = share >= kMinShareOfInliersKept;
  if (is_better) {
    verify(others);
  } else {
    for (auto& [pair_id, pair] : before) pairs->at(pair_id) = std::move(pair);
  }
  timer->Add("pairs_verified", is_better ? double(pair_ids.size()) : 0)
      .Add("share_of_inliers_kept", share);
}

}  // namespace

void DropStaticBackground(const DepthGlobalMapperOptions& options,
                          const PairVerificationOptions& verification,
                          const KeypointDepthMap& depths,
                          Scene* scene,
                          PairGeometries* pairs,
                          MappingLog* log) {
  if (options.skip_static_background) return;
  const std::vector<StaticKeypoints> groups = FindStaticKeypoints(
      *scene, *pairs, kMaxMotion * verification.two_view.max_epipolar_error_px);
  if (groups.empty()) return;
  StageTimer timer("static_background");
  const size_t num_stationary =
      CountPairs(*pairs).num_with_status[PairStatus::STATIONARY];
  size_t num_groups = 0;
  for (const StaticKeypoints& keypoints : groups) {
    auto matches = MatchesThatMove(*scene, keypoints);
    PairGeometries moving = VerifyPairs(*scene, matches, depths, verification);
    PairGeometries replaced;
    for (const auto& [pair_id, pair] : moving) {
      replaced[pair_id] = pairs->at(pair_id);
    }
    if (CountMovingPairs(moving) <= CountMovingPairs(replaced)) continue;
    ++num_groups;
    for (auto& [pair_id, pair] : moving) {
      if (matches.at(pair_id).empty()) {
        scene->matches.erase(pair_id);
      } else {
        scene->matches[pair_id] = std::move(matches.at(pair_id));
      }
      pairs->at(pair_id).Replace(PairStage::STATIC_BACKGROUND, std::move(pair));
    }
  }
  timer.Add("groups", double(num_groups)).Add(CountPairs(*pairs));
  timer.Finish(&log->stages);
  if (num_groups == 0) return;
  log->Warn(std::to_string(num_stationary) + " of " +
            std::to_string(pairs->size()) +
            " pairs are stationary: most of their key points stay at their "
            "place, as those of a background behind a turntable, and are left "
            "out. Mask the background to be safe (--ImageReader.mask_path)");
}

KeypointDepthMap DropUnreliableDepths(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const Scene& scene,
    KeypointDepthMap* depths,
    PairGeometries* pairs,
    MappingLog* log) {
  KeypointDepthMap dropped;
  if (options.skip_depth_reliability) return dropped;
  StageTimer timer("depth_reliability");
  const std::vector<colmap::image_t> image_ids =
      FindUnusableDepths(scene, *pairs, *depths, log);
  for (const colmap::image_t image_id : image_ids) {
    dropped.insert(depths->extract(image_id));
  }
  const auto is_unreliable = [&](colmap::image_t image_id) {
    return std::binary_search(image_ids.begin(), image_ids.end(), image_id);
  };
  std::vector<colmap::image_pair_t> affected;
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (is_unreliable(image_id1) || is_unreliable(image_id2)) {
      affected.push_back(pair_id);
    }
  }
  VerifyAgain(PairStage::DEPTH_RELIABILITY,
              verification,
              affected,
              scene,
              *depths,
              pairs);
  timer.Add("maps_dropped", double(image_ids.size()))
      .Add("pairs_verified", double(affected.size()));
  if (!image_ids.empty()) timer.Add(CountPairs(*pairs));
  timer.Finish(&log->stages);
  return dropped;
}

void FilterPairs(const DepthGlobalMapperOptions& options,
                 const Scene& scene,
                 const PairScores& pair_scores,
                 PairGeometries* pairs,
                 MappingLog* log) {
  StageTimer timer("view_graph_filter");
  const auto num_filtered =
      ApplyPairFilters(options.view_graph,
                       scene,
                       options.skip_pair_scores ? PairScores() : pair_scores,
                       pairs);
  timer.Add(CountPairs(*pairs));
  for (const auto& [status, count] : num_filtered) {
    timer.Add(kFilteredPrefix + PairStatusName(status), double(count));
  }
  timer.Finish(&log->stages);
}

std::map<colmap::camera_t, CameraFocal> AverageFocals(
    const DepthGlobalMapperOptions& options,
    const PairVerificationOptions& verification,
    const KeypointDepthMap& depths,
    Scene* scene,
    PairGeometries* pairs,
    MappingLog* log) {
  if (options.skip_focal_averaging) return {};
  StageTimer timer("focal_averaging");
  const auto focals =
      AverageFocalsOfCameras(*pairs, options.TiesCameras(), scene);
  std::map<FocalSource, size_t> num_cameras;
  for (const auto& [camera_id, focal] : focals) ++num_cameras[focal.source];
  for (const auto& [source, count] : num_cameras) {
    timer.Add(FocalSourceName(source), double(count));
  }
  timer.Finish(&log->stages);

  if (options.skip_reverification ||
      num_cameras[FocalSource::PRIOR] == focals.size()) {
    return focals;
  }
  StageTimer reverification("reverification");
  std::vector<colmap::image_pair_t> uncertain;
  for (auto& [pair_id, pair] : *pairs) {
    if (pair.status != PairStatus::VALID || !LacksFocals(pair)) continue;
    if (HasOtherFocals(*scene, pair_id, pair)) {
      uncertain.push_back(pair_id);
    } else {
      pair.degeneracies &= ~(uint32_t(PairDegeneracy::WEAK_FOCAL1) |
                             uint32_t(PairDegeneracy::WEAK_FOCAL2));
    }
  }
  // Averages count as known for this verification alone.
  const CameraMap averaged_cameras = scene->cameras;
  for (auto& [camera_id, camera] : scene->cameras) {
    camera.SetPriorFocalLength(true);
  }
  VerifyWithAverages(
      verification, uncertain, *scene, depths, pairs, &reverification);
  scene->cameras = averaged_cameras;
  reverification.Add(CountPairs(*pairs));
  reverification.Finish(&log->stages);
  return focals;
}

void WarnOfPlanes(const Scene& scene,
                  const PairGeometries& pairs,
                  MappingLog* log) {
  size_t num_valid = 0, num_planar = 0;
  for (const auto& [pair_id, pair] : pairs) {
    if (pair.status != PairStatus::VALID) continue;
    ++num_valid;
    num_planar += pair.Has(PairDegeneracy::PLANAR);
  }
  const bool are_known = std::all_of(
      scene.cameras.begin(), scene.cameras.end(), [&](const auto& camera) {
        return camera.second.HasPriorFocalLength() ||
               FocalPriorOf(scene, camera.first).Exists();
      });
  if (are_known || double(num_planar) <= kMaxPlanarShare * double(num_valid)) {
    return;
  }
  log->Warn(std::to_string(num_planar) + " of " + std::to_string(num_valid) +
            " valid pairs see one plane only, which leaves unknown focal "
            "lengths open: focal lengths and heights may be wrong. Give focal "
            "lengths (EXIF data, or --ImageReader.camera_params and a prior), "
            "or add tilted views");
}

}  // namespace dgsfm
