// Losses of reprojection errors, by which wrong observations count little.

#pragma once

#include <cmath>

namespace dgsfm {

struct RobustLoss {
  // rho(s) of a squared error s, at scale a.
  enum class Type {
    // 2 a^2 (sqrt(1 + s / a^2) - 1), which grows linearly with large errors.
    SOFT_L1,
    // a^2 log(1 + s / a^2), whose pull decreases with large errors.
    CAUCHY,
  };

  Type type = Type::SOFT_L1;
  // In the unit of the errors, above 0.
  double scale = 1;

  // rho(s) / 2.
  double Cost(double squared_error) const {
    const double squared_scale = scale * scale;
    const double ratio = squared_error / squared_scale;
    return type == Type::SOFT_L1 ? squared_scale * (std::sqrt(1 + ratio) - 1)
                                 : 0.5 * squared_scale * std::log1p(ratio);
  }

  // The square root of the derivative of rho(s), by which residuals and their
  // derivatives are multiplied.
  double RootWeight(double squared_error) const {
    const double root = std::sqrt(1 + squared_error / (scale * scale));
    return 1 / (type == Type::SOFT_L1 ? std::sqrt(root) : root);
  }
};

}  // namespace dgsfm
