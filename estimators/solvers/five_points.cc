#include "estimators/solvers/five_points.h"

#include "estimators/solvers/polynomial.h"

#include <cmath>

#include <Eigen/Geometry>
#include <Eigen/QR>

namespace dgsfm {
namespace {

// Polynomials in x, y, z by their monomials:
//   1: x y z 1
//   2: x2 xy xz x y2 yz y z2 z 1
//   3: x3 y3 x2y xy2 x2z x2 y2z y2 xyz xy | xz2 xz x yz2 yz y z3 z2 z 1
// The order of degree 3 is that of the elimination.
using Linear = Eigen::Matrix<double, 4, 1>;
using Quadratic = Eigen::Matrix<double, 10, 1>;
using Cubic = Eigen::Matrix<double, 20, 1>;

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

void AddProduct(const Linear& a, const Linear& b, Quadratic* product) {
  (*product)(0) += a(0) * b(0);
  (*product)(1) += a(0) * b(1) + a(1) * b(0);
  (*product)(2) += a(0) * b(2) + a(2) * b(0);
  (*product)(3) += a(0) * b(3) + a(3) * b(0);
  (*product)(4) += a(1) * b(1);
  (*product)(5) += a(1) * b(2) + a(2) * b(1);
  (*product)(6) += a(1) * b(3) + a(3) * b(1);
  (*product)(7) += a(2) * b(2);
  (*product)(8) += a(2) * b(3) + a(3) * b(2);
  (*product)(9) += a(3) * b(3);
}

void AddProduct(const Quadratic& a, const Linear& b, Cubic* product) {
  for (int i = 0; i < 10; ++i) {
    for (int k = 0; k < 4; ++k) (*product)(kCubicIdx[i][k]) += a(i) * b(k);
  }
}

// Entries of E as linear polynomials; entry (i, j) at 3 j + i.
using EssentialEntries = std::array<Linear, 9>;

EssentialEntries NullSpace(const std::array<Eigen::Vector2d, 5>& points1,
                           const std::array<Eigen::Vector2d, 5>& points2) {
  Eigen::Matrix<double, 9, 5> system;
  for (int i = 0; i < 5; ++i) {
    const Eigen::Vector3d p = points1[i].homogeneous();
    const Eigen::Vector3d q = points2[i].homogeneous();
    Eigen::Map<Eigen::Matrix3d>(system.col(i).data()) = q * p.transpose();
  }
  // The last columns of Q are orthogonal to the rows of the linear system.
  Eigen::Matrix<double, 9, 4> basis = Eigen::Matrix<double, 9, 4>::Zero();
  basis.bottomRows<4>().setIdentity();
  basis.applyOnTheLeft(
      Eigen::HouseholderQR<Eigen::Matrix<double, 9, 5>>(system).householderQ());
  EssentialEntries entries;
  for (int k = 0; k < 9; ++k) entries[k] = basis.row(k).transpose();
  return entries;
}

using Constraints = Eigen::Matrix<double, 10, 20, Eigen::RowMajor>;

// The ten cubic equations, one per row.
Constraints CreateConstraints(const EssentialEntries& E) {
  Quadratic squares[3][3];  // E E^T
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      squares[i][j].setZero();
      for (int k = 0; k < 3; ++k) {
        AddProduct(E[3 * k + i], E[3 * k + j], &squares[i][j]);
      }
      squares[j][i] = squares[i][j];
    }
  }
  const Quadratic half_trace =
      0.5 * (squares[0][0] + squares[1][1] + squares[2][2]);
  for (int i = 0; i < 3; ++i) squares[i][i] -= half_trace;
  Constraints constraints;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic row = Cubic::Zero();
      for (int k = 0; k < 3; ++k) AddProduct(squares[i][k], E[3 * j + k], &row);
      constraints.row(3 * j + i) = row.transpose();
    }
  }
  Cubic determinant = Cubic::Zero();
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    Quadratic minor = Quadratic::Zero();
    AddProduct(E[3 + j], E[6 + k], &minor);
    AddProduct(-E[3 + k], E[6 + j], &minor);
    AddProduct(minor, E[i], &determinant);
  }
  constraints.row(9) = determinant.transpose();
  return constraints;
}

// Eliminates the first ten monomials, but not from the first `begin` rows: the
// others begin with a row of the identity then. Rows are whole, so that their
// length is known to the compiler.
void Eliminate(int begin, Constraints* constraints) {
  Constraints& rows = *constraints;
  for (int k = 0; k < 10; ++k) {
    int pivot = k;
    for (int i = k + 1; i < 10; ++i) {
      if (std::abs(rows(i, k)) > std::abs(rows(pivot, k))) pivot = i;
    }
    if (pivot != k) rows.row(k).swap(rows.row(pivot));
    rows.row(k) /= rows(k, k);
    for (int i = k + 1; i < 10; ++i) {
      rows.row(i) -= rows(i, k) * rows.row(k);
    }
  }
  for (int k = 9; k > begin; --k) {
    for (int i = begin; i < k; ++i) rows.row(i) -= rows(i, k) * rows.row(k);
  }
}

// An equation x_part(z) x + y_part(z) y + rest(z) = 0.
struct Equation {
  Polynomial<4> x_part;
  Polynomial<4> y_part;
  Polynomial<5> rest;
};

// Difference row - z next_row of the eliminated rows with leading monomials m z
// and m.
Equation Cancel(const Constraints& eliminated, int row) {
  const auto a = eliminated.row(row).tail<10>();
  const auto b = eliminated.row(row + 1).tail<10>();
  return {{a(2), a(1) - b(2), a(0) - b(1), -b(0)},
          {a(5), a(4) - b(5), a(3) - b(4), -b(3)},
          {a(9), a(8) - b(9), a(7) - b(8), a(6) - b(7), -b(6)}};
}

}  // namespace

EssentialMatrices SolveFivePoints(
    const std::array<Eigen::Vector2d, 5>& points1,
    const std::array<Eigen::Vector2d, 5>& points2) {
  const EssentialEntries entries = NullSpace(points1, points2);
  Constraints constraints = CreateConstraints(entries);
  // Rows of x2z and x2, y2z and y2, xyz and xy.
  Eliminate(4, &constraints);
  const Equation k = Cancel(constraints, 4);
  const Equation l = Cancel(constraints, 6);
  const Equation m = Cancel(constraints, 8);
  // Their determinant, by the minors of the last column.
  const auto term =
      [](const Equation& a, const Equation& b, const Equation& c) {
        return (a.x_part * b.y_part - a.y_part * b.x_part) * c.rest;
      };
  const Polynomial<11> determinant =
      term(k, l, m) + term(l, m, k) + term(m, k, l);

  EssentialMatrices solutions;
  const auto roots = FindRealRootsBySturm(determinant);
  for (int i = 0; i < roots.count; ++i) {
    const double z = roots.values[i];
    const auto at = [z](const Equation& equation) {
      return Eigen::Vector3d(Evaluate(equation.x_part, z),
                             Evaluate(equation.y_part, z),
                             Evaluate(equation.rest, z));
    };
    const Eigen::Vector3d row1 = at(k);
    const Eigen::Vector3d row2 = at(l);
    const Eigen::Vector3d row3 = at(m);
    // (x, y, 1) is orthogonal to all of them.
    Eigen::Vector3d xy = row1.cross(row2);
    for (const Eigen::Vector3d& other : {row2.cross(row3), row3.cross(row1)}) {
      if (std::abs(other.z()) > std::abs(xy.z())) xy = other;
    }
    const Linear combination(xy.x() / xy.z(), xy.y() / xy.z(), z, 1);
    if (!combination.allFinite()) continue;
    Eigen::Matrix3d& E = solutions.values[solutions.count++];
    for (int entry = 0; entry < 9; ++entry) {
      E.data()[entry] = entries[entry].dot(combination);
    }
  }
  return solutions;
}

}  // namespace dgsfm
