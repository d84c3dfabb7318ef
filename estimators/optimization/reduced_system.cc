#include "estimators/optimization/reduced_system.h"

#include <algorithm>

#include <Eigen/Cholesky>
#include <Eigen/IterativeLinearSolvers>

namespace dgsfm {

namespace {

// Columns up to which, and the filled share from which, dense is faster.
constexpr int kMaxNumColumnsDense = 500;
constexpr int kMaxNumColumnsMostlyFull = 5000;
constexpr double kMinFilledShareDense = 0.3;
constexpr int kMaxNumConjugateGradientIterations = 300;
constexpr double kConjugateGradientTolerance = 1e-6;

// The sparse lower triangle of a pattern, all zero.
template <typename SparseMatrix>
SparseMatrix SparseLowerTriangle(int num_columns,
                                 std::vector<std::pair<int, int>> entries) {
  // As (column, row).
  for (auto& [column, row] : entries) {
    if (column > row) std::swap(column, row);
  }
  for (int i = 0; i < num_columns; ++i) entries.emplace_back(i, i);
  std::sort(entries.begin(), entries.end());
  entries.erase(std::unique(entries.begin(), entries.end()), entries.end());
  SparseMatrix matrix(num_columns, num_columns);
  matrix.resizeNonZeros(Eigen::Index(entries.size()));
  std::fill_n(matrix.outerIndexPtr(), num_columns + 1, 0);
  for (size_t i = 0; i < entries.size(); ++i) {
    matrix.innerIndexPtr()[i] = entries[i].second;
    ++matrix.outerIndexPtr()[entries[i].first + 1];
  }
  for (int i = 0; i < num_columns; ++i) {
    matrix.outerIndexPtr()[i + 1] += matrix.outerIndexPtr()[i];
  }
  std::fill_n(matrix.valuePtr(), matrix.nonZeros(), 0.0);
  return matrix;
}

}  // namespace

ReducedSystem::ReducedSystem(int num_columns,
                             const std::vector<std::pair<int, int>>& pattern,
                             double max_num_factor_entries)
    : num_columns_(num_columns) {
  is_dense_ = num_columns <= kMaxNumColumnsDense;
  if (!is_dense_) {
    sparse_ = SparseLowerTriangle<SparseMatrix>(num_columns, pattern);
    is_dense_ = num_columns <= kMaxNumColumnsMostlyFull &&
                double(sparse_.nonZeros()) >
                    0.5 * kMinFilledShareDense * num_columns * num_columns;
  }
  if (is_dense_) {
    sparse_ = SparseMatrix();
    dense_.setZero(num_columns, num_columns);
    return;
  }
  cholesky_.cholmod().print = 0;
  cholesky_.analyzePattern(sparse_);
  is_iterative_ = cholesky_.cholmod().lnz > max_num_factor_entries;
}

int64_t ReducedSystem::EntryOf(int column1, int column2) const {
  const auto [column, row] = std::minmax(column1, column2);
  if (is_dense_) return int64_t(column) * num_columns_ + row;
  const int* rows = sparse_.innerIndexPtr();
  const int* begin = rows + sparse_.outerIndexPtr()[column];
  const int* end = rows + sparse_.outerIndexPtr()[column + 1];
  return std::lower_bound(begin, end, row) - rows;
}

void ReducedSystem::SetZero() {
  if (is_dense_) {
    dense_.setZero();
  } else {
    std::fill_n(sparse_.valuePtr(), sparse_.nonZeros(), 0.0);
  }
}

template <typename Columns>
bool ReducedSystem::Solve(const Columns& right_sides, Columns* solution) {
  if (is_dense_) {
    // In place: what is not set anew is zeroed before the next filling.
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> llt(dense_);
    if (llt.info() != Eigen::Success) return false;
    *solution = llt.solve(right_sides);
  } else if (is_iterative_) {
    Eigen::ConjugateGradient<SparseMatrix,
                             Eigen::Lower,
                             Eigen::IncompleteCholesky<double>>
        solver;
    solver.setMaxIterations(kMaxNumConjugateGradientIterations);
    solver.setTolerance(kConjugateGradientTolerance);
    *solution = solver.compute(sparse_).solve(right_sides);
    if (solver.info() == Eigen::NumericalIssue) return false;
  } else {
    cholesky_.factorize(sparse_);
    if (cholesky_.info() != Eigen::Success) return false;
    *solution = cholesky_.solve(right_sides);
  }
  return solution->allFinite();
}

template bool ReducedSystem::Solve(const Eigen::VectorXd&, Eigen::VectorXd*);
template bool ReducedSystem::Solve(const Eigen::MatrixXd&, Eigen::MatrixXd*);

}  // namespace dgsfm
