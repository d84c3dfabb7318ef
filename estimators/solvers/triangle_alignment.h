// Rigid motions between triangles, for minimal solvers.

#pragma once

#include <array>
#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace dgsfm {

using Triangle = std::array<Eigen::Vector3d, 3>;

// Corners at scale * depth * (x / focal, 1).
inline Triangle LiftTriangle(const std::array<Eigen::Vector2d, 3>& points,
                             const std::array<double, 3>& depths,
                             double focal,
                             double scale) {
  Triangle triangle;
  for (int i = 0; i < 3; ++i) {
    const double depth = scale * depths[i];
    triangle[i] << points[i] * (depth / focal), depth;
  }
  return triangle;
}

// Columns: along the first side, in the plane, along the normal. False if the
// triangle is a line: its normal would be mostly rounding or noise.
inline bool TriangleFrame(const Triangle& triangle, Eigen::Matrix3d* frame) {
  // Sine of the angle at the first corner.
  constexpr double kMinSine = 1e-6;
  const Eigen::Vector3d side12 = triangle[1] - triangle[0];
  const Eigen::Vector3d side13 = triangle[2] - triangle[0];
  const Eigen::Vector3d normal = side12.cross(side13);
  const double sq_length = side12.squaredNorm();
  const double sq_normal = normal.squaredNorm();
  if (!(sq_normal > kMinSine * kMinSine * sq_length * side13.squaredNorm())) {
    return false;
  }
  frame->col(0) = (1 / std::sqrt(sq_length)) * side12;
  frame->col(2) = (1 / std::sqrt(sq_normal)) * normal;
  frame->col(1) = frame->col(2).cross(frame->col(0));
  return true;
}

// The motion of triangle 1 onto triangle 2 by their frames and centroids: a
// proper rotation even if their sides differ.
inline bool AlignTriangles(const Triangle& triangle1,
                           const Triangle& triangle2,
                           Eigen::Matrix3d* rotation,
                           Eigen::Vector3d* translation) {
  Eigen::Matrix3d frame1, frame2;
  if (!TriangleFrame(triangle1, &frame1) ||
      !TriangleFrame(triangle2, &frame2)) {
    return false;
  }
  *rotation = frame2 * frame1.transpose();
  *translation =
      (1.0 / 3) * (triangle2[0] + triangle2[1] + triangle2[2] -
                   *rotation * (triangle1[0] + triangle1[1] + triangle1[2]));
  return true;
}

}  // namespace dgsfm
