// Symmetric positive definite systems of a pattern that stays.

#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/CholmodSupport>
#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

// The normal equations of the parameters that remain when points are
// eliminated. Factorised densely where they are small or mostly full, by a
// sparse Cholesky decomposition otherwise, and solved by conjugate gradients
// where that would fill up the memory.
class ReducedSystem {
 public:
  // Entries of a factor that is formed: 1.6 GB.
  static constexpr double kMaxNumFactorEntries = 2e8;

  // `pattern`: pairs of columns, in either order and any number of times, whose
  // entries may be non-zero; the diagonal is always part of it. Above
  // `max_num_factor_entries` a sparse factor is not formed.
  ReducedSystem(int num_columns,
                const std::vector<std::pair<int, int>>& pattern,
                double max_num_factor_entries = kMaxNumFactorEntries);

  int NumColumns() const { return num_columns_; }
  // Place of the entry of two columns, in either order, among the values. It
  // stands for both entries of the symmetric matrix.
  int64_t EntryOf(int column1, int column2) const;
  double* Values() { return is_dense_ ? dense_.data() : sparse_.valuePtr(); }
  void SetZero();

  // One column a right side; vectors and matrices. False if the matrix is not
  // positive definite.
  template <typename Columns>
  [[nodiscard]] bool Solve(const Columns& right_sides, Columns* solution);

 private:
  using SparseMatrix = Eigen::SparseMatrix<double>;

  int num_columns_;
  bool is_dense_;
  // Lower triangles.
  Eigen::MatrixXd dense_;
  SparseMatrix sparse_;
  bool is_iterative_ = false;
  Eigen::CholmodSupernodalLLT<SparseMatrix, Eigen::Lower> cholesky_;
};

}  // namespace dgsfm
