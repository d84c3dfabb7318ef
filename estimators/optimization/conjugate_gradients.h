// Conjugate gradients for Newton steps.

#pragma once

#include <functional>

#include <Eigen/Core>

namespace dgsfm {

using LinearFunction = std::function<Eigen::VectorXd(const Eigen::VectorXd&)>;

// Minimises x^T A x / 2 - b^T x from 0 until the steps lower it next to not at
// all (Nash and Sofer, Assessing a search direction within a truncated-Newton
// method, 1990). `multiply` is A, and `precondition` about its inverse, both
// symmetric and positive definite. The solution is orthogonal to its residual.
// False, with the solution so far, if it takes more than max_num_iterations.
[[nodiscard]] bool SolveByConjugateGradients(int max_num_iterations,
                                             const LinearFunction& multiply,
                                             const LinearFunction& precondition,
                                             const Eigen::VectorXd& b,
                                             Eigen::VectorXd* solution);

}  // namespace dgsfm
