// Symmetric positive definite systems of a pattern that stays.

#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include <Eigen/CholmodSupport>
#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

// The normal equations of the parameters that remain when points are
// eliminated. Factorised densely where they are small, and by a sparse Cholesky
// decomposition otherwise.
class ReducedSystem {
 public:
  // Takes a pair of columns.
  using Coupling = std::function<void(int column1, int column2)>;
  // Calls its argument with pairs of columns whose entries may be non-zero, in
  // either order and any number of times.
  using Pattern = std::function<void(const Coupling& couple)>;

  struct FactorAnalysis {
    double num_entries = 0;
    // Floating-point operations that form it.
    double num_operations = 0;
    // The columns, the first to be eliminated first.
    std::vector<int> order;
  };

  // The diagonal is always part of the pattern, which is gone through twice.
  // Columns are eliminated in an order that is found, or in the given one.
  // Throws std::runtime_error where the entries are more than can be numbered.
  ReducedSystem(int num_columns,
                const Pattern& pattern,
                const std::vector<int>& order = {});

  // Analyses the sparse factor, however few columns there are.
  static FactorAnalysis AnalyzeFactor(int num_columns, const Pattern& pattern);

  // Place of the entry of two columns, in either order, among the values. It
  // stands for both entries of the symmetric matrix.
  int64_t EntryOf(int column1, int column2) const {
    return EntryAt(std::minmax({PlaceOf(column1), PlaceOf(column2)}));
  }
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
  // Column and row of an entry of the lower triangle.
  using Cell = std::pair<int, int>;

  int64_t EntryAt(const Cell& cell) const;
  // EntryAt(cell), found from the entry of another cell: neighbouring columns
  // have mostly the same rows.
  int64_t EntryNear(int64_t other_entry,
                    const Cell& other,
                    const Cell& cell) const;
  int PlaceOf(int column) const {
    return places_.empty() ? column : places_[column];
  }

  using SparseMatrix = Eigen::SparseMatrix<double>;

  const int num_columns_;
  const bool is_dense_;
  // Place of each column in the given order; empty = its number.
  std::vector<int> places_;
  // Lower triangles.
  Eigen::MatrixXd dense_;
  SparseMatrix sparse_;
  Eigen::CholmodSupernodalLLT<SparseMatrix, Eigen::Lower> cholesky_;
};

}  // namespace dgsfm
