#include "estimators/optimization/conjugate_gradients.h"

namespace dgsfm {

namespace {

// Squared residual, preconditioned, at which the iterations end, relative to
// that of the start.
constexpr double kTolerance = 1e-8;

}  // namespace

bool SolveByConjugateGradients(int max_num_iterations,
                               const LinearFunction& multiply,
                               const LinearFunction& precondition,
                               const Eigen::VectorXd& b,
                               Eigen::VectorXd* solution) {
  *solution = Eigen::VectorXd::Zero(b.size());
  if (b.isZero(0)) return true;
  Eigen::VectorXd residual = b;
  Eigen::VectorXd direction = precondition(residual);
  double squared_norm = residual.dot(direction);
  const double max_squared_norm = kTolerance * squared_norm;
  for (int i = 1; i <= max_num_iterations; ++i) {
    const Eigen::VectorXd product = multiply(direction);
    const double curvature = direction.dot(product);
    // Rounding makes matrices indefinite that are nearly singular.
    if (!(squared_norm > 0) || !(curvature > 0)) return false;
    const double length = squared_norm / curvature;
    *solution += length * direction;
    residual -= length * product;
    const Eigen::VectorXd preconditioned = precondition(residual);
    const double next = residual.dot(preconditioned);
    if (next >= 0 && next <= max_squared_norm) return true;
    direction = preconditioned + next / squared_norm * direction;
    squared_norm = next;
  }
  return false;
}

}  // namespace dgsfm
