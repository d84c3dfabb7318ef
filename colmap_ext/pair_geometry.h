// The depth-aware geometry of an image pair: what the two-view stage
// estimates, the database keeps and the view graph filters.

#pragma once

#include "colmap_ext/rigid3.h"

#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// Why a pair takes part in the reconstruction (VALID) or has left it. The
// numbers are stored in databases: append, never renumber.
enum class PairStatus : int {
  VALID = 0,
  TOO_FEW_MATCHES = 1,  // fewer matches than a hypothesis needs to prove
  NO_GEOMETRY = 2,      // no relative pose found
  TOO_FEW_INLIERS = 3,
  LOW_INLIER_RATIO = 4,
  SCALE_OUT_OF_RANGE = 5,  // given by earlier versions only
  DEPTH_INCONSISTENT = 6,  // too few matches agree with the depth maps
  LOW_PAIR_SCORE = 7,      // imported score (Doppelgangers++)
  LOW_TRIPLET_SUPPORT = 8,
  ROTATION_OUTLIER = 9,
  STATIONARY = 10,           // the matches do not move, as those of a watermark
  TRANSLATION_OUTLIER = 11,  // contradicts the loops that it is part of
  MODEL_OUTLIER = 12,        // too few matches agree with the finished model
  POSITION_OUTLIER = 13,     // contradicts the positions that images were given
};

// Names as in logs and report.json.
constexpr std::pair<PairStatus, const char*> kPairStatusNames[] = {
    {PairStatus::VALID, "valid"},
    {PairStatus::TOO_FEW_MATCHES, "too_few_matches"},
    {PairStatus::NO_GEOMETRY, "no_geometry"},
    {PairStatus::TOO_FEW_INLIERS, "too_few_inliers"},
    {PairStatus::LOW_INLIER_RATIO, "low_inlier_ratio"},
    {PairStatus::SCALE_OUT_OF_RANGE, "scale_out_of_range"},
    {PairStatus::DEPTH_INCONSISTENT, "depth_inconsistent"},
    {PairStatus::LOW_PAIR_SCORE, "low_pair_score"},
    {PairStatus::LOW_TRIPLET_SUPPORT, "low_triplet_support"},
    {PairStatus::ROTATION_OUTLIER, "rotation_outlier"},
    {PairStatus::STATIONARY, "stationary"},
    {PairStatus::TRANSLATION_OUTLIER, "translation_outlier"},
    {PairStatus::MODEL_OUTLIER, "model_outlier"},
    {PairStatus::POSITION_OUTLIER, "position_outlier"}};

// E.g. "too_few_inliers"; throws std::invalid_argument for other numbers.
std::string PairStatusName(PairStatus status);

// Whether imported scores or positions excluded the pair: agreement with a
// model does not bring it back.
bool StaysOut(PairStatus status);

// A stage that decides whether a pair takes part. Names as in report.json.
enum class PairStage {
  VERIFICATION,
  STATIC_BACKGROUND,  // verified again without matches at rest
  DEPTH_RELIABILITY,  // verified again without a depth map
  VIEW_GRAPH_FILTER,  // imported scores, triplets, given positions
  REVERIFICATION,     // verified again with averaged focal lengths
  ROTATION_AVERAGING,
  ROTATION_RECOVERY,  // verified again with averaged rotations
  TRANSLATION_AVERAGING,
  PAIR_JUDGING,  // agreement with the finished model
};

// E.g. "rotation_averaging".
std::string PairStageName(PairStage stage);

struct PairVerdict {
  PairStage stage = PairStage::VERIFICATION;
  PairStatus status = PairStatus::NO_GEOMETRY;
};

// What the matches of a pair leave open: bits of PairGeometry::degeneracies,
// of which a pair may have several. The numbers are stored in databases:
// append, never renumber.
enum class PairDegeneracy : uint32_t {
  PLANAR = 1,         // a homography explains the inliers
  ROTATION_ONLY = 2,  // the translation does not differ from zero
  STATIONARY = 4,     // the inliers do not move between the images
  WEAK_FOCAL1 = 8,    // focal length 1 is neither known nor determined
  WEAK_FOCAL2 = 16,
};

// All of the above.
const std::vector<PairDegeneracy>& PairDegeneracies();

// Name as in logs and report.json, e.g. "rotation_only".
std::string PairDegeneracyName(PairDegeneracy degeneracy);

struct PairGeometry {
  // The last verdict.
  PairStatus status = PairStatus::NO_GEOMETRY;
  // Verdicts in the order of the stages, beginning with that of verification;
  // empty as long as all stages agree with it.
  std::vector<PairVerdict> verdicts;
  // Pose of image 2 relative to image 1. With has_scale the translation is in
  // units of depth map 1, otherwise of unit length or zero.
  Rigid3d cam2_from_cam1;
  // Whether depth fixes the length of the translation and scale_1_from_2.
  bool has_scale = false;
  // Multiplies depths of map 2 to give units of map 1: s_2 / s_1 (paper: s_12).
  double scale_1_from_2 = 1;
  // Focal lengths [px] used or estimated by the pair; 0 if none.
  double focal_length1_px = 0;
  double focal_length2_px = 0;
  // Whether the pair itself estimated the focal length, i.e. it is evidence.
  bool estimated_focal1 = false;
  bool estimated_focal2 = false;
  uint32_t degeneracies = 0;
  // Standard deviation of log scale_1_from_2 [1]; 0 if unknown.
  double log_scale_stddev = 0;
  // Matches put into the estimation.
  size_t num_matches = 0;
  // Matches that agree with the relative pose, and (same length) whether both
  // depth maps agree as well: 1 yes, 0 no depth to test it with. Matches that
  // contradict the depth maps are listed, with 0, only if they are not
  // filtered.
  colmap::FeatureMatches inlier_matches;
  std::vector<uint8_t> depth_verified;
  // Number of inlier matches that ReleaseInliers() freed.
  size_t num_released_inliers = 0;
  // Hash of all that the geometry was computed from, which decides whether it
  // still holds in a later run; 0 if unknown.
  uint64_t fingerprint = 0;

  bool Has(PairDegeneracy degeneracy) const {
    return degeneracies & static_cast<uint32_t>(degeneracy);
  }
  void Set(PairDegeneracy degeneracy) {
    degeneracies |= static_cast<uint32_t>(degeneracy);
  }
  size_t NumInliers() const {
    return inlier_matches.size() + num_released_inliers;
  }
  // Frees the inlier matches, whose number stays.
  void ReleaseInliers();
  // Makes it a pair without scale.
  void DropScale();
  // Sets the status, and adds a verdict if that changes it.
  void Judge(PairStage stage, PairStatus verdict);
  // Takes over a new estimate of the geometry with its status.
  void Replace(PairStage stage, PairGeometry estimate);
};

// How many pairs there are of each kind; kinds without any are left out.
struct PairTotals {
  std::map<PairStatus, size_t> num_with_status;
  std::map<PairDegeneracy, size_t> num_valid_with_degeneracy;

  void Add(PairStatus status, uint32_t degeneracies, size_t count);
};

}  // namespace dgsfm
