// What the report page shows of a model: its images with figures of each, and
// as many of its points with their tracks as a browser draws fluidly.

#pragma once

#include "colmap_ext/model/model_io.h"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace dgsfm {

struct ImageSummary {
  colmap::camera_t camera_id = colmap::kInvalidCameraId;
  Rigid3d cam_from_world;
  size_t num_points = 0;
  // Share of the cells of a 10 x 10 grid with a point in them.
  double coverage = 0;
  // Median reprojection error [px]; 0 without points.
  double median_error_px = 0;
};

// Where an image sees a shown point.
struct ShownView {
  // Index of the image in the order of their names.
  uint32_t image = 0;
  // Position in steps of 1 / 255 of width and height.
  uint8_t x = 0;
  uint8_t y = 0;
};

struct ShownPoint {
  ModelPoint point;
  std::vector<ShownView> views;
};

struct ModelSummary {
  std::map<std::string, ImageSummary> images;
  std::map<colmap::camera_t, colmap::Camera> cameras;
  size_t num_points = 0;
  size_t num_observations = 0;
  // Every k-th point.
  std::vector<ShownPoint> shown_points;
  double median_error_px = 0;
  // Observations by reprojection error, in steps of kErrorStepPx; the last
  // number counts all larger ones.
  std::vector<size_t> error_histogram;
  // Points by the number of their images, from 0 on; the last number counts
  // all longer tracks.
  std::vector<size_t> track_histogram;
};

constexpr double kErrorStepPx = 0.1;

// Shows at most so many points and views. Throws std::runtime_error naming the
// file if the model cannot be read.
ModelSummary SummarizeModel(const std::string& folder,
                            size_t max_num_points,
                            size_t max_num_views);

}  // namespace dgsfm
