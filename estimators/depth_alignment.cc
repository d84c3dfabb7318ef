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

namespace dgsfm {
namespace {

using Points = std::vector<DepthCorrespondence>;

constexpr int kNumFolds = 5;
constexpr int kNumIterations = 8;
// Cauchy's function has 95 % of the efficiency of squares on Gaussian errors if
// its width is this many standard deviations.
constexpr double kCauchyWidth = 2.385;
// Standard deviations of a Gaussian per median absolute value.
// Below, differences of depths have no meaning.
constexpr double kMinSigma = 1e-6;
// Weights of the field's smoothness against one point per node, from nearly
// linear to nearly interpolating.
constexpr std::array<double, 6> kSmoothness = {1000, 100, 10, 1, 0.1, 0.01};

double MedianAbsolute(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return Median(std::move(values));
}

std::vector<double> CauchyWeights(const std::vector<double>& residuals) {
  const double width =
      kCauchyWidth *
      std::max(kMinSigma, kStddevPerMad * MedianAbsolute(residuals));
  std::vector<double> weights;
  weights.reserve(residuals.size());
  for (const double residual : residuals) {
    weights.push_back(1 / (1 + residual * residual / (width * width)));
  }
  return weights;
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
  for (int iteration = 0; iteration < kNumIterations; ++iteration) {
    const std::vector<double> weights =
        CauchyWeights(RelativeErrors(alignment, points));
    Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    for (size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector2d row =
          Eigen::Vector2d(points[i].map_depth, 1) / points[i].point_depth;
      normal += weights[i] * row * row.transpose();
      right += weights[i] * row;
    }
    const Eigen::Vector2d solution = normal.ldlt().solve(right);
    // A flat scene determines the scale alone.
    if (!solution.allFinite() || solution[0] <= 0 ||
        std::abs(normal.determinant()) < 1e-12 * normal(0, 0) * normal(1, 1)) {
      return FitScale(points);
    }
    alignment.scale = solution[0];
    alignment.shift = solution[1];
  }
  return alignment;
}

struct Interpolation {
  std::array<int, 4> nodes;
  std::array<double, 4> weights;
};

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
    alignment.field.assign(num_cols_ * num_rows_, 0);
    std::vector<double> targets = LogRatios(points);
    for (double& target : targets) target -= std::log(alignment.scale);
    std::vector<Interpolation> rows;
    rows.reserve(points.size());
    for (const DepthCorrespondence& point : points) {
      rows.push_back(Interpolate(num_cols_, num_rows_, point.u, point.v));
    }
    std::vector<double> residuals = targets;
    for (int iteration = 0; iteration < kNumIterations; ++iteration) {
      Solve(rows, targets, CauchyWeights(residuals), smoothness, &alignment);
      for (size_t i = 0; i < rows.size(); ++i) {
        residuals[i] = targets[i];
        for (int k = 0; k < 4; ++k) {
          residuals[i] -=
              rows[i].weights[k] * alignment.field[rows[i].nodes[k]];
        }
      }
    }
    return alignment;
  }

 private:
  void Solve(const std::vector<Interpolation>& rows,
             const std::vector<double>& targets,
             const std::vector<double>& weights,
             double smoothness,
             DepthAlignment* alignment) const {
    const double points_per_node =
        static_cast<double>(rows.size()) / energy_.rows();
    Eigen::MatrixXd normal = smoothness * points_per_node * energy_;
    Eigen::VectorXd right = Eigen::VectorXd::Zero(energy_.rows());
    for (size_t i = 0; i < rows.size(); ++i) {
      for (int k = 0; k < 4; ++k) {
        const double weight = weights[i] * rows[i].weights[k];
        right[rows[i].nodes[k]] += weight * targets[i];
        for (int l = 0; l < 4; ++l) {
          normal(rows[i].nodes[k], rows[i].nodes[l]) +=
              weight * rows[i].weights[l];
        }
      }
    }
    const Eigen::VectorXd field = normal.ldlt().solve(right);
    if (!field.allFinite()) return;
    alignment->field.assign(field.data(), field.data() + field.size());
  }

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
