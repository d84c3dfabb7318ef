// Symmetric positive definite systems of a pattern that stays.

#pragma once

#include <cstdint>
#include <functional>
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

  // Takes a pair of columns.
  using Coupling = std::function<void(int column1, int column2)>;
  // Calls its argument with pairs of columns whose entries may be non-zero, in
  // either order and any number of times.
  using Pattern = std::function<void(const Coupling& couple)>;

  // The diagonal is always part of the pattern, which is gone through twice.
  // Above `max_num_factor_entries` a sparse factor is not formed. Throws
  // std::runtime_error where the entries are more than can be numbered.
  ReducedSystem(int num_columns,
                const Pattern& pattern,
                double max_num_factor_entries = kMaxNumFactorEntries);

  // Entries of the sparse factor of so many columns, whatever their number.
  static double NumFactorEntries(int num_columns, const Pattern& pattern);

  int NumColumns() const { return num_columns_; }
  // Place of the entry of two columns, in either order, among the values. It
  // stands for both entries of the symmetric matrix.
  int64_t EntryOf(int column1, int column2) const;
  // Adds a square block, of the columns of one camera by those of another and
  // column by column, to the entries of their columns; those below 0 have none.
  // A block on the diagonal counts by its upper triangle alone.
  void AddBlock(const int* columns1,
                const int* columns2,
                int size,
                bool is_diagonal,
                const double* block);
  double* Values() { return is_dense_ ? dense_.data() : sparse_.valuePtr(); }
  void SetZero();

  // One column a right side; vectors and matrices. False if the matrix is not
  // positive definite.
  template <typename Columns>
  [[nodiscard]] bool Solve(const Columns& right_sides, Columns* solution);

 private:
  // EntryOf(column1, column2), which may be the guess.
  int64_t EntryNear(int64_t guess, int column1, int column2) const;

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
