// Fits a depth map to the sparse points that its image sees.
//
// Model: the depth z of the point [unit of the reconstruction] against the
// depth d of the map at the same place (u, v), by residuals log(z / f(d, u,
// v)):
//   SCALE:       f = s d
//   SCALE_SHIFT: f = s d + t
//   FIELD:       f = d exp(g(u, v)), g bilinear between the nodes of a grid
// All are fitted by iteratively reweighted least squares with Cauchy weights
// whose width follows the median absolute residual. The field minimises besides
// the weighted squares its second differences times a smoothness, which is the
// one of a fixed series, a constant field included, under which points that
// were left out are predicted best.

#pragma once

#include "colmap_ext/depth/depth_map.h"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Depths of one point. u and v are positions in the image in units of its width
// and height, in [0, 1]. Both depths are positive.
struct DepthCorrespondence {
  double u = 0;
  double v = 0;
  double map_depth = 0;
  double point_depth = 0;
};

enum class DepthAlignmentModel { SCALE, SCALE_SHIFT, FIELD };

struct DepthAlignmentOptions {
  DepthAlignmentModel model = DepthAlignmentModel::FIELD;
  // Fewer correspondences fit nothing.
  int min_num_points = 10;
  // Nodes of the field along the longer side of the image.
  int num_nodes = 12;

  bool IsValid(std::string* error) const;
};

struct DepthAlignment {
  double scale = 1;
  double shift = 0;  // [unit of the reconstruction]
  // Logarithmic field on top of the scale, row by row; empty without one. Node
  // (i, j) is at u = i / (num_cols - 1), v = j / (num_rows - 1).
  int num_cols = 0;
  int num_rows = 0;
  std::vector<double> field;

  size_t num_points = 0;
  // Median absolute relative error of the depths at the points: after the best
  // scale alone, and of points that this alignment had not seen (five-fold
  // cross-validation).
  double scale_residual = 0;
  double residual = 0;

  // Aligned depth [unit of the reconstruction]; 0 where a shift makes it
  // negative.
  double Apply(double u, double v, double map_depth) const;
  // Values that the alignment takes out of range become unknown.
  void Apply(DepthMap* depth_map) const;
  // Has the scale and field of `correction`, which has no shift, applied after
  // this alignment. Both have fields of the same size, or one has none.
  void Append(const DepthAlignment& correction);
};

// aspect: width over height of the image. Nothing if there are too few points.
// Throws std::invalid_argument for depths that are not positive and finite.
std::optional<DepthAlignment> AlignDepth(
    const std::vector<DepthCorrespondence>& points,
    double aspect,
    const DepthAlignmentOptions& options);

}  // namespace dgsfm
