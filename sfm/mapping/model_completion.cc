#include "sfm/mapping/model_completion.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/pose_access.h"
#include "colmap_ext/progress.h"
#include "sfm/mapping/image_resection.h"
#include "sfm/mapping/match_errors.h"
#include "sfm/mapping/model_access.h"
#include "sfm/mapping/model_refinement.h"
#include "sfm/mapping/stray_points.h"
#include "sfm/mapping/track_completion.h"

#include <colmap/base/correspondence_graph.h>
#include <colmap/sfm/incremental_triangulator.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace dgsfm {

namespace {

// Share of observations whose removal is worth another round of adjustment.
constexpr double kMinFilteredShare = 1e-3;
// Share of new and removed observations that is worth another round of
// retriangulation, which costs several times as much.
constexpr double kMinChangedShare = 3e-3;
// Share of new observations that may determine principal points which the model
// left open before.
constexpr double kMinGainedShare = 0.2;
// Rounds of retriangulation and adjustment.
constexpr int kMaxNumRetriangulationRounds = 2;
// Rounds of adjustment after these.
constexpr int kMaxNumFinalRounds = 3;
// Observations above which the last adjustment of a model that may drift goes
// on for a smaller share of the cost: to a decrease by a third of what one
// observation costs. Several degrees over a long chain may cost no more than
// some hundred.
constexpr double kNumObservationsOfTolerance = 3e4;

bool AreUsed(const UsedKeypoints& used,
             const colmap::Image& image1,
             const colmap::Image& image2,
             const colmap::FeatureMatch& match) {
  return IsUsed(used, image1.ImageId(), match.point2D_idx1) &&
         IsUsed(used, image2.ImageId(), match.point2D_idx2);
}

// Leaves out matches within a point of the model, which neither add to a track
// nor merge two, and those that are not to be used.
void RemoveIdleMatches(const colmap::Image& image1,
                       const colmap::Image& image2,
                       const UsedKeypoints& used,
                       colmap::FeatureMatches* matches) {
  const auto is_idle = [&](const colmap::FeatureMatch& match) {
    const colmap::Point2D& point1 = image1.Point2D(match.point2D_idx1);
    const colmap::Point2D& point2 = image2.Point2D(match.point2D_idx2);
    return (point1.HasPoint3D() && point1.Point3DId() == point2.Point3DId()) ||
           !AreUsed(used, image1, image2, match);
  };
  matches->erase(std::remove_if(matches->begin(), matches->end(), is_idle),
                 matches->end());
  matches->shrink_to_fit();
}

// Whether a match of the image's feature lies where the model projects the
// point of that feature; nothing if the feature has no point.
std::optional<bool> IsAtPointOf(const colmap::Reconstruction& model,
                                const colmap::Point2D& feature,
                                const colmap::TrackElement& match,
                                double max_error_px) {
  if (!feature.HasPoint3D()) return std::nullopt;
  return IsAtProjection(
      model, match, model.Point3D(feature.Point3DId()).XYZ(), max_error_px);
}

// Whether most matches lie where the model projects the points that their
// features have by other pairs, and at least min_num_matches do. Look-alikes
// that are displaced along the baseline do not, though they lie on epipolar
// lines.
bool AgreesWithPoints(const colmap::Reconstruction& model,
                      const colmap::Image& image1,
                      const colmap::Image& image2,
                      const colmap::FeatureMatches& matches,
                      int min_num_matches,
                      double max_error_px) {
  int num_agreeing = 0, num_judged = 0;
  const auto judge = [&](const std::optional<bool>& agrees) {
    num_judged += agrees.has_value();
    num_agreeing += agrees.value_or(false);
  };
  for (const colmap::FeatureMatch& match : matches) {
    judge(IsAtPointOf(model,
                      image1.Point2D(match.point2D_idx1),
                      {image2.ImageId(), match.point2D_idx2},
                      max_error_px));
    judge(IsAtPointOf(model,
                      image2.Point2D(match.point2D_idx2),
                      {image1.ImageId(), match.point2D_idx1},
                      max_error_px));
  }
  return num_agreeing >= min_num_matches && 2 * num_agreeing > num_judged;
}

// The inliers of the valid pairs between registered images.
AgreeingMatches InliersOf(const PairGeometries& pairs,
                          const ModelInProgress& progress) {
  const colmap::Reconstruction& model = progress.model;
  AgreeingMatches inliers;
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status != PairStatus::VALID || !IsRegistered(model, image_id1) ||
        !IsRegistered(model, image_id2)) {
      continue;
    }
    colmap::FeatureMatches& matches = inliers[pair_id];
    for (const colmap::FeatureMatch& match : pair.inlier_matches) {
      if (AreUsed(progress.used_keypoints,
                  model.Image(image_id1),
                  model.Image(image_id2),
                  match)) {
        matches.push_back(match);
      }
    }
  }
  return inliers;
}

bool IsShareOf(const colmap::Reconstruction& model,
               double min_share,
               size_t num_observations) {
  return double(num_observations) >=
         min_share * double(model.ComputeNumObservations());
}

// Tries once more where the model left all principal points open.
void FreePrincipalPointsLeftOpen(const MappingContext& context,
                                 ModelInProgress* progress,
                                 StageTimer* timer) {
  const auto& held = progress->beliefs.held_principal_points;
  const size_t num_cameras = progress->model.NumCameras();
  if (context.options.skip_self_calibration || held.size() < num_cameras) {
    return;
  }
  FreePrincipalPoints(context, progress);
  timer->Add("principal_points_freed", double(num_cameras - held.size()));
}

AgreeingMatches AgreeingMatchesOf(const MappingContext& context,
                                  const PairGeometries& pairs,
                                  const ModelInProgress& progress) {
  return MatchesThatAgree(context.scene,
                          pairs,
                          context.verification,
                          context.options.refinement,
                          progress.model,
                          progress.used_keypoints);
}

}  // namespace

AgreeingMatches MatchesThatAgree(const Scene& scene,
                                 const PairGeometries& pairs,
                                 const PairVerificationOptions& verification,
                                 const ModelRefinementOptions& refinement,
                                 const colmap::Reconstruction& model,
                                 const UsedKeypoints& used) {
  const auto keypoints = UndistortKeypoints(model, verification.num_threads);
  std::vector<colmap::image_pair_t> pair_ids;
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto pair = pairs.find(pair_id);
    if (IsRegistered(model, image_id1) && IsRegistered(model, image_id2) &&
        (pair == pairs.end() || !StaysOut(pair->second.status))) {
      pair_ids.push_back(pair_id);
    }
  }
  std::vector<std::optional<colmap::FeatureMatches>> open(pair_ids.size());
  Progress progress("Matches that agree with the model", pair_ids.size());
  ParallelFor(pair_ids.size(), verification.num_threads, [&](size_t i) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_ids[i]);
    const colmap::Image& image1 = model.Image(image_id1);
    const colmap::Image& image2 = model.Image(image_id2);
    const colmap::FeatureMatches matches = MatchesOf(scene, pair_ids[i]);
    progress.Step();
    colmap::FeatureMatches consistent =
        MatchesOfPoses(MatchErrors(model, image1, image2),
                       keypoints.at(image_id1),
                       keypoints.at(image_id2),
                       matches,
                       refinement.max_epipolar_error_px);
    if (consistent.empty() ||
        double(consistent.size()) <
            std::max<double>(
                verification.min_num_inliers,
                verification.min_inlier_ratio * double(matches.size()))) {
      return;
    }
    const auto pair = pairs.find(pair_ids[i]);
    if (pair != pairs.end() &&
        pair->second.status == PairStatus::TRANSLATION_OUTLIER &&
        !AgreesWithPoints(model,
                          image1,
                          image2,
                          consistent,
                          verification.min_num_inliers,
                          refinement.max_completion_error_px)) {
      return;
    }
    RemoveIdleMatches(image1, image2, used, &consistent);
    open[i] = std::move(consistent);
  });
  AgreeingMatches agreeing;
  for (size_t i = 0; i < pair_ids.size(); ++i) {
    if (!open[i]) continue;
    agreeing.emplace_hint(agreeing.end(), pair_ids[i], std::move(*open[i]));
  }
  return agreeing;
}

size_t Retriangulate(const ModelRefinementOptions& options,
                     const AgreeingMatches& matches,
                     colmap::Reconstruction* model) {
  colmap::CorrespondenceGraph graph;
  for (const auto& [image_id, image] : model->Images()) {
    graph.AddImage(image_id, image.NumPoints2D());
  }
  for (const auto& [pair_id, pair_matches] : matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    graph.AddCorrespondences(image_id1, image_id2, pair_matches);
  }
  colmap::IncrementalTriangulator::Options triangulation;
  triangulation.complete_max_reproj_error = options.max_completion_error_px;
  triangulation.merge_max_reproj_error = options.max_completion_error_px;
  triangulation.min_angle = std::max(options.min_triangulation_angle_deg, 1e-3);
  colmap::IncrementalTriangulator triangulator(&graph, model);
  const size_t num_before = model->ComputeNumObservations();
  Progress progress("Triangulation", model->NumRegImages());
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    ThrowIfCancelled();
    triangulator.TriangulateImage(triangulation, image_id);
    progress.Step();
  }
  triangulator.CompleteAllTracks(triangulation);
  triangulator.MergeAllTracks(triangulation);
  return model->ComputeNumObservations() - num_before;
}

void CompleteTracks(const MappingContext& context,
                    const PairGeometries& pairs,
                    ModelInProgress* progress,
                    MappingLog* log) {
  colmap::Reconstruction& model = progress->model;
  if (context.options.skip_retriangulation) {
    if (!context.options.HasFinalAdjustment()) return;
    StageTimer timer("final_adjustment");
    AdjustAgain(context, progress, &timer);
    timer.Finish(&log->stages);
    return;
  }
  if (progress->all_tracks) {
    StageTimer timer("track_completion");
    const size_t num_added = AddTracks(*progress->all_tracks,
                                       context.options.refinement,
                                       context.verification.num_threads,
                                       &model);
    progress->all_tracks.reset();
    timer.Add("observations_added", double(num_added))
        .Add("points", double(model.NumPoints3D()));
    timer.Finish(&log->stages);
  }
  size_t num_filtered = 0;
  const size_t num_before = model.ComputeNumObservations();
  for (int round = 0; round < kMaxNumRetriangulationRounds; ++round) {
    StageTimer timer("retriangulation");
    if (!context.options.skip_image_resection) {
      const ResectionSummary resection = ResectImages(context, pairs, progress);
      timer.Add("images_moved", double(resection.num_moved))
          .Add("images_registered", double(resection.num_registered));
    }
    // Better poses agree with more matches than those of the round before.
    size_t num_gained =
        Retriangulate(context.options.refinement,
                      context.options.skip_match_completion
                          ? InliersOf(pairs, *progress)
                          : AgreeingMatchesOf(context, pairs, *progress),
                      &model);
    // Points of two images that are stray would pull at the poses.
    num_gained -= std::min(num_gained,
                           RemoveStrayPoints(context.options.refinement,
                                             context.verification.num_threads,
                                             &model));
    timer.Add("observations_gained", double(num_gained));
    // In the first round, observations that are far off may pull a pose out of
    // a valley; later they are wrong.
    if (round > 0) FilterObservations(context.options.refinement, 1.0, &model);
    num_filtered = AdjustAgain(context, progress, &timer);
    if (round == 0 && num_gained >= kMinGainedShare * num_before) {
      FreePrincipalPointsLeftOpen(context, progress, &timer);
    }
    timer.Finish(&log->stages);
    if (!IsShareOf(model, kMinChangedShare, num_gained + num_filtered)) break;
  }
  // The last adjustment must be one without the observations that it has
  // shown to be wrong: all of them may pull at one camera. A model with little
  // parallax is bent by a few.
  const double min_filtered_share =
      progress->has_little_parallax ? 0 : kMinFilteredShare;
  for (int round = 0; round < kMaxNumFinalRounds && num_filtered > 0 &&
                      IsShareOf(model, min_filtered_share, num_filtered);
       ++round) {
    StageTimer timer("final_adjustment");
    num_filtered = AdjustAgain(context, progress, &timer);
    timer.Finish(&log->stages);
  }
  if (MayDrift(model)) {
    StageTimer timer("final_adjustment");
    AdjustAgain(context,
                progress,
                &timer,
                std::min(1.0,
                         kNumObservationsOfTolerance /
                             double(model.ComputeNumObservations())));
    timer.Finish(&log->stages);
  }
}

void JudgePairs(const MappingContext& context,
                const ModelInProgress& progress,
                PairGeometries* pairs) {
  if (context.options.skip_pair_judging) return;
  const colmap::Reconstruction& model = progress.model;
  const AgreeingMatches agreeing = AgreeingMatchesOf(context, *pairs, progress);
  for (auto& [pair_id, pair] : *pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (!IsRegistered(model, image_id1) || !IsRegistered(model, image_id2)) {
      continue;
    }
    if (agreeing.count(pair_id) > 0) {
      pair.Judge(PairStage::PAIR_JUDGING, PairStatus::VALID);
    } else if (pair.status == PairStatus::VALID) {
      pair.Judge(PairStage::PAIR_JUDGING, PairStatus::MODEL_OUTLIER);
    }
  }
}

}  // namespace dgsfm
