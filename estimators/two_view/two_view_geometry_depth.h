// Relative pose of an image pair from matches with monocular depth.
//
// Model (RePoseD, Ding 2025; DGSfM Eq. 1): a match (x1, x2) [px relative to
// the principal point] with z-depths d1, d2 satisfies
//   s d2 K2^-1 x2 = R (d1 K1^-1 x1) + t,   K = diag(f, f, 1),
// gauge: depth map 1 has scale 1, so t is in units of depth map 1 and s
// (scale_1_from_2) turns units of map 2 into units of map 1.

#pragma once

#include "colmap_ext/focal_prior.h"
#include "colmap_ext/rigid3.h"

#include <colmap/util/alignment.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

// What is known of the two focal lengths.
enum class FocalCase {
  KNOWN,       // both: calibrated
  SHARED,      // unknown, the same in both images
  TWO,         // unknown, one each
  ONE_SIDED1,  // that of image 1 is known, that of image 2 is not
  ONE_SIDED2,  // that of image 2 is known, that of image 1 is not
};

// Matches of a pair, all arrays of the same length.
struct DepthMatches {
  // Undistorted image points relative to the principal point [px]: with a
  // known focal length (x, y) = f * (X, Y) / Z of the camera, otherwise pixels
  // minus the image centre.
  std::vector<Eigen::Vector2d> points1;
  std::vector<Eigen::Vector2d> points2;
  // z-depth at the points [unit of each map]; 0 = unknown.
  std::vector<double> depths1;
  std::vector<double> depths2;
  // Derivative of the pixel in the (distorted) image by the point above, by
  // which thresholds stay in pixels of the image. Empty = identity.
  std::vector<Eigen::Matrix2d> pixel_jacobians1;
  std::vector<Eigen::Matrix2d> pixel_jacobians2;
};

struct TwoViewDepthOptions {
  // Sampson error below which a match is an inlier [px].
  double max_epipolar_error_px = 1.0;
  // Reprojection error that weighs as much as max_epipolar_error_px in the
  // refinement of the published estimator [px].
  double max_reprojection_error_px = 16.0;
  // Samples of matches; those with depth do not count if depth turns out to be
  // useless.
  int min_num_trials = 100;
  int max_num_trials = 1000;
  // Probability that no better model is left when trials stop early [1].
  double confidence = 0.9999;
  // Range of plausible focal lengths, as multiples of the larger image side.
  double min_focal_length_ratio = 0.3;
  double max_focal_length_ratio = 4.0;
  // Fewer matches with depth than this prove nothing: neither do samples with
  // depth take part nor do depths fix a scale, and a model without depth has to
  // gain so many matches over one whose depths have little noise.
  int min_num_depth_matches = 15;
  // The published estimator (two_view_published.h) instead of this project's.
  // It makes exactly max_num_trials trials and uses neither the other limits
  // of trials nor those of focal lengths and matches with depth.
  bool paper = false;

  bool IsValid(std::string* error) const;
};

struct TwoViewDepthInput {
  DepthMatches matches;
  FocalCase focal_case = FocalCase::TWO;
  // Known focal lengths, or guesses where unknown (e.g. the depth network's
  // or 1.2 x the larger side) [px]. All positive.
  double focal_length1_px = 0;
  double focal_length2_px = 0;
  // Soft priors of unknown focal lengths, by EXIF data or the depth model.
  // They replace the weak prior around the guess.
  FocalPrior focal_prior1;
  FocalPrior focal_prior2;
  // Larger image sides, for the plausible range of focal lengths [px].
  double image_size1_px = 0;
  double image_size2_px = 0;
  // Models with fewer inliers are of no use: the search for them ends early.
  int min_num_inliers = 0;
  // Rotation R by other evidence, near which the search stays; the refinement
  // is free. The published estimator does not use it.
  std::optional<Eigen::Quaterniond> rotation;
  // Seed of the pair's private random stream: derive it from the pair id.
  uint64_t seed = 0;
};

// What the matches of a pair cannot tell.
struct TwoViewDegeneracy {
  // A homography explains the inliers, and no rotation does. The pose then
  // rests on the depths; a depth-free one is one of several. Unknown focal
  // lengths are not identifiable.
  bool planar = false;
  // The translation cannot be told from zero: rotation and scale are valid,
  // the translation (and its direction above all) is not.
  bool rotation_only = false;
  // The matches do not move between the images, as those on a watermark or a
  // frame: the geometry is not that of the scene.
  bool stationary = false;
  // Whether each focal length is known, or determined by the matches.
  bool focal_identifiable1 = true;
  bool focal_identifiable2 = true;
};

struct TwoViewDepthResult {
  bool success = false;
  // Translation in units of depth map 1 if has_scale, else of unit length.
  Rigid3d cam2_from_cam1;
  bool has_scale = false;
  double scale_1_from_2 = 1;
  double focal_length1_px = 0;
  double focal_length2_px = 0;
  // Whether the focal lengths are evidence: estimated, plausible, identifiable.
  bool estimated_focal1 = false;
  bool estimated_focal2 = false;
  // Per match: Sampson inlier in front of both cameras. The published
  // estimator has those from before its last refinement, with unknown focal
  // lengths wherever they are.
  std::vector<uint8_t> inlier_mask;
  int num_inliers = 0;
  int num_trials = 0;
  // Noise of log depth over inliers, per map [1], 0 if unknown.
  double depth_noise = 0;
  TwoViewDegeneracy degeneracy;
  // Covariance of, in this order: rotation w [rad] (R <- exp(w) R), translation
  // [its unit], log scale, log focal length 1, log focal length 2. Rows of what
  // is known, or has no meaning (the scale without has_scale), are zero; both
  // rows of a shared focal length are equal. Without scale the translation
  // varies across its direction only. Only with depth and identifiable focal
  // lengths, as has_covariance tells.
  bool has_covariance = false;
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
};

// Deterministic for a given input; no global state. O(trials * matches).
// Throws std::invalid_argument on arrays of unequal length, non-finite points,
// or invalid options.
TwoViewDepthResult EstimateTwoViewGeometryWithDepth(
    const TwoViewDepthInput& input, const TwoViewDepthOptions& options);

}  // namespace dgsfm
