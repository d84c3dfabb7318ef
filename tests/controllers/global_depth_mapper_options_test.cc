#include "controllers/global_depth_mapper_options.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Values of the paper (Sec. 4, appendix), whatever the defaults become.
TEST(PaperPreset, SetsEachValueOfTheVerification) {
  GlobalDepthMapperOptions options;
  PairVerificationOptions& pairs = options.verifier.verification;
  pairs.two_view.max_epipolar_error_px = 7;
  pairs.two_view.max_reprojection_error_px = 7;
  pairs.two_view.min_num_trials = 7;
  pairs.two_view.max_num_trials = 7;
  pairs.filter_depth = false;
  pairs.depth_consistency.max_reprojection_error_px = 7;
  pairs.depth_consistency.max_depth_error_ratio = 7;
  pairs.min_num_inliers = 7;
  pairs.min_inlier_ratio = 0.7;
  ApplyPaperPreset(&options);
  EXPECT_TRUE(pairs.two_view.paper);
  EXPECT_EQ(pairs.two_view.max_epipolar_error_px, 1);
  EXPECT_EQ(pairs.two_view.max_reprojection_error_px, 16);
  EXPECT_EQ(pairs.two_view.min_num_trials, 1000);
  EXPECT_EQ(pairs.two_view.max_num_trials, 1000);
  EXPECT_TRUE(pairs.filter_depth);
  EXPECT_EQ(pairs.depth_consistency.max_reprojection_error_px, 12);
  EXPECT_EQ(pairs.depth_consistency.max_depth_error_ratio, 0.3);
  EXPECT_FALSE(pairs.depth_consistency.tolerate_depth_error);
  EXPECT_EQ(pairs.depth_noise_factor, 0);
  EXPECT_EQ(pairs.min_num_inliers, 15);
  EXPECT_EQ(pairs.min_inlier_ratio, 0.25);
}

TEST(PaperPreset, SetsEachValueBeforePositioning) {
  GlobalDepthMapperOptions options;
  DepthGlobalMapperOptions& mapper = options.mapper;
  mapper.view_graph.min_pair_score = 0.7;
  mapper.averaging.scale_averaging.max_num_irls_iterations = 7;
  mapper.tracks.min_num_views_per_track = 7;
  mapper.tracks.min_num_tracks_per_view = 7;
  mapper.position_initialization.use_depth = false;
  ApplyPaperPreset(&options);
  EXPECT_EQ(mapper.view_graph.min_pair_score, 0.8);
  EXPECT_EQ(mapper.view_graph.min_triplet_support, 0.6);
  EXPECT_EQ(mapper.averaging.scale_averaging.max_num_irls_iterations, 30);
  EXPECT_EQ(mapper.tracks.min_num_views_per_track, 3);
  EXPECT_EQ(mapper.tracks.min_num_tracks_per_view, 0);
  EXPECT_TRUE(mapper.position_initialization.use_depth);
  EXPECT_FALSE(mapper.skip_scale_averaging);
  EXPECT_FALSE(mapper.skip_global_positioning);
  EXPECT_TRUE(mapper.skip_depth_reliability);
  EXPECT_TRUE(mapper.skip_reverification);
  EXPECT_TRUE(mapper.skip_translation_averaging);
  EXPECT_TRUE(mapper.skip_rotation_recovery);
  EXPECT_TRUE(mapper.skip_one_center_start);
  EXPECT_TRUE(mapper.skip_retriangulation);
  EXPECT_TRUE(mapper.skip_self_calibration);
  EXPECT_TRUE(mapper.skip_loss_adaptation);
  EXPECT_TRUE(mapper.skip_pair_judging);
  EXPECT_TRUE(mapper.averaging.skip_alternatives);
  EXPECT_FALSE(options.use_exif);
  EXPECT_EQ(options.max_num_keypoints_per_image, 0);
}

TEST(PaperPreset, SetsEachValueOfTheRefinement) {
  GlobalDepthMapperOptions options;
  ModelRefinementOptions& refinement = options.mapper.refinement;
  BundleAdjustmentOptions& adjustment = refinement.bundle_adjustment;
  refinement.global_positioning.max_num_iterations = 7;
  refinement.num_bundle_adjustment_rounds = 7;
  adjustment.max_num_iterations = 7;
  adjustment.intrinsics.refine_focal_length = false;
  ApplyPaperPreset(&options);
  EXPECT_EQ(refinement.global_positioning.max_num_iterations, 100);
  EXPECT_EQ(refinement.global_positioning.function_tolerance, 1e-6);
  EXPECT_EQ(refinement.num_bundle_adjustment_rounds, 3);
  EXPECT_EQ(refinement.min_num_triangulated_per_image, 0);
  EXPECT_FALSE(refinement.refine_principal_point);
  EXPECT_EQ(adjustment.max_num_iterations, 100);
  EXPECT_EQ(adjustment.function_tolerance, 1e-6);
  EXPECT_EQ(adjustment.loss_scale_px, 1);
  EXPECT_TRUE(adjustment.intrinsics.refine_focal_length);
  EXPECT_FALSE(adjustment.intrinsics.refine_extra_params);
  EXPECT_FALSE(adjustment.intrinsics.refine_principal_point);
}

}  // namespace
}  // namespace dgsfm
