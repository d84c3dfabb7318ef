// What the depth map of one view shows of the pixels of another.

#pragma once

#include "colmap_ext/depth/depth_view.h"
#include "colmap_ext/rigid3.h"

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

enum class ViewVerdict { SILENT, AGREES, CONTRADICTS };

// One neighbour against the pixels of a view, both of which must outlive this.
class ViewComparison {
 public:
  // Depths agree within max_difference, relative.
  ViewComparison(const DepthView& view,
                 const DepthView& neighbor,
                 double max_difference);

  // Has Judge() find surfaces of the neighbour that the view sees through.
  void FindSurfacesInFront();

  const DepthView& Neighbor() const { return neighbor_; }
  double MaxDifference() const { return max_difference_; }

  // For pixel (x, y) of known depth with its tangent plane. If the neighbour
  // agrees, log_ratio is the logarithm of the depth at which the ray meets its
  // surface, over the pixel's; NaN if nothing is known of it.
  ViewVerdict Judge(int x,
                    int y,
                    const Eigen::Vector3d& plane,
                    double* log_ratio) const;

 private:
  double MoveAlongRay(const Eigen::Vector3d& xyz,
                      const Eigen::Vector3d& plane,
                      const Eigen::Vector3d& offset) const;

  const DepthView& view_;
  const DepthView& neighbor_;
  const Rigid3d neighbor_from_view_;
  const Eigen::Matrix3d rotation_;
  const double max_difference_;
  // Least depth of the neighbour's points in each pixel of the view; 0 without.
  std::vector<float> nearest_;
};

}  // namespace dgsfm
