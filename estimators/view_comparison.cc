#include "estimators/view_comparison.h"

#include <cmath>
#include <limits>

#include <Eigen/Geometry>

namespace dgsfm {

ViewComparison::ViewComparison(const DepthView& view,
                               const DepthView& neighbor,
                               double max_difference)
    : view_(view),
      neighbor_(neighbor),
      neighbor_from_view_(neighbor.CamFromWorld() *
                          view.CamFromWorld().Inverse()),
      rotation_(neighbor_from_view_.rotation.toRotationMatrix()),
      max_difference_(max_difference) {}

void ViewComparison::FindSurfacesInFront() {
  const DepthMap& target = view_.Map();
  nearest_.assign(target.values.size(), 0);
  const Rigid3d view_from_neighbor = neighbor_from_view_.Inverse();
  const DepthMap& map = neighbor_.Map();
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      // At edges depth may be that of no surface.
      if (map.At(x, y) <= 0 || neighbor_.IsAtEdge(x, y)) continue;
      const Eigen::Vector3d xyz =
          map.At(x, y) * (rotation_.transpose() * neighbor_.Ray(x, y)) +
          view_from_neighbor.translation;
      if (xyz.z() <= 0) continue;
      const Eigen::Vector2d place = view_.Project(xyz);
      if (!view_.Covers(place)) continue;
      float& nearest =
          nearest_[size_t(place.y()) * target.width + size_t(place.x())];
      const float depth = static_cast<float>(xyz.z());
      if (nearest == 0 || depth < nearest) nearest = depth;
    }
  }
}

ViewVerdict ViewComparison::Judge(int x,
                                  int y,
                                  const Eigen::Vector3d& plane,
                                  double* log_ratio) const {
  const Eigen::Vector3d xyz = view_.Map().At(x, y) * view_.Ray(x, y);
  const Eigen::Vector3d in_neighbor =
      rotation_ * xyz + neighbor_from_view_.translation;
  const double inverse_depth =
      in_neighbor.z() > 0
          ? neighbor_.InverseDepthAt(neighbor_.Project(in_neighbor))
          : 0;
  if (inverse_depth > 0) {
    // Depth of the neighbour's surface over that of the point, on its ray.
    const double ratio = 1 / (inverse_depth * in_neighbor.z());
    const double difference = std::log(ratio);
    if (std::abs(difference) <= max_difference_) {
      *log_ratio = MoveAlongRay(xyz, plane, (ratio - 1) * in_neighbor);
      return ViewVerdict::AGREES;
    }
    if (difference > 0) return ViewVerdict::CONTRADICTS;
  }
  if (nearest_.empty()) return ViewVerdict::SILENT;
  const float front = nearest_[size_t(y) * view_.Map().width + x];
  return front > 0 && front * std::exp(max_difference_) <
                          view_.LeastDepthAround(x, y)
             ? ViewVerdict::CONTRADICTS
             : ViewVerdict::SILENT;
}

// Moves the tangent plane by an offset in the frame of the neighbour.
double ViewComparison::MoveAlongRay(const Eigen::Vector3d& xyz,
                                    const Eigen::Vector3d& plane,
                                    const Eigen::Vector3d& offset) const {
  const double unmoved = plane.dot(xyz);
  const double moved = unmoved + plane.dot(rotation_.transpose() * offset);
  const double log_ratio = std::log(moved / unmoved);
  // Between views of a slanted surface differences may move it anywhere.
  return std::abs(log_ratio) <= max_difference_
             ? log_ratio
             : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace dgsfm
