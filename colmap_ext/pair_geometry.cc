#include "colmap_ext/pair_geometry.h"

#include "colmap_ext/check.h"

namespace dgsfm {

std::string PairStatusName(PairStatus status) {
  switch (status) {
    case PairStatus::VALID:
      return "valid";
    case PairStatus::TOO_FEW_MATCHES:
      return "too_few_matches";
    case PairStatus::NO_GEOMETRY:
      return "no_geometry";
    case PairStatus::TOO_FEW_INLIERS:
      return "too_few_inliers";
    case PairStatus::LOW_INLIER_RATIO:
      return "low_inlier_ratio";
    case PairStatus::SCALE_OUT_OF_RANGE:
      return "scale_out_of_range";
    case PairStatus::DEPTH_INCONSISTENT:
      return "depth_inconsistent";
    case PairStatus::LOW_PAIR_SCORE:
      return "low_pair_score";
    case PairStatus::LOW_TRIPLET_SUPPORT:
      return "low_triplet_support";
    case PairStatus::ROTATION_OUTLIER:
      return "rotation_outlier";
  }
  throw std::invalid_argument("unknown pair status " +
                              std::to_string(static_cast<int>(status)));
}

PairGeometry PairGeometry::Inverse() const {
  DGSFM_CHECK(scale_1_from_2 > 0) << "scale_1_from_2 = " << scale_1_from_2;
  PairGeometry inverse = *this;
  if (has_scale) {
    inverse.cam2_from_cam1 = InverseScaledPose(cam2_from_cam1, scale_1_from_2);
    inverse.scale_1_from_2 = 1 / scale_1_from_2;
  } else {
    inverse.cam2_from_cam1 = cam2_from_cam1.Inverse();
  }
  std::swap(inverse.focal_length1_px, inverse.focal_length2_px);
  std::swap(inverse.estimated_focal1, inverse.estimated_focal2);
  for (colmap::FeatureMatch& match : inverse.inlier_matches) {
    std::swap(match.point2D_idx1, match.point2D_idx2);
  }
  return inverse;
}

void PairGeometry::DropScale() {
  has_scale = false;
  scale_1_from_2 = 1;
  cam2_from_cam1.translation.stableNormalize();
}

}  // namespace dgsfm
