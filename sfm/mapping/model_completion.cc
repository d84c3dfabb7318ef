#include "sfm/mapping/model_completion.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/pose_access.h"
#include "estimators/two_view/two_view_model.h"
#include "estimators/two_view/two_view_residuals.h"
#include "sfm/mapping/model_access.h"
#include "sfm/verification/centered_point.h"

#include <colmap/sfm/incremental_triangulator.h>

#include <algorithm>
#include <cmath>

namespace dgsfm {

namespace {

// Share of observations whose removal is worth another round of adjustment.
constexpr double kMinFilteredShare = 1e-3;
// Rounds of retriangulation and adjustment.
constexpr int kMaxNumRetriangulationRounds = 2;

// Matches whose Sampson error under the poses of the model is small, each
// feature at most once, as COLMAP's correspondence graph wants them.
colmap::FeatureMatches MatchesOnEpipolarLines(
    const colmap::Reconstruction& model,
    colmap::image_t image_id1,
    colmap::image_t image_id2,
    const colmap::FeatureMatches& matches,
    double max_error_px) {
  const colmap::Image& image1 = model.Image(image_id1);
  const colmap::Image& image2 = model.Image(image_id2);
  const colmap::Camera& camera1 = model.Camera(image1.CameraId());
  const colmap::Camera& camera2 = model.Camera(image2.CameraId());
  const Rigid3d cam2_from_cam1 =
      CamFromWorld(image2) * CamFromWorld(image1).Inverse();
  TwoViewModel two_view;
  two_view.rotation = cam2_from_cam1.rotation.toRotationMatrix();
  two_view.translation = cam2_from_cam1.translation;
  two_view.focal1 = camera1.MeanFocalLength();
  two_view.focal2 = camera2.MeanFocalLength();
  const Eigen::Matrix3d F = two_view.FundamentalMatrix();
  colmap::FeatureMatches consistent;
  std::vector<bool> is_used1(image1.NumPoints2D(), false);
  std::vector<bool> is_used2(image2.NumPoints2D(), false);
  for (const colmap::FeatureMatch& match : matches) {
    const auto point1 =
        UndistortPoint(camera1, image1.Point2D(match.point2D_idx1).XY());
    const auto point2 =
        UndistortPoint(camera2, image2.Point2D(match.point2D_idx2).XY());
    if (point1 && point2 &&
        std::abs(SampsonError(F,
                              point1->point,
                              point2->point,
                              UndistortedCovariance(point1->pixel_jacobian),
                              UndistortedCovariance(point2->pixel_jacobian))) <=
            max_error_px &&
        !is_used1[match.point2D_idx1] && !is_used2[match.point2D_idx2]) {
      is_used1[match.point2D_idx1] = true;
      is_used2[match.point2D_idx2] = true;
      consistent.push_back(match);
    }
  }
  return consistent;
}

// Agreement with epipolar lines does not bring back look-alikes that an
// imported score excluded or that are displaced along the baseline.
bool StaysOut(PairStatus status) {
  return status == PairStatus::LOW_PAIR_SCORE ||
         status == PairStatus::TRANSLATION_OUTLIER;
}

// The inliers of the valid pairs between registered images.
void AddInliers(const PairGeometries& pairs,
                const colmap::Reconstruction& model,
                colmap::CorrespondenceGraph* graph) {
  for (const auto& [image_id, image] : model.Images()) {
    graph->AddImage(image_id, image.NumPoints2D());
  }
  for (const auto& [pair_id, pair] : pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (pair.status == PairStatus::VALID && IsRegistered(model, image_id1) &&
        IsRegistered(model, image_id2)) {
      graph->AddCorrespondences(image_id1, image_id2, pair.inlier_matches);
    }
  }
}

void AddAgreeingMatches(const MappingContext& context,
                        const PairGeometries& pairs,
                        const colmap::Reconstruction& model,
                        colmap::CorrespondenceGraph* graph) {
  BuildCorrespondenceGraph(context.scene,
                           pairs,
                           context.verification,
                           context.options.refinement.max_epipolar_error_px,
                           model,
                           graph);
}

}  // namespace

void BuildCorrespondenceGraph(const Scene& scene,
                              const PairGeometries& pairs,
                              const PairVerificationOptions& verification,
                              double max_epipolar_error_px,
                              const colmap::Reconstruction& model,
                              colmap::CorrespondenceGraph* graph) {
  for (const auto& [image_id, image] : model.Images()) {
    graph->AddImage(image_id, image.NumPoints2D());
  }
  for (const auto& [pair_id, matches] : scene.matches) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    const auto pair = pairs.find(pair_id);
    if (!IsRegistered(model, image_id1) || !IsRegistered(model, image_id2) ||
        (pair != pairs.end() && StaysOut(pair->second.status))) {
      continue;
    }
    const colmap::FeatureMatches consistent = MatchesOnEpipolarLines(
        model, image_id1, image_id2, matches, max_epipolar_error_px);
    if (double(consistent.size()) >=
        std::max<double>(
            verification.min_num_inliers,
            verification.min_inlier_ratio * double(matches.size()))) {
      graph->AddCorrespondences(image_id1, image_id2, consistent);
    }
  }
}

size_t Retriangulate(const ModelRefinementOptions& options,
                     const colmap::CorrespondenceGraph& graph,
                     colmap::Reconstruction* model) {
  colmap::IncrementalTriangulator::Options triangulation;
  triangulation.complete_max_reproj_error = options.max_completion_error_px;
  triangulation.merge_max_reproj_error = options.max_completion_error_px;
  triangulation.min_angle = std::max(options.min_triangulation_angle_deg, 1e-3);
  colmap::IncrementalTriangulator triangulator(&graph, model);
  const size_t num_before = model->ComputeNumObservations();
  for (const colmap::image_t image_id : SortedRegisteredImages(*model)) {
    ThrowIfCancelled();
    triangulator.TriangulateImage(triangulation, image_id);
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
  for (int round = 0; round < kMaxNumRetriangulationRounds; ++round) {
    StageTimer timer("retriangulation");
    // Better poses agree with more matches than those of the round before.
    colmap::CorrespondenceGraph graph;
    if (context.options.skip_match_completion) {
      AddInliers(pairs, model, &graph);
    } else {
      AddAgreeingMatches(context, pairs, model, &graph);
    }
    const size_t num_gained =
        Retriangulate(context.options.refinement, graph, &model);
    timer.Add("observations_gained", double(num_gained));
    const size_t num_filtered = AdjustAgain(context, progress, &timer);
    timer.Finish(&log->stages);
    const double num_observations = double(model.ComputeNumObservations());
    if (double(num_gained + num_filtered) <
        kMinFilteredShare * num_observations) {
      break;
    }
  }
}

void JudgePairs(const MappingContext& context,
                const colmap::Reconstruction& model,
                PairGeometries* pairs) {
  if (context.options.skip_pair_judging) return;
  colmap::CorrespondenceGraph graph;
  AddAgreeingMatches(context, *pairs, model, &graph);
  for (auto& [pair_id, pair] : *pairs) {
    const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
    if (!IsRegistered(model, image_id1) || !IsRegistered(model, image_id2)) {
      continue;
    }
    const bool agrees =
        graph.NumCorrespondencesBetweenImages(image_id1, image_id2) > 0;
    if (agrees) {
      pair.Judge(PairStage::PAIR_JUDGING, PairStatus::VALID);
    } else if (pair.status == PairStatus::VALID) {
      pair.Judge(PairStage::PAIR_JUDGING, PairStatus::MODEL_OUTLIER);
    }
  }
}

}  // namespace dgsfm
