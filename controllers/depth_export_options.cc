#include "controllers/depth_exporter.h"

#include <cmath>

namespace dgsfm {

bool DepthExportOptions::IsValid(std::string* error) const {
  if (!(png_scale > 0 && std::isfinite(png_scale))) {
    *error = "png_scale must be positive and finite";
    return false;
  }
  if (format == DepthExportFormat::COLMAP_WORKSPACE &&
      !undistorted_path.empty()) {
    *error =
        "undistorted_path has no meaning for colmap_workspace, whose "
        "undistorted model is in output_path";
    return false;
  }
  if (!confidence_path.empty() && !multi_view) {
    *error = "confidence_path needs multi_view";
    return false;
  }
  if (num_points < 1) {
    *error = "num_points must be at least 1";
    return false;
  }
  return alignment.IsValid(error) && refinement.IsValid(error);
}

std::string DepthExportOptions::OptionThatNeedsModel() const {
  if (format == DepthExportFormat::COLMAP_WORKSPACE) return "colmap_workspace";
  if (!undistorted_path.empty()) return "undistorted_path";
  if (multi_view) return "multi_view";
  if (!points_path.empty()) return "points_path";
  return plot_path.empty() ? "" : "plot_path";
}

}  // namespace dgsfm
