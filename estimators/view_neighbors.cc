#include "estimators/view_neighbors.h"

#include "colmap_ext/check.h"
#include "estimators/optimization/ray_intersection.h"
#include "estimators/option_check.h"

#include <algorithm>
#include <map>
#include <utility>

namespace dgsfm {
bool ViewNeighborOptions::IsValid(std::string* error) const {
  return OptionBounds(error)
      .AtLeast("max_num_neighbors", max_num_neighbors, 1)
      .Within("min_angle_deg", min_angle_deg, 0, 180)
      .Within("max_angle_deg", max_angle_deg, min_angle_deg, 180)
      .AreKept();
}

std::vector<std::vector<size_t>> FindNeighbors(
    const std::vector<Eigen::Vector3d>& centers,
    const std::vector<SharedPoint>& points,
    const ViewNeighborOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  std::vector<std::map<size_t, size_t>> num_shared(centers.size());
  for (const SharedPoint& point : points) {
    for (size_t i = 0; i < point.images.size(); ++i) {
      for (size_t j = i + 1; j < point.images.size(); ++j) {
        const size_t a = point.images[i];
        const size_t b = point.images[j];
        const double angle_deg =
            AngleDeg(centers[a] - point.xyz, centers[b] - point.xyz);
        if (a == b || angle_deg < options.min_angle_deg ||
            angle_deg > options.max_angle_deg) {
          continue;
        }
        ++num_shared[a][b];
        ++num_shared[b][a];
      }
    }
  }
  std::vector<std::vector<size_t>> neighbors(centers.size());
  for (size_t i = 0; i < centers.size(); ++i) {
    std::vector<std::pair<size_t, size_t>> counted(num_shared[i].begin(),
                                                   num_shared[i].end());
    // The first of equal ones comes first.
    std::stable_sort(counted.begin(), counted.end(), [](auto& a, auto& b) {
      return a.second > b.second;
    });
    if (counted.size() > static_cast<size_t>(options.max_num_neighbors)) {
      counted.resize(options.max_num_neighbors);
    }
    for (const auto& [neighbor, count] : counted) {
      neighbors[i].push_back(neighbor);
    }
  }
  return neighbors;
}

}  // namespace dgsfm
