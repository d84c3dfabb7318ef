#include "controllers/relative_depth_stage.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/scene_database.h"
#include "sfm/intrinsics/camera_calibration.h"
#include "sfm/intrinsics/prior_trust.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include <glog/logging.h>

namespace dgsfm {

namespace {

using PairSizes = DatabasePairVerifier::PairSizes;

// Pairs of an image that take part, those with most matches: more make the
// shift no better.
constexpr int kMaxNumPairsPerImage = 20;

PairSizes SelectPairs(PairSizes pairs, const KeypointDepthMap& depths) {
  std::sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) {
    return a.num_matches != b.num_matches ? a.num_matches > b.num_matches
                                          : a.pair_id < b.pair_id;
  });
  std::map<colmap::image_t, int> num_pairs;
  const auto takes = [&](colmap::image_t image_id) {
    const auto found = depths.find(image_id);
    return found != depths.end() && IsAffine(found->second.unit) &&
           num_pairs[image_id] < kMaxNumPairsPerImage;
  };
  PairSizes selected;
  for (const auto& pair : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair.pair_id);
    if (!takes(image_id1) && !takes(image_id2)) continue;
    ++num_pairs[image_id1];
    ++num_pairs[image_id2];
    selected.push_back(pair);
  }
  return selected;
}

// `options` are without depth.
PairGeometries VerifyPairs(const DepthGeometricVerifierOptions& options,
                           const Scene& scene,
                           const PairSizes& pairs) {
  const KeypointDepthMap no_depths;
  DatabasePairVerifier verifier = CreatePairVerifier(options, scene, no_depths);
  PairGeometries geometries;
  verifier.Verify(pairs, [&](colmap::image_pair_t pair_id, PairGeometry pair) {
    RestrictInliers(scene.kept_keypoints, pair_id, &pair);
    geometries[pair_id] = std::move(pair);
  });
  return geometries;
}

// Pairs of the images of `depths`, verified without depth and with averaged
// focal lengths, which the cameras of the scene have from then on.
PairGeometries VerifyWithAveragedFocals(DepthGeometricVerifierOptions options,
                                        const KeypointDepthMap& depths,
                                        Scene* scene) {
  options.use_depth = false;
  const KeypointDepthMap no_depths;
  const PairSizes selected = SelectPairs(
      CreatePairVerifier(options, *scene, no_depths).ListPairs(), depths);
  PairGeometries pairs = VerifyPairs(options, *scene, selected);
  AverageFocalsOfCameras(pairs, /*relate_cameras=*/true, scene);
  bool are_known = true;
  for (auto& [camera_id, camera] : scene->cameras) {
    are_known &= camera.HasPriorFocalLength();
    camera.SetPriorFocalLength(true);
  }
  if (are_known) return pairs;
  return VerifyPairs(options, *scene, selected);
}

void WarnOfUnusedMaps(const Scene& scene, const RelativeDepthFits& fits) {
  for (const auto& [image_id, fit] : fits) {
    const std::string& name = scene.images.at(image_id).Name();
    if (fit.fit.success) {
      VLOG(1) << "Relative depth of " << name << ": shift " << fit.fit.shift
              << " +- " << fit.fit.shift_stddev << ", noise " << fit.fit.noise
              << ", " << fit.fit.num_samples << " points of "
              << fit.fit.num_pairs << " pairs, concordance "
              << fit.fit.concordance;
      continue;
    }
    LOG(WARNING) << "The relative map of image '" << name
                 << "' is not used: " << fit.fit.reason;
  }
}

RelativeDepthFits FitMaps(const DepthGeometricVerifierOptions& options,
                          const KeypointDepthMap& depths,
                          Scene* scene,
                          StageTimer* timer) {
  const CameraMap given_cameras = scene->cameras;
  // Verification alone does not have the EXIF data of image files.
  const auto given_exif = std::exchange(scene->exif, {});
  const PairGeometries pairs = VerifyWithAveragedFocals(options, depths, scene);
  RelativeDepthFits fits =
      FitRelativeDepths(*scene, pairs, depths, AffineDepthFitOptions());
  scene->cameras = given_cameras;
  scene->exif = given_exif;
  timer->Add(CountPairs(pairs));
  return fits;
}

// The same for a scene that lacks key points, of which the fit of
// verification alone has all.
RelativeDepthFits FitMapsOfAllKeypoints(
    const DepthGeometricVerifierOptions& options, StageTimer* timer) {
  Scene scene = ReadScene(options.database_path, SceneContent::FEATURES);
  SortPriors(*PriorTrustFromName(options.intrinsics_prior), &scene);
  const KeypointDepthMap depths =
      DepthDatabase(options.database_path, DepthDatabase::Mode::READ_ONLY)
          .ReadAllKeypointDepths();
  return FitMaps(options, depths, &scene, timer);
}

}  // namespace

RelativeDepths ConvertRelativeDepths(
    const DepthGeometricVerifierOptions& options,
    Scene* scene,
    KeypointDepthMap* depths,
    std::vector<StageReport>* stages) {
  if (!HasAffineDepths(*depths)) return {};
  StageTimer timer("relative_depth");
  RelativeDepths result;
  result.fits = scene->kept_keypoints.empty()
                    ? FitMaps(options, *depths, scene, &timer)
                    : FitMapsOfAllKeypoints(options, &timer);
  WarnOfUnusedMaps(*scene, result.fits);
  result.conversions = ApplyRelativeDepthFits(result.fits, depths);
  timer.Add("maps", double(result.fits.size()))
      .Add("maps_used", double(result.conversions.size()))
      .Finish(stages);
  return result;
}

}  // namespace dgsfm
