// Points and centres from viewing rays with known directions.

#pragma once

#include <optional>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Angle between two vectors [deg].
double AngleDeg(const Eigen::Vector3d& a, const Eigen::Vector3d& b);

// Median of each coordinate; there must be a point.
Eigen::Vector3d ComponentwiseMedian(const std::vector<Eigen::Vector3d>& points);

// Point X with the smallest sum of squared distances to the rays
// centers[i] + a * rays[i] (rays of unit length). Nothing if no two rays
// enclose min_angle_deg or if the point lies behind a centre.
std::optional<Eigen::Vector3d> TriangulateRays(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<Eigen::Vector3d>& rays,
    double min_angle_deg);

// Centre c from which the points are seen along the unit rays: minimises the
// sum of the angles between rays[i] and points[i] - c (iteratively reweighted
// least squares, 3 unknowns, linear in each step). Nothing if the rays are
// nearly parallel or most points lie behind the centre.
std::optional<Eigen::Vector3d> ResectCenter(
    const std::vector<Eigen::Vector3d>& points,
    const std::vector<Eigen::Vector3d>& rays);

}  // namespace dgsfm
