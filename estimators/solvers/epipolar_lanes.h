// The linear system of epipolar constraints of eight samples of N matches, for
// minimal solvers.

#pragma once

#include "estimators/lanes.h"

#include <array>
#include <cstddef>

#include <Eigen/Core>

namespace dgsfm {

// The matches of eight samples, one sample a lane.
template <size_t N>
struct SampleLanes {
  Lanes x1[N], y1[N], x2[N], y2[N];

  void Set(size_t match,
           int lane,
           const Eigen::Vector2d& point1,
           const Eigen::Vector2d& point2) {
    x1[match][lane] = point1.x();
    y1[match][lane] = point1.y();
    x2[match][lane] = point2.x();
    y2[match][lane] = point2.y();
  }
};

// Up to N matrices of a sample.
template <size_t N>
struct EpipolarMatrices {
  int count = 0;
  std::array<Eigen::Matrix3d, N> values;
};

// Entry (i, j) of a matrix at 3 j + i.
struct MatrixLanes {
  Lanes entries[9];
};

// Orthonormal matrices with (x2, 1)^T E (x1, 1) = 0 for all matches: the
// columns that Householder reflections of the constraints leave.
template <size_t N>
DGSFM_INLINE std::array<MatrixLanes, 9 - N> EpipolarNullSpace(
    const SampleLanes<N>& samples) {
  const auto reflect =
      [](const Lanes* normal, const Lanes& factor, size_t begin, Lanes* vector)
          __attribute__((always_inline)) {
    Lanes product = {};
    for (size_t i = begin; i < 9; ++i) product += normal[i] * vector[i];
    product *= factor;
    for (size_t i = begin; i < 9; ++i) vector[i] -= product * normal[i];
  };
  // Constraints, then normals of the reflections.
  Lanes columns[N][9];
  Lanes factors[N];
  for (size_t k = 0; k < N; ++k) {
    const Lanes one = 1.0 + Lanes{};
    const Lanes point1[3] = {samples.x1[k], samples.y1[k], one};
    const Lanes point2[3] = {samples.x2[k], samples.y2[k], one};
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) columns[k][3 * j + i] = point2[i] * point1[j];
    }
  }
  for (size_t k = 0; k < N; ++k) {
    Lanes sq_norm = {};
    for (size_t i = k; i < 9; ++i) sq_norm += columns[k][i] * columns[k][i];
    const Lanes norm = Sqrt(sq_norm);
    const Lanes leading = columns[k][k];
    columns[k][k] = leading + (leading < 0.0 ? -norm : norm);
    // Constraints that depend on the others are not reflected.
    factors[k] = norm > 0.0 ? 1 / (norm * (norm + Abs(leading))) : Lanes{};
    for (size_t other = k + 1; other < N; ++other) {
      reflect(columns[k], factors[k], k, columns[other]);
    }
  }
  std::array<MatrixLanes, 9 - N> basis = {};
  for (size_t b = 0; b < 9 - N; ++b) {
    basis[b].entries[N + b] += 1.0;
    for (size_t k = N; k-- > 0;) {
      reflect(columns[k], factors[k], k, basis[b].entries);
    }
  }
  return basis;
}

}  // namespace dgsfm
