#include "estimators/optimization/conjugate_gradients.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Condition number 100.
const Eigen::VectorXd kEigenvalues = Eigen::VectorXd::LinSpaced(50, 1, 100);

Eigen::VectorXd Multiply(const Eigen::VectorXd& x) {
  return kEigenvalues.cwiseProduct(x);
}

Eigen::VectorXd Divide(const Eigen::VectorXd& x) {
  return x.cwiseQuotient(kEigenvalues);
}

Eigen::VectorXd Identity(const Eigen::VectorXd& x) { return x; }

TEST(ConjugateGradients, ExactPreconditionerTakesOneStep) {
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(50);
  Eigen::VectorXd solution;
  EXPECT_TRUE(SolveByConjugateGradients(1, Multiply, Divide, b, &solution));
  // Rounding.
  EXPECT_LT((Multiply(solution) - b).norm(), 1e-14);
}

TEST(ConjugateGradients, SolutionIsOrthogonalToItsResidual) {
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(50);
  for (const int max_num_iterations : {3, 100}) {
    Eigen::VectorXd solution;
    const bool converged = SolveByConjugateGradients(
        max_num_iterations, Multiply, Identity, b, &solution);
    EXPECT_EQ(converged, max_num_iterations == 100);
    const Eigen::VectorXd residual = b - Multiply(solution);
    // Rounding.
    EXPECT_LT(std::abs(residual.dot(solution)), 1e-12);
    if (converged) {
      EXPECT_LT(residual.norm(), 1.1e-4 * b.norm());
    }
  }
}

TEST(ConjugateGradients, IndefiniteMatrixFails) {
  const auto negative = [](const Eigen::VectorXd& x) -> Eigen::VectorXd {
    return -x;
  };
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(50);
  Eigen::VectorXd solution;
  EXPECT_FALSE(SolveByConjugateGradients(10, negative, Divide, b, &solution));
  EXPECT_FALSE(SolveByConjugateGradients(10, Multiply, negative, b, &solution));
}

TEST(ConjugateGradients, NothingIsDoneWithoutRightSide) {
  Eigen::VectorXd solution;
  EXPECT_TRUE(SolveByConjugateGradients(
      10, Multiply, Divide, Eigen::VectorXd::Zero(50), &solution));
  EXPECT_EQ(solution.norm(), 0);
}

}  // namespace
}  // namespace dgsfm
