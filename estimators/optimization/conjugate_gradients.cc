#include "estimators/optimization/conjugate_gradients.h"

namespace dgsfm {

namespace {

// Of the decrease by all iterations so far, the share of an average one that
// the last must bring.
constexpr double kMinDecreaseShare = 1e-3;

}  // namespace

bool SolveByConjugateGradients(int max_num_iterations,
                               const LinearFunction& multiply,
                               const LinearFunction& precondition,
                               const Eigen::VectorXd& b,
                               Eigen::VectorXd* solution) {
  *solution = Eigen::VectorXd::Zero(b.size());
  Eigen::VectorXd residual = b;
  Eigen::VectorXd direction = precondition(residual);
  double squared_norm = residual.dot(direction);
  double last_value = 0;
  for (int i = 1; i <= max_num_iterations; ++i) {
    const Eigen::VectorXd product = multiply(direction);
    const double curvature = direction.dot(product);
    // At the solution, but for rounding.
    if (!(squared_norm > 0) || !(curvature > 0)) return true;
    const double length = squared_norm / curvature;
    *solution += length * direction;
    residual -= length * product;
    const double value = -0.5 * solution->dot(b + residual);
    if (i * (value - last_value) > kMinDecreaseShare * value) return true;
    last_value = value;
    const Eigen::VectorXd preconditioned = precondition(residual);
    const double next = residual.dot(preconditioned);
    direction = preconditioned + next / squared_norm * direction;
    squared_norm = next;
  }
  return false;
}

}  // namespace dgsfm
