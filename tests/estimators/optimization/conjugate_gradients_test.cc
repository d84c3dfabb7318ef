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
  EXPECT_FALSE(SolveByConjugateGradients(1, Multiply, Divide, b, &solution));
  // Rounding.
  EXPECT_LT((Multiply(solution) - b).norm(), 1e-14);
  EXPECT_TRUE(SolveByConjugateGradients(2, Multiply, Divide, b, &solution));
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
    // The last of n steps lowers the quadratic form by less than 0.1 % of an
    // average one; a condition number of 100 makes errors fall by a factor of
    // 0.8 a step or more.
    if (converged) {
      EXPECT_LT(residual.norm(), 0.1 * b.norm());
    }
  }
}

TEST(ConjugateGradients, NothingIsDoneWithoutRightSide) {
  Eigen::VectorXd solution;
  EXPECT_TRUE(SolveByConjugateGradients(
      10, Multiply, Divide, Eigen::VectorXd::Zero(50), &solution));
  EXPECT_EQ(solution.norm(), 0);
}

}  // namespace
}  // namespace dgsfm
