#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>

#include <Eigen/Cholesky>

// Only OpenBLAS has it.
extern "C" __attribute__((weak)) void openblas_set_num_threads(int num_threads);

namespace dgsfm {

namespace {

// Columns up to which dense matrices are as fast.
constexpr int kMaxNumColumnsDense = 500;

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
                             const std::vector<int>& order)
    : num_columns_(num_columns), is_dense_(num_columns <= kMaxNumColumnsDense) {
  if (is_dense_) {
    dense_.setZero(num_columns, num_columns);
    return;
  }
  places_.resize(order.size());
  for (size_t i = 0; i < order.size(); ++i) places_[order[i]] = int(i);
  sparse_ = SparseLowerTriangle<SparseMatrix>(
      num_columns, [&](const Coupling& couple) {
        pattern([&](int column1, int column2) {
          couple(PlaceOf(column1), PlaceOf(column2));
        });
      });
  // Sums by several threads would depend on their number.
  if (openblas_set_num_threads) openblas_set_num_threads(1);
  cholmod_common& common = cholesky_.cholmod();
  common.print = 0;
  if (!order.empty()) {
    // Values are factorised where they are, without copies in another order.
    common.nmethods = 1;
    common.method[0].ordering = CHOLMOD_NATURAL;
    common.postorder = false;
  }
  cholesky_.analyzePattern(sparse_);
}

ReducedSystem::FactorAnalysis ReducedSystem::AnalyzeFactor(
    int num_columns, const Pattern& pattern) {
  class Analysis
      : public Eigen::CholmodSupernodalLLT<SparseMatrix, Eigen::Lower> {
   public:
    const int* Order() const {
      return static_cast<const int*>(m_cholmodFactor->Perm);
    }
  };
  Analysis analysis;
  analysis.cholmod().print = 0;
  analysis.analyzePattern(
      SparseLowerTriangle<SparseMatrix>(num_columns, pattern));
  return {analysis.cholmod().lnz,
          analysis.cholmod().fl,
          {analysis.Order(), analysis.Order() + num_columns}};
}

int64_t ReducedSystem::EntryAt(const Cell& cell) const {
  const auto [column, row] = cell;
  if (is_dense_) return int64_t(column) * num_columns_ + row;
  const int* rows = sparse_.innerIndexPtr();
  const int* begin = rows + sparse_.outerIndexPtr()[column];
  const int* end = rows + sparse_.outerIndexPtr()[column + 1];
  return std::lower_bound(begin, end, row) - rows;
}

int64_t ReducedSystem::EntryNear(int64_t other_entry,
                                 const Cell& other,
                                 const Cell& cell) const {
  if (is_dense_) return EntryAt(cell);
  const int* begin = sparse_.outerIndexPtr();
  const auto [column, row] = cell;
  const int64_t guess = other_entry - begin[other.first] + begin[column] +
                        (row - other.second) - (column - other.first);
  return guess >= begin[column] && guess < begin[column + 1] &&
                 sparse_.innerIndexPtr()[guess] == row
             ? guess
             : EntryAt(cell);
}

void ReducedSystem::AddBlock(const int* columns1,
                             const int* columns2,
                             int size,
                             bool is_diagonal,
                             const double* block) {
  double* values = Values();
  int64_t entry = 0;
  Cell cell(0, 0);
  for (int j = 0; j < size; ++j) {
    if (columns2[j] < 0) continue;
    const int place2 = PlaceOf(columns2[j]);
    for (int i = 0; i < (is_diagonal ? j + 1 : size); ++i) {
      if (columns1[i] < 0) continue;
      const Cell next = std::minmax({PlaceOf(columns1[i]), place2});
      entry = EntryNear(entry, cell, next);
      cell = next;
      values[entry] += block[j * size + i];
    }
  }
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
  } else {
    cholesky_.factorize(sparse_);
    if (cholesky_.info() != Eigen::Success) return false;
    Columns ordered = right_sides;
    for (int i = 0; i < num_columns_; ++i) {
      ordered.row(PlaceOf(i)) = right_sides.row(i);
    }
    ordered = cholesky_.solve(ordered).eval();
    solution->resizeLike(ordered);
    for (int i = 0; i < num_columns_; ++i) {
      solution->row(i) = ordered.row(PlaceOf(i));
    }
  }
  return solution->allFinite();
}

template bool ReducedSystem::Solve(const Eigen::VectorXd&, Eigen::VectorXd*);
template bool ReducedSystem::Solve(const Eigen::MatrixXd&, Eigen::MatrixXd*);

}  // namespace dgsfm
