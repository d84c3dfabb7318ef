// Which images see what an image sees.

#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

struct ViewNeighborOptions {
  // Neighbours of an image: those that share most points with it ...
  int max_num_neighbors = 8;
  // ... which both see from directions that differ by this much [deg]. Depth
  // maps of views from one place share their errors, and those of views from
  // far apart show few surfaces of each other.
  double min_angle_deg = 1;
  double max_angle_deg = 60;

  bool IsValid(std::string* error) const;
};

// A point and the indices of the images that see it.
struct SharedPoint {
  Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
  std::vector<size_t> images;
};

// Neighbours of each image by their indices, the best first.
std::vector<std::vector<size_t>> FindNeighbors(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<SharedPoint>& points,
    const ViewNeighborOptions& options);

}  // namespace dgsfm
