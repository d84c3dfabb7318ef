#include "estimators/optimization/reduced_system.h"

#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A diagonally dominant chain with each column coupled to the next `reach`
// columns and to one farther off, so that factors fill in.
double ErrorOfChain(
    int num_columns,
    int reach,
    double max_num_factor_entries = ReducedSystem::kMaxNumFactorEntries) {
  std::vector<std::pair<int, int>> pattern;
  for (int i = 0; i < num_columns; ++i) {
    for (int j = i + 1; j <= std::min(i + reach, num_columns - 1); ++j) {
      pattern.emplace_back(j % 2 ? i : j, j % 2 ? j : i);
    }
    if (i + 10 * reach < num_columns) pattern.emplace_back(i, i + 10 * reach);
  }
  ReducedSystem system(num_columns, pattern, max_num_factor_entries);
  Eigen::MatrixXd expected =
      (2 * reach + 3) * Eigen::MatrixXd::Identity(num_columns, num_columns);
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  system.SetZero();
  for (int i = 0; i < num_columns; ++i) {
    system.Values()[system.EntryOf(i, i)] += expected(i, i);
  }
  for (const auto& [i, j] : pattern) {
    expected(i, j) = expected(j, i) = uniform(rng);
    system.Values()[system.EntryOf(i, j)] += expected(i, j);
  }
  const Eigen::VectorXd solution = Eigen::VectorXd::Random(num_columns);
  Eigen::VectorXd estimate;
  const Eigen::VectorXd right_side = expected * solution;
  if (!system.Solve(right_side, &estimate)) return INFINITY;
  return (estimate - solution).norm() / solution.norm();
}

// Well conditioned: errors are rounding.
TEST(ReducedSystem, SmallSystemIsSolved) {
  EXPECT_LT(ErrorOfChain(20, 3), 1e-12);
}

TEST(ReducedSystem, SparseSystemIsSolved) {
  EXPECT_LT(ErrorOfChain(1000, 3), 1e-12);
}

TEST(ReducedSystem, MostlyFullSystemIsSolved) {
  EXPECT_LT(ErrorOfChain(600, 400), 1e-12);
}

TEST(ReducedSystem, SystemWithLargeFactorIsSolvedIteratively) {
  const double error = ErrorOfChain(1000, 3, /*max_num_factor_entries=*/100);
  // The iterations end at a relative residual of 1e-6, of well conditioned
  // equations, and do not hit the exact solution.
  EXPECT_LT(error, 1e-5);
  EXPECT_GT(error, 1e-12);
}

TEST(ReducedSystem, IndefiniteMatrixFails) {
  for (const int num_columns : {2, 1000}) {
    ReducedSystem system(num_columns, {{0, 1}});
    system.SetZero();
    for (int i = 0; i < num_columns; ++i) {
      system.Values()[system.EntryOf(i, i)] = 1;
    }
    system.Values()[system.EntryOf(1, 0)] = 2;
    Eigen::VectorXd solution;
    EXPECT_FALSE(system.Solve(
        Eigen::VectorXd(Eigen::VectorXd::Ones(num_columns)), &solution));
  }
}

}  // namespace
}  // namespace dgsfm
