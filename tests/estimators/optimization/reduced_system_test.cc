#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <numeric>
#include <random>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A diagonally dominant chain with each column coupled to the next `reach`
// columns and to one farther off, so that factors fill in.
double ErrorOfChain(int num_columns,
                    int reach,
                    const std::vector<int>& order = {}) {
  std::vector<std::pair<int, int>> pattern;
  for (int i = 0; i < num_columns; ++i) {
    for (int j = i + 1; j <= std::min(i + reach, num_columns - 1); ++j) {
      pattern.emplace_back(j % 2 ? i : j, j % 2 ? j : i);
    }
    if (i + 10 * reach < num_columns) pattern.emplace_back(i, i + 10 * reach);
  }
  ReducedSystem system(
      num_columns,
      [&](const auto& couple) {
        for (const auto& [column1, column2] : pattern) couple(column1, column2);
      },
      order);
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

TEST(ReducedSystem, AnyOrderOfColumnsGivesTheSameSolution) {
  std::vector<int> order(1000);
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937(2));
  EXPECT_LT(ErrorOfChain(1000, 3, order), 1e-12);
  order.resize(600);
  std::iota(order.rbegin(), order.rend(), 0);
  EXPECT_LT(ErrorOfChain(600, 400, order), 1e-12);
}

TEST(ReducedSystem, IndefiniteMatrixFails) {
  for (const int num_columns : {2, 1000}) {
    ReducedSystem system(num_columns, [](const auto& couple) { couple(0, 1); });
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
