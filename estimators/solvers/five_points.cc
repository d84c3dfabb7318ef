#include "estimators/solvers/five_points.h"

#include "estimators/solvers/polynomial_lanes.h"

#include <cmath>

#include <Eigen/Geometry>

namespace dgsfm {
namespace {

// Polynomials in x, y, z by their monomials:
//   1: x y z 1
//   2: x2 xy xz x y2 yz y z2 z 1
//   3: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1
// The order of degree 3 is that of the elimination.
struct Linear {
  Lanes c[4];
};
struct Quadratic {
  Lanes c[10] = {};
};
using Cubic = Lanes[20];

// Rows: quadratic monomial, columns: linear monomial.
constexpr int kCubicIdx[10][4] = {{0, 2, 4, 5},
                                  {2, 3, 8, 9},
                                  {4, 8, 10, 11},
                                  {5, 9, 11, 12},
                                  {3, 1, 6, 7},
                                  {8, 6, 13, 14},
                                  {9, 7, 14, 15},
                                  {10, 13, 16, 17},
                                  {11, 14, 17, 18},
                                  {12, 15, 18, 19}};

DGSFM_INLINE void AddProduct(const Linear& left,
                             const Linear& right,
                             Quadratic* product) {
  const Lanes* a = left.c;
  const Lanes* b = right.c;
  Lanes* c = product->c;
  c[0] += a[0] * b[0];
  c[1] += a[0] * b[1] + a[1] * b[0];
  c[2] += a[0] * b[2] + a[2] * b[0];
  c[3] += a[0] * b[3] + a[3] * b[0];
  c[4] += a[1] * b[1];
  c[5] += a[1] * b[2] + a[2] * b[1];
  c[6] += a[1] * b[3] + a[3] * b[1];
  c[7] += a[2] * b[2];
  c[8] += a[2] * b[3] + a[3] * b[2];
  c[9] += a[3] * b[3];
}

DGSFM_INLINE void AddProduct(const Quadratic& a,
                             const Linear& b,
                             Cubic* product) {
  for (int i = 0; i < 10; ++i) {
    for (int k = 0; k < 4; ++k) (*product)[kCubicIdx[i][k]] += a.c[i] * b.c[k];
  }
}

// Entries of E as linear polynomials; entry (i, j) at 3 j + i.
using EssentialEntries = std::array<Linear, 9>;

// The ten cubic equations, one per row.
struct Constraints {
  Cubic rows[10];
};

DGSFM_INLINE void CreateConstraints(const EssentialEntries& E,
                                    Constraints* constraints) {
  Quadratic squares[3][3];  // E E^T - trace(E E^T) / 2
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) {
        AddProduct(E[3 * k + i], E[3 * k + j], &squares[i][j]);
      }
      squares[j][i] = squares[i][j];
    }
  }
  for (int m = 0; m < 10; ++m) {
    const Lanes half_trace =
        0.5 * (squares[0][0].c[m] + squares[1][1].c[m] + squares[2][2].c[m]);
    for (int i = 0; i < 3; ++i) squares[i][i].c[m] -= half_trace;
  }
  for (Cubic& row : constraints->rows) {
    for (Lanes& coefficient : row) coefficient = Lanes{};
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int k = 0; k < 3; ++k) {
        AddProduct(squares[i][k], E[3 * j + k], &constraints->rows[3 * j + i]);
      }
    }
  }
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    Quadratic minor, subtrahend;
    AddProduct(E[3 + j], E[6 + k], &minor);
    AddProduct(E[3 + k], E[6 + j], &subtrahend);
    for (int m = 0; m < 10; ++m) minor.c[m] -= subtrahend.c[m];
    AddProduct(minor, E[i], &constraints->rows[9]);
  }
}

// Eliminates the first ten monomials, but not from the first `begin` rows: the
// others begin with a row of the identity then.
DGSFM_INLINE void Eliminate(int begin, Constraints* constraints) {
  Cubic* rows = constraints->rows;
  for (int k = 0; k < 10; ++k) {
    // Rows of each lane trade places until row k has the largest pivot.
    for (int i = k + 1; i < 10; ++i) {
      const auto is_larger = Abs(rows[i][k]) > Abs(rows[k][k]);
      for (int c = k; c < 20; ++c) {
        const Lanes larger = is_larger ? rows[i][c] : rows[k][c];
        rows[i][c] = is_larger ? rows[k][c] : rows[i][c];
        rows[k][c] = larger;
      }
    }
    const Lanes inverse_pivot = 1 / rows[k][k];
    for (int c = k; c < 20; ++c) rows[k][c] *= inverse_pivot;
    for (int i = k + 1; i < 10; ++i) {
      const Lanes factor = rows[i][k];
      for (int c = k; c < 20; ++c) rows[i][c] -= factor * rows[k][c];
    }
  }
  for (int k = 9; k > begin; --k) {
    for (int i = begin; i < k; ++i) {
      const Lanes factor = rows[i][k];
      for (int c = 10; c < 20; ++c) rows[i][c] -= factor * rows[k][c];
    }
  }
}

// An equation x_part(z) x + y_part(z) y + rest(z) = 0.
struct Equation {
  LanePolynomial<4> x_part;
  LanePolynomial<4> y_part;
  LanePolynomial<5> rest;
};

// Difference row - z next_row of the eliminated rows with leading monomials m z
// and m.
DGSFM_INLINE Equation Cancel(const Constraints& eliminated, int row) {
  const Lanes* a = eliminated.rows[row] + 10;
  const Lanes* b = eliminated.rows[row + 1] + 10;
  return {{{a[2], a[1] - b[2], a[0] - b[1], -b[0]}},
          {{a[5], a[4] - b[5], a[3] - b[4], -b[3]}},
          {{a[9], a[8] - b[9], a[7] - b[8], a[6] - b[7], -b[6]}}};
}

DGSFM_INLINE LanePolynomial<11> Determinant(const Equation (&equations)[3]) {
  // By the minors of the last column.
  LanePolynomial<11> determinant;
  for (int i = 0; i < 3; ++i) {
    const Equation& a = equations[i];
    const Equation& b = equations[(i + 1) % 3];
    determinant = determinant + (a.x_part * b.y_part - a.y_part * b.x_part) *
                                    equations[(i + 2) % 3].rest;
  }
  return determinant;
}

struct VectorLanes {
  Lanes c[3];
};

DGSFM_INLINE VectorLanes Evaluate(const Equation& equation, const Lanes& z) {
  return {{Evaluate(equation.x_part, z),
           Evaluate(equation.y_part, z),
           Evaluate(equation.rest, z)}};
}

DGSFM_INLINE VectorLanes Cross(const VectorLanes& u, const VectorLanes& v) {
  const Lanes* a = u.c;
  const Lanes* b = v.c;
  return {{a[1] * b[2] - a[2] * b[1],
           a[2] * b[0] - a[0] * b[2],
           a[0] * b[1] - a[1] * b[0]}};
}

// The matrices with these z, by (x, y, 1) orthogonal to all three equations.
// Not finite where the equations do not determine x and y.
DGSFM_INLINE MatrixLanes CombineEntries(const EssentialEntries& entries,
                                        const Equation (&equations)[3],
                                        const Lanes& z) {
  const VectorLanes rows[3] = {Evaluate(equations[0], z),
                               Evaluate(equations[1], z),
                               Evaluate(equations[2], z)};
  VectorLanes xy = Cross(rows[0], rows[1]);
  for (int i = 1; i < 3; ++i) {
    const VectorLanes other = Cross(rows[i], rows[(i + 1) % 3]);
    const auto is_larger = Abs(other.c[2]) > Abs(xy.c[2]);
    for (int k = 0; k < 3; ++k) xy.c[k] = is_larger ? other.c[k] : xy.c[k];
  }
  const Lanes x = xy.c[0] / xy.c[2];
  const Lanes y = xy.c[1] / xy.c[2];
  MatrixLanes matrices;
  for (int entry = 0; entry < 9; ++entry) {
    const Lanes* terms = entries[entry].c;
    matrices.entries[entry] =
        terms[0] * x + terms[1] * y + terms[2] * z + terms[3];
  }
  return matrices;
}

// The matrix of a lane, if it is finite.
void AddSolution(const MatrixLanes& matrices,
                 int lane,
                 EssentialMatrices* solutions) {
  Eigen::Matrix3d& E = solutions->values[solutions->count];
  for (int entry = 0; entry < 9; ++entry) {
    E.data()[entry] = matrices.entries[entry][lane];
  }
  solutions->count += std::isfinite(E.sum());
}

}  // namespace

DGSFM_TARGET_CLONES
std::array<EssentialMatrices, kNumLanes> SolveFivePoints(
    const SampleLanes<5>& samples) {
  const std::array<MatrixLanes, 4> basis = EpipolarNullSpace(samples);
  EssentialEntries entries;
  for (int entry = 0; entry < 9; ++entry) {
    for (int k = 0; k < 4; ++k) entries[entry].c[k] = basis[k].entries[entry];
  }
  Constraints constraints;
  CreateConstraints(entries, &constraints);
  // Rows of x2z and x2, y2z and y2, xyz and xy.
  Eliminate(4, &constraints);
  const Equation equations[3] = {
      Cancel(constraints, 4), Cancel(constraints, 6), Cancel(constraints, 8)};
  const LaneRoots<11> roots = FindRealRoots(Determinant(equations));
  std::array<EssentialMatrices, kNumLanes> solutions;
  for (int i = 0; i < roots.count; ++i) {
    const MatrixLanes matrices =
        CombineEntries(entries, equations, roots.values[i]);
    for (int lane = 0; lane < kNumLanes; ++lane) {
      AddSolution(matrices, lane, &solutions[lane]);
    }
  }
  return solutions;
}

}  // namespace dgsfm
