#include "estimators/two_view/two_view_score.h"

#include <algorithm>

namespace dgsfm {
namespace {

// Within the range of single precision.
Eigen::Matrix3f UnitMatrix(const Eigen::Matrix3d& F) {
  const double norm = F.norm();
  return (norm > 0 ? Eigen::Matrix3d(F / norm) : F).cast<float>();
}

}  // namespace

Cheirality::Cheirality(const TwoViewModel& model, double max_error_px)
    : ray1_in_cam2_(
          model.rotation *
          Eigen::Vector3d(1 / model.focal1, 1 / model.focal1, 1).asDiagonal()),
      translation_(model.translation),
      inverse_focal2_(1 / model.focal2) {
  // Both points may be off: the angle of the rays is noise below this.
  const double sine = 2 * max_error_px / std::min(model.focal1, model.focal2);
  max_sq_sine_ = sine * sine;
}

bool Cheirality::operator()(const Eigen::Vector2d& x1,
                            const Eigen::Vector2d& x2) const {
  const Eigen::Vector3d p = ray1_in_cam2_ * x1.homogeneous();
  const Eigen::Vector3d q(
      x2.x() * inverse_focal2_, x2.y() * inverse_focal2_, 1);
  const double pp = p.squaredNorm();
  const double qq = q.squaredNorm();
  const double pq = p.dot(q);
  const double pt = p.dot(translation_);
  const double qt = q.dot(translation_);
  // z1 p + t = z2 q in the least-squares sense, times pp qq - pq^2 >= 0.
  if (pq * qt > qq * pt && pp * qt > pq * pt) return true;
  return pq > 0 && pp * qq - pq * pq < max_sq_sine_ * pp * qq;
}

TwoViewScorer::TwoViewScorer(const TwoViewData& data, double max_error_px)
    : data_(data), max_error_px_(max_error_px) {
  const int size = static_cast<int>(data.size() + kBlock - 1) / kBlock * kBlock;
  x1_ = y1_ = x2_ = y2_ = Eigen::ArrayXf::Zero(size);
  covariances1_ = covariances2_ = Eigen::ArrayX3f::Zero(size, 3);
  for (size_t i = 0; i < data.size(); ++i) {
    const TwoViewMatch& match = data[i];
    x1_(i) = static_cast<float>(match.x1.x());
    y1_(i) = static_cast<float>(match.x1.y());
    x2_(i) = static_cast<float>(match.x2.x());
    y2_(i) = static_cast<float>(match.x2.y());
    covariances1_.row(i) = match.covariance1.cast<float>().transpose();
    covariances2_.row(i) = match.covariance2.cast<float>().transpose();
    has_unit_covariances_ &= match.covariance1 == UnitPointCovariance() &&
                             match.covariance2 == UnitPointCovariance();
  }
}

TwoViewScorer::Values TwoViewScorer::SqErrors(const Eigen::Matrix3f& F,
                                              int begin) const {
  // Keeps 0 / 0 (F = 0 of a pure rotation) from becoming NaN.
  const float min_sq_norm = std::numeric_limits<float>::min();
  const auto x1 = x1_.segment<kBlock>(begin);
  const auto y1 = y1_.segment<kBlock>(begin);
  const auto x2 = x2_.segment<kBlock>(begin);
  const auto y2 = y2_.segment<kBlock>(begin);
  const Values a0 = F(0, 0) * x1 + F(0, 1) * y1 + F(0, 2);
  const Values a1 = F(1, 0) * x1 + F(1, 1) * y1 + F(1, 2);
  const Values b0 = F(0, 0) * x2 + F(1, 0) * y2 + F(2, 0);
  const Values b1 = F(0, 1) * x2 + F(1, 1) * y2 + F(2, 1);
  const Values value =
      a0 * x2 + a1 * y2 + (F(2, 0) * x1 + F(2, 1) * y1 + F(2, 2));
  if (has_unit_covariances_) {
    return value.square() / (a0.square() + a1.square() + b0.square() +
                             b1.square() + min_sq_norm);
  }
  const auto sq_norm = [begin](const Eigen::ArrayX3f& covariances,
                               const Values& u,
                               const Values& v) -> Values {
    return covariances.col(0).segment<kBlock>(begin) * u.square() +
           2 * covariances.col(1).segment<kBlock>(begin) * u * v +
           covariances.col(2).segment<kBlock>(begin) * v.square();
  };
  return value.square() / (sq_norm(covariances2_, a0, a1) +
                           sq_norm(covariances1_, b0, b1) + min_sq_norm);
}

std::vector<int> TwoViewScorer::Near(const Eigen::Matrix3d& F,
                                     double max_error_px,
                                     int max_num) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(F);
  const float max_sq_error = static_cast<float>(max_error_px * max_error_px);
  // Matches are in random order, so that the first are a fair sample.
  std::vector<int> near;
  for (int begin = 0; begin < NumMatches(); begin += kBlock) {
    const Values sq_errors = SqErrors(unit_F, begin);
    const int size = std::min(kBlock, NumMatches() - begin);
    for (int k = 0; k < size; ++k) {
      if (!(sq_errors(k) < max_sq_error)) continue;
      if (static_cast<int>(near.size()) == max_num) return near;
      near.push_back(begin + k);
    }
  }
  return near;
}

TwoViewScore TwoViewScorer::Score(const TwoViewModel& model,
                                  double max_cost) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(model.FundamentalMatrix());
  const Cheirality is_in_front(model, max_error_px_);
  const float max_sq_error = static_cast<float>(max_error_px_ * max_error_px_);
  TwoViewScore score;
  score.cost = 0;
  for (int begin = 0; begin < NumMatches(); begin += kBlock) {
    const Values sq_errors = SqErrors(unit_F, begin);
    const int size = std::min(kBlock, NumMatches() - begin);
    for (int k = 0; k < size; ++k) {
      const TwoViewMatch& match = data_[begin + k];
      // Also if it is not a number.
      if (!(sq_errors(k) < max_sq_error) || !is_in_front(match.x1, match.x2)) {
        score.cost += max_sq_error;
        continue;
      }
      score.cost += sq_errors(k);
      ++score.num_inliers;
    }
    // Most samples are bad and end after a block or two.
    if (score.cost > max_cost) return {};
  }
  return score;
}

TwoViewScore TwoViewScorer::Score(const Eigen::Matrix3d& F,
                                  double max_cost) const {
  const Eigen::Matrix3f unit_F = UnitMatrix(F);
  const float max_sq_error = static_cast<float>(max_error_px_ * max_error_px_);
  TwoViewScore score;
  score.cost = 0;
  for (int begin = 0; begin < NumMatches(); begin += kBlock) {
    Values costs = SqErrors(unit_F, begin).min(max_sq_error);
    const int num_padding = std::max(0, begin + kBlock - NumMatches());
    costs.tail(num_padding).setConstant(max_sq_error);
    for (int k = 0; k < kBlock; ++k) {
      score.num_inliers += costs(k) < max_sq_error;
    }
    score.cost += costs.sum() - num_padding * max_sq_error;
    if (score.cost > max_cost) return {};
  }
  return score;
}

}  // namespace dgsfm
