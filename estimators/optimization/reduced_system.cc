#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>

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
                                 const ReducedSystem::Pattern& pattern) {
  // Rows of each column, some of them several times.
  std::vector<size_t> end(num_columns + 1, 1);
  end[0] = 0;
  pattern(
      [&](int column1, int column2) { ++end[std::min(column1, column2) + 1]; });
  std::partial_sum(end.begin(), end.end(), end.begin());
  std::vector<int> rows(end.back());
  std::vector<size_t> next(end.begin(), end.end() - 1);
  for (int i = 0; i < num_columns; ++i) rows[next[i]++] = i;
  pattern([&](int column1, int column2) {
    rows[next[std::min(column1, column2)]++] = std::max(column1, column2);
  });
  SparseMatrix matrix(num_columns, num_columns);
  size_t num_entries = 0;
  for (int i = 0; i < num_columns; ++i) {
    const auto begin = rows.begin() + std::ptrdiff_t(end[i]);
    std::sort(begin, rows.begin() + std::ptrdiff_t(end[i + 1]));
    const auto unique_end =
        std::unique(begin, rows.begin() + std::ptrdiff_t(end[i + 1]));
    std::copy(begin, unique_end, rows.begin() + std::ptrdiff_t(num_entries));
    num_entries += size_t(unique_end - begin);
    if (num_entries > size_t(std::numeric_limits<int>::max())) {
      throw std::runtime_error(
          "the cameras of a model share points in more than 2^31 ways: map "
          "fewer images at a time, or match each with fewer others");
    }
    matrix.outerIndexPtr()[i + 1] = int(num_entries);
  }
  matrix.resizeNonZeros(Eigen::Index(num_entries));
  std::copy_n(rows.begin(), num_entries, matrix.innerIndexPtr());
  std::fill_n(matrix.valuePtr(), num_entries, 0.0);
  return matrix;
}

}  // namespace

ReducedSystem::ReducedSystem(int num_columns,
                             const Pattern& pattern,
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

double ReducedSystem::NumFactorEntries(int num_columns,
                                       const Pattern& pattern) {
  Eigen::CholmodSupernodalLLT<SparseMatrix, Eigen::Lower> cholesky;
  cholesky.cholmod().print = 0;
  cholesky.analyzePattern(
      SparseLowerTriangle<SparseMatrix>(num_columns, pattern));
  return cholesky.cholmod().lnz;
}

int64_t ReducedSystem::EntryOf(int column1, int column2) const {
  const auto [column, row] = std::minmax(column1, column2);
  if (is_dense_) return int64_t(column) * num_columns_ + row;
  const int* rows = sparse_.innerIndexPtr();
  const int* begin = rows + sparse_.outerIndexPtr()[column];
  const int* end = rows + sparse_.outerIndexPtr()[column + 1];
  return std::lower_bound(begin, end, row) - rows;
}

void ReducedSystem::AddBlock(const int* columns1,
                             const int* columns2,
                             int size,
                             bool is_diagonal,
                             const double* block) {
  double* values = Values();
  // Where the entry of the next column of the other camera probably is.
  std::vector<int64_t> next(size, 0);
  for (int j = 0; j < size; ++j) {
    for (int i = 0; i < (is_diagonal ? j + 1 : size); ++i) {
      if (columns1[i] < 0 || columns2[j] < 0) continue;
      const int64_t entry = EntryNear(next[i], columns1[i], columns2[j]);
      values[entry] += block[j * size + i];
      next[i] = entry + 1;
    }
  }
}

int64_t ReducedSystem::EntryNear(int64_t guess,
                                 int column1,
                                 int column2) const {
  if (is_dense_) return EntryOf(column1, column2);
  const auto [column, row] = std::minmax(column1, column2);
  return guess >= sparse_.outerIndexPtr()[column] &&
                 guess < sparse_.outerIndexPtr()[column + 1] &&
                 sparse_.innerIndexPtr()[guess] == row
             ? guess
             : EntryOf(column1, column2);
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
