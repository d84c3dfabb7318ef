#include "estimators/two_view/two_view_score.h"

#include <algorithm>

namespace dgsfm {
namespace {

// Within the range of single precision.
Eigen::Matrix3f UnitMatrix(const Eigen::Matrix3d& F) {
  const double norm = F.norm();
  return (norm > 0 ? Eigen::Matrix3d(F / norm) : F).cast<float>();
}

DGSFM_INLINE FloatLanes SqNorms(const FloatLanes (&covariance)[3],
                                const FloatLanes& x,
                                const FloatLanes& y) {
  return covariance[0] * x * x + 2 * covariance[1] * x * y +
         covariance[2] * y * y;
}

// Appends the matches of a group that are selected by 1. False once there are
// `max_num`.
DGSFM_INLINE bool AppendIndices(const FloatLanes& is_selected,
                                size_t group,
                                int max_num,
                                std::vector<int>* indices) {
  for (int k = 0; k < kNumFloatLanes; ++k) {
    if (is_selected[k] == 0) continue;
    if (static_cast<int>(indices->size()) == max_num) return false;
    indices->push_back(static_cast<int>(group) * kNumFloatLanes + k);
  }
  return true;
}

}  // namespace

template <typename Scalar>
BasicCheirality<Scalar>::BasicCheirality(const TwoViewModel& model,
                                         double max_error_px)
    : ray1_in_cam2_(
          (model.rotation *
           Eigen::Vector3d(1 / model.focal1, 1 / model.focal1, 1).asDiagonal())
              .template cast<Scalar>()),
      // Within the range of single precision; only its direction counts.
      translation_(model.translation.stableNormalized().cast<Scalar>()),
      inverse_focal2_(static_cast<Scalar>(1 / model.focal2)) {
  // Both points may be off: the angle of the rays is noise below this.
  const double sine = 2 * max_error_px / std::min(model.focal1, model.focal2);
  max_sq_sine_ = static_cast<Scalar>(sine * sine);
}

template class BasicCheirality<double>;

TwoViewScorer::TwoViewScorer(const TwoViewData& data, double max_error_px)
    : max_error_px_(max_error_px),
      groups_((data.size() + kNumFloatLanes - 1) / kNumFloatLanes) {
  for (size_t i = 0; i < data.size(); ++i) {
    const TwoViewMatch& match = data[i];
    Group& group = groups_[i / kNumFloatLanes];
    const size_t k = i % kNumFloatLanes;
    for (int d = 0; d < 2; ++d) {
      group.x1[d][k] = static_cast<float>(match.x1[d]);
      group.x2[d][k] = static_cast<float>(match.x2[d]);
    }
    for (int d = 0; d < 3; ++d) {
      group.covariance1[d][k] = static_cast<float>(match.covariance1[d]);
      group.covariance2[d][k] = static_cast<float>(match.covariance2[d]);
    }
    group.is_match[k] = 1;
  }
}

DGSFM_INLINE FloatLanes TwoViewScorer::SqErrors(const float* F,
                                                const Group& group) {
  // Keeps 0 / 0 (F = 0 of a pure rotation) from becoming NaN.
  const float min_sq_norm = std::numeric_limits<float>::min();
  const FloatLanes& x1 = group.x1[0];
  const FloatLanes& y1 = group.x1[1];
  const FloatLanes& x2 = group.x2[0];
  const FloatLanes& y2 = group.x2[1];
  const FloatLanes a0 = F[0] * x1 + F[3] * y1 + F[6];
  const FloatLanes a1 = F[1] * x1 + F[4] * y1 + F[7];
  const FloatLanes a2 = F[2] * x1 + F[5] * y1 + F[8];
  const FloatLanes b0 = F[0] * x2 + F[1] * y2 + F[2];
  const FloatLanes b1 = F[3] * x2 + F[4] * y2 + F[5];
  const FloatLanes value = a0 * x2 + a1 * y2 + a2;
  return value * value /
         (SqNorms(group.covariance2, a0, a1) +
          SqNorms(group.covariance1, b0, b1) + min_sq_norm);
}

DGSFM_INLINE FloatLanes
TwoViewScorer::AreInliers(const BasicCheirality<float>& cheirality,
                          const FloatLanes& sq_errors,
                          float max_sq_error,
                          const Group& group) {
  // Not if the error is not a number.
  return sq_errors < max_sq_error
             ? group.is_match * cheirality.IsInFront(group.x1, group.x2)
             : FloatLanes{};
}

DGSFM_TARGET_CLONES
std::vector<int> TwoViewScorer::Near(const Eigen::Matrix3d& F,
                                     double max_error_px,
                                     int max_num) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(F);
  const float max_sq_error = static_cast<float>(max_error_px * max_error_px);
  // Matches are in random order, so that the first are a fair sample.
  std::vector<int> near;
  for (size_t i = 0; i < groups_.size(); ++i) {
    const FloatLanes is_near =
        SqErrors(unit_F.data(), groups_[i]) < max_sq_error ? groups_[i].is_match
                                                           : FloatLanes{};
    if (!AppendIndices(is_near, i, max_num, &near)) break;
  }
  return near;
}

DGSFM_TARGET_CLONES
std::vector<int> TwoViewScorer::Inliers(const TwoViewModel& model,
                                        int max_num) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(model.FundamentalMatrix());
  const BasicCheirality<float> cheirality(model, max_error_px_);
  const float max_sq_error = static_cast<float>(max_error_px_ * max_error_px_);
  std::vector<int> inliers;
  for (size_t i = 0; i < groups_.size(); ++i) {
    const Group& group = groups_[i];
    const FloatLanes is_inlier = AreInliers(
        cheirality, SqErrors(unit_F.data(), group), max_sq_error, group);
    if (!AppendIndices(is_inlier, i, max_num, &inliers)) break;
  }
  return inliers;
}

DGSFM_TARGET_CLONES
TwoViewScore TwoViewScorer::Score(const TwoViewModel& model,
                                  double max_cost) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(model.FundamentalMatrix());
  const BasicCheirality<float> cheirality(model, max_error_px_);
  const float max_sq_error = static_cast<float>(max_error_px_ * max_error_px_);
  FloatLanes num_inliers = {};
  TwoViewScore score;
  score.cost = 0;
  for (const Group& group : groups_) {
    const FloatLanes sq_errors = SqErrors(unit_F.data(), group);
    const FloatLanes is_inlier =
        AreInliers(cheirality, sq_errors, max_sq_error, group);
    num_inliers += is_inlier;
    score.cost +=
        Sum(is_inlier > 0.0f ? sq_errors : group.is_match * max_sq_error);
    // Most samples are bad and end after a group or two.
    if (score.cost > max_cost) return {};
  }
  score.num_inliers = static_cast<int>(Sum(num_inliers));
  return score;
}

DGSFM_TARGET_CLONES
TwoViewScore TwoViewScorer::Score(const Eigen::Matrix3d& F,
                                  double max_cost) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(F);
  const float max_sq_error = static_cast<float>(max_error_px_ * max_error_px_);
  FloatLanes num_inliers = {};
  TwoViewScore score;
  score.cost = 0;
  for (const Group& group : groups_) {
    const FloatLanes sq_errors = SqErrors(unit_F.data(), group);
    const FloatLanes is_inlier =
        sq_errors < max_sq_error ? group.is_match : FloatLanes{};
    num_inliers += is_inlier;
    score.cost +=
        Sum(is_inlier > 0.0f ? sq_errors : group.is_match * max_sq_error);
    if (score.cost > max_cost) return {};
  }
  score.num_inliers = static_cast<int>(Sum(num_inliers));
  return score;
}

}  // namespace dgsfm
