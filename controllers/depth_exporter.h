// `depth_exporter`: the depth maps of a database as files, as they were
// imported or aligned to a model.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "controllers/multi_view_refinement.h"
#include "estimators/depth_alignment.h"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

enum class DepthExportFormat {
  NPY,                 // a.jpg.npy, 32-bit floats
  PNG,                 // a.jpg.png, 16 bits, png_scale per step
  EXR,                 // a.jpg.exr, channel Z
  DENSE_BIN,           // a.jpg.geometric.bin, as COLMAP's dense stereo has it
  GAUSSIAN_SPLATTING,  // a.png and depth_params.json, see splatting_depth.h
  COLMAP_WORKSPACE,    // depth and normals for stereo_fusion, dense_workspace.h
};

struct DepthExportOptions {
  DepthExportFormat format = DepthExportFormat::NPY;
  DepthAlignmentOptions alignment;
  // Model that image_undistorter made of the one the maps are fitted to: maps
  // are those of its images. Empty for maps of the images in the database.
  std::string undistorted_path;
  // Whether maps are refined by those of neighbouring images after they are
  // aligned, and how.
  bool multi_view = false;
  MultiViewRefinementOptions refinement;
  // Folder of confidence maps, a.jpg.png in 8 bits: the confidence of
  // multi_view_depth.h times 255, 0 where depth is unknown. Empty for none.
  std::string confidence_path;
  // Folder of pictures of the alignment, a.jpg.png (see depth_plot.h). Empty
  // for none.
  std::string plot_path;
  // Folder of a copy of the model, or of the undistorted one, with points of
  // the depth maps in place of its own; with multi_view of pixels that a
  // neighbour agrees with. Empty for none.
  std::string points_path;
  // Its points, at most.
  int num_points = 200000;
  // Folder of the images of that model, for the colours; empty for black.
  std::string image_path;
  // Depth per step of a PNG [unit of depth].
  double png_scale = 0.001;
  // One per core if not positive.
  int num_threads = -1;

  bool IsValid(std::string* error) const;
  // The first of the options that are set; empty if none needs a model.
  std::string OptionThatNeedsModel() const;
};

struct DepthExportSummary {
  struct Image {
    std::string name;
    std::string file;
    // Without a model, none.
    std::optional<DepthAlignment> alignment;
    // With multi_view, shares of the known pixels [0 to 1]: where a neighbour
    // agrees, and that became unknown.
    double agreeing_ratio = 0;
    double dropped_ratio = 0;
  };

  // In the order of image ids.
  std::vector<Image> exported;
  // Those without a depth map in the database, not in the model, or with too
  // few points in it (relative maps, also with points that do not fit).
  std::vector<std::string> images_without_map;
  std::vector<std::string> images_without_model;
  std::vector<std::string> images_with_few_points;
  // Those whose map has depth, of which png_scale leaves none.
  std::vector<std::string> images_out_of_range;

  // In points_path.
  size_t num_points = 0;
  // Whether maps were refined.
  bool multi_view = false;

  // One line per image, the last one with medians over the images.
  std::string ToText() const;
};

// Writes the maps of all images that have one below output_path, with the
// sub-folders of the images. With a model (folder, or folder of several, of
// which the largest is taken), the maps are in its unit and fitted to its
// points (see AlignDepth); alignment.json in output_path has scale, shift,
// residuals and number of points of each image.
//
// With multi_view, maps are then refined by those of their neighbours
// (multi_view_depth.h), and pixels that contradict these become unknown.
//
// Relative disparity and relative depth get their scale and shift by the points
// of the model, without which they are refused.
//
// Maps are of their own size and cover the image as it is in the database, or
// as it is in the undistorted model, which dense stereo and splatting expect.
//
// For COLMAP_WORKSPACE, which needs a model, output_path is a folder that
// image_undistorter wrote, and maps are those of its images.
//
// Files of an earlier export are replaced, all others stay (see ClaimFiles).
//
// Throws std::runtime_error naming file or image if something cannot be read or
// written, if a file that no export wrote is in the way, if the database holds
// no map (but depths of key points only), or if none of its images is in the
// model, sees enough points there, or has depth within png_scale.
DepthExportSummary ExportDepthMaps(const std::string& database_path,
                                   const std::optional<std::string>& model_path,
                                   const std::string& output_path,
                                   const DepthExportOptions& options);

}  // namespace dgsfm
