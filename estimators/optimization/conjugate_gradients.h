// Conjugate gradients for Newton steps.

#pragma once

#include <functional>

#include <Eigen/Core>

namespace dgsfm {

using LinearFunction = std::function<Eigen::VectorXd(const Eigen::VectorXd&)>;

// Solves A x = b from 0 until the preconditioned residual is small. `multiply`
// is A, and `precondition` about its inverse, both symmetric and positive
// definite. The solution is orthogonal to its residual. False, with the
// solution so far, if it takes more than max_num_iterations, or one of the
// matrices turns out not to be positive definite.
[[nodiscard]] bool SolveByConjugateGradients(int max_num_iterations,
                                             const LinearFunction& multiply,
                                             const LinearFunction& precondition,
                                             const Eigen::VectorXd& b,
                                             Eigen::VectorXd* solution);

}  // namespace dgsfm
