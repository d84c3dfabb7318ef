#include "estimators/depth_alignment.h"

#include "colmap_ext/check.h"
#include "estimators/median.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/LU>
#include <Eigen/SparseCore>

namespace dgsfm {
namespace {

using Points = std::vector<DepthCorrespondence>;

constexpr int kNumFolds = 5;
constexpr int kNumIterations = 8;
// Below, differences of depths have no meaning.
constexpr double kMinSigma = 1e-6;
// Weights of the field's smoothness against one point per node, from nearly
// linear to nearly interpolating.
constexpr std::array<double, 6> kSmoothness = {1000, 100, 10, 1, 0.1, 0.01};

// A few entries per row.
using SparseRows = Eigen::SparseMatrix<double, Eigen::RowMajor>;

double MedianAbsolute(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return Median(std::move(values));
}

// Least squares of rows x = targets plus x^T energy x, reweighted for Cauchy's
// loss, whose width follows the residuals from step to step.
Eigen::VectorXd SolveReweighted(const SparseRows& rows,
                                const Eigen::VectorXd& targets,
                                const Eigen::MatrixXd& energy,
                                Eigen::VectorXd x) {
  for (int iteration = 0; iteration < kNumIterations; ++iteration) {
    const Eigen::VectorXd residuals = targets - rows * x;
    const double stddev =
        kStddevPerMad *
        MedianAbsolute({residuals.data(), residuals.data() + residuals.size()});
    const double width = kEfficientCauchyWidth * std::max(kMinSigma, stddev);
    const Eigen::VectorXd weights =
        (1 + (residuals / width).array().square()).inverse();
    const SparseRows weighted = weights.asDiagonal() * rows;
    const Eigen::MatrixXd normal =
        energy + Eigen::MatrixXd(SparseRows(rows.transpose() * weighted));
    const Eigen::VectorXd solution =
        normal.ldlt().solve(weighted.transpose() * targets);
    if (!solution.allFinite()) break;
    x = solution;
  }
  return x;
}

std::vector<double> LogRatios(const Points& points) {
  std::vector<double> ratios;
  ratios.reserve(points.size());
  for (const DepthCorrespondence& point : points) {
    ratios.push_back(std::log(point.point_depth / point.map_depth));
  }
  return ratios;
}

std::vector<double> RelativeErrors(const DepthAlignment& alignment,
                                   const Points& points) {
  std::vector<double> errors;
  errors.reserve(points.size());
  for (const DepthCorrespondence& point : points) {
    errors.push_back(alignment.Apply(point.u, point.v, point.map_depth) /
                         point.point_depth -
                     1);
  }
  return errors;
}

DepthAlignment FitScale(const Points& points) {
  DepthAlignment alignment;
  alignment.scale = std::exp(Median(LogRatios(points)));
  return alignment;
}

// Relative errors are linear in scale and shift if divided by the point's
// depth.
DepthAlignment FitScaleAndShift(const Points& points) {
  DepthAlignment alignment = FitScale(points);
  Eigen::MatrixXd rows(points.size(), 2);
  for (size_t i = 0; i < points.size(); ++i) {
    rows.row(i) << points[i].map_depth, 1;
    rows.row(i) /= points[i].point_depth;
  }
  const Eigen::Matrix2d normal = rows.transpose() * rows;
  // A flat scene determines the scale alone.
  if (normal.determinant() < 1e-12 * normal(0, 0) * normal(1, 1)) {
    return alignment;
  }
  const Eigen::VectorXd solution =
      SolveReweighted(rows.sparseView(),
                      Eigen::VectorXd::Ones(rows.rows()),
                      Eigen::Matrix2d::Zero(),
                      Eigen::Vector2d(alignment.scale, 0));
  if (solution[0] <= 0) return alignment;
  alignment.scale = solution[0];
  alignment.shift = solution[1];
  return alignment;
}

struct Interpolation {
  std::array<int, 4> nodes;
  std::array<double, 4> weights;
};

// Bilinear weights of the four nodes around a point; beyond the image those of
// its border.
Interpolation Interpolate(int num_cols, int num_rows, double u, double v) {
  const double x = std::clamp(u, 0.0, 1.0) * (num_cols - 1);
  const double y = std::clamp(v, 0.0, 1.0) * (num_rows - 1);
  const int col = std::min(static_cast<int>(x), num_cols - 2);
  const int row = std::min(static_cast<int>(y), num_rows - 2);
  const double a = x - col;
  const double b = y - row;
  const int node = row * num_cols + col;
  return {{node, node + 1, node + num_cols, node + num_cols + 1},
          {(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b}};
}

// Sum of the squared second differences of the field as a quadratic form,
// mixed ones twice, as in a thin plate's energy, and a trace of the first ones,
// without which a field far from any point would grow without bound.
Eigen::MatrixXd PlateEnergy(int num_cols, int num_rows) {
  constexpr double kMembrane = 1e-2;
  const int size = num_cols * num_rows;
  Eigen::MatrixXd energy = Eigen::MatrixXd::Zero(size, size);
  const auto add = [&](const std::vector<int>& nodes,
                       const std::vector<double>& signs,
                       double weight) {
    for (size_t i = 0; i < nodes.size(); ++i) {
      for (size_t j = 0; j < nodes.size(); ++j) {
        energy(nodes[i], nodes[j]) += weight * signs[i] * signs[j];
      }
    }
  };
  for (int row = 0; row < num_rows; ++row) {
    for (int col = 0; col < num_cols; ++col) {
      const int node = row * num_cols + col;
      const int below = node + num_cols;
      const bool has_right = col + 1 < num_cols;
      const bool has_below = row + 1 < num_rows;
      if (has_right) add({node, node + 1}, {1, -1}, kMembrane);
      if (has_below) add({node, below}, {1, -1}, kMembrane);
      if (col + 2 < num_cols) add({node, node + 1, node + 2}, {1, -2, 1}, 1);
      if (row + 2 < num_rows) {
        add({node, below, below + num_cols}, {1, -2, 1}, 1);
      }
      if (has_right && has_below) {
        add({node, node + 1, below, below + 1}, {1, -1, -1, 1}, 2);
      }
    }
  }
  return energy;
}

class FieldFitter {
 public:
  FieldFitter(int num_cols, int num_rows)
      : num_cols_(num_cols),
        num_rows_(num_rows),
        energy_(PlateEnergy(num_cols, num_rows)) {}

  DepthAlignment Fit(const Points& points, double smoothness) const {
    DepthAlignment alignment = FitScale(points);
    alignment.num_cols = num_cols_;
    alignment.num_rows = num_rows_;
    const std::vector<double> log_ratios = LogRatios(points);
    Eigen::VectorXd targets(points.size());
    std::vector<Eigen::Triplet<double>> entries;
    for (size_t i = 0; i < points.size(); ++i) {
      targets[i] = log_ratios[i] - std::log(alignment.scale);
      const Interpolation at =
          Interpolate(num_cols_, num_rows_, points[i].u, points[i].v);
      for (int k = 0; k < 4; ++k) {
        entries.emplace_back(i, at.nodes[k], at.weights[k]);
      }
    }
    SparseRows rows(points.size(), energy_.rows());
    rows.setFromTriplets(entries.begin(), entries.end());
    const double points_per_node =
        static_cast<double>(points.size()) / energy_.rows();
    const Eigen::VectorXd field =
        SolveReweighted(rows,
                        targets,
                        smoothness * points_per_node * energy_,
                        Eigen::VectorXd::Zero(energy_.rows()));
    alignment.field.assign(field.data(), field.data() + field.size());
    return alignment;
  }

 private:
  int num_cols_;
  int num_rows_;
  Eigen::MatrixXd energy_;
};

// Median absolute relative error of points that fit(others) has not seen.
template <typename Fit>
double CrossValidate(const Points& points, const Fit& fit) {
  std::vector<double> errors;
  for (int fold = 0; fold < kNumFolds; ++fold) {
    Points seen;
    Points unseen;
    for (size_t i = 0; i < points.size(); ++i) {
      (static_cast<int>(i % kNumFolds) == fold ? unseen : seen)
          .push_back(points[i]);
    }
    const std::vector<double> fold_errors = RelativeErrors(fit(seen), unseen);
    errors.insert(errors.end(), fold_errors.begin(), fold_errors.end());
  }
  return MedianAbsolute(std::move(errors));
}

DepthAlignment FitField(const Points& points, double aspect, int num_nodes) {
  const auto count = [num_nodes](double ratio) {
    return std::max(2, static_cast<int>(std::round(num_nodes * ratio)));
  };
  const FieldFitter fitter(count(std::min(1.0, aspect)),
                           count(std::min(1.0, 1 / aspect)));
  // A median of n numbers is known to about 1 / sqrt(n) of itself: what gains
  // less than that may be chance.
  const double min_gain = 1 / std::sqrt(static_cast<double>(points.size()));
  double best_residual = CrossValidate(points, FitScale);
  double best_smoothness = 0;
  for (const double smoothness : kSmoothness) {
    const double residual = CrossValidate(points, [&](const Points& seen) {
      return fitter.Fit(seen, smoothness);
    });
    if (residual < (1 - min_gain) * best_residual) {
      best_residual = residual;
      best_smoothness = smoothness;
    }
  }
  DepthAlignment alignment = best_smoothness == 0
                                 ? FitScale(points)
                                 : fitter.Fit(points, best_smoothness);
  alignment.residual = best_residual;
  return alignment;
}

bool IsDepth(double depth) { return std::isfinite(depth) && depth > 0; }

}  // namespace

bool DepthAlignmentOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("min_num_points", min_num_points, 5)
      .Within("num_nodes", num_nodes, 2, 64)
      .AreKept();
}

double DepthAlignment::Apply(double u, double v, double map_depth) const {
  double depth = scale * map_depth + shift;
  if (!field.empty()) {
    const Interpolation at = Interpolate(num_cols, num_rows, u, v);
    double log_factor = 0;
    for (int k = 0; k < 4; ++k)
      log_factor += at.weights[k] * field[at.nodes[k]];
    depth *= std::exp(log_factor);
  }
  return std::max(0.0, depth);
}

void DepthAlignment::Apply(DepthMap* depth_map) const {
  size_t i = 0;
  for (int y = 0; y < depth_map->height; ++y) {
    for (int x = 0; x < depth_map->width; ++x, ++i) {
      float& depth = depth_map->values[i];
      if (depth <= 0) continue;
      depth = static_cast<float>(Apply(
          (x + 0.5) / depth_map->width, (y + 0.5) / depth_map->height, depth));
      if (!std::isfinite(depth)) depth = 0;
    }
  }
}

void DepthAlignment::Append(const DepthAlignment& correction) {
  DGSFM_CHECK(correction.shift == 0) << correction.shift;
  scale *= correction.scale;
  shift *= correction.scale;
  if (correction.field.empty()) return;
  if (field.empty()) {
    num_cols = correction.num_cols;
    num_rows = correction.num_rows;
    field = correction.field;
    return;
  }
  DGSFM_CHECK(num_cols == correction.num_cols &&
              num_rows == correction.num_rows)
      << num_cols << " x " << num_rows;
  for (size_t i = 0; i < field.size(); ++i) field[i] += correction.field[i];
}

std::optional<DepthAlignment> AlignDepth(
    const std::vector<DepthCorrespondence>& points,
    double aspect,
    const DepthAlignmentOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(IsDepth(aspect)) << "aspect = " << aspect;
  for (const DepthCorrespondence& point : points) {
    DGSFM_CHECK(IsDepth(point.map_depth) && IsDepth(point.point_depth))
        << "depths " << point.map_depth << " and " << point.point_depth;
  }
  if (points.size() < static_cast<size_t>(options.min_num_points)) {
    return std::nullopt;
  }
  DepthAlignment alignment;
  switch (options.model) {
    case DepthAlignmentModel::SCALE:
      alignment = FitScale(points);
      alignment.residual = CrossValidate(points, FitScale);
      break;
    case DepthAlignmentModel::SCALE_SHIFT:
      alignment = FitScaleAndShift(points);
      alignment.residual = CrossValidate(points, FitScaleAndShift);
      break;
    case DepthAlignmentModel::FIELD:
      alignment = FitField(points, aspect, options.num_nodes);
      break;
  }
  alignment.num_points = points.size();
  alignment.scale_residual =
      MedianAbsolute(RelativeErrors(FitScale(points), points));
  return alignment;
}

}  // namespace dgsfm
