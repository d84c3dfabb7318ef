// Writes small COLMAP databases for tests by plain SQL, in the schemas of
// several COLMAP versions and without any COLMAP code in between.

#pragma once

#include "colmap_ext/database/sqlite.h"

#include <colmap/util/alignment.h>

#include <colmap/feature/types.h>
#include <colmap/util/types.h>

#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

enum class ColmapSchema { V3_8, V3_12, V4_2 };

class ColmapDatabaseWriter {
 public:
  // Creates the file (in WAL mode, as COLMAP does) with the version's tables.
  ColmapDatabaseWriter(const std::string& path, ColmapSchema schema);

  // model_id as in COLMAP, e.g. 1 for PINHOLE with params fx, fy, cx, cy.
  colmap::camera_t AddCamera(int model_id,
                             int width,
                             int height,
                             const std::vector<double>& params,
                             bool has_prior_focal_length = false);

  // Key points are written with num_cols = 2, 4 or 6 float columns; without
  // key points no row is written.
  colmap::image_t AddImage(const std::string& name,
                           colmap::camera_t camera_id,
                           const std::vector<Eigen::Vector2d>& keypoints,
                           int num_cols = 6);

  // Writes the pair's matches, given in the order of the arguments, and with
  // verified the same ones as inliers of a calibrated pair.
  void AddMatches(colmap::image_t image_id1,
                  colmap::image_t image_id2,
                  colmap::FeatureMatches matches,
                  bool verified = true);

  // For anything else, bad input in particular.
  void Execute(const std::string& sql) { connection_.Execute(sql); }
  const SqliteConnection& Connection() const { return connection_; }

 private:
  SqliteConnection connection_;
  ColmapSchema schema_;
};

}  // namespace dgsfm
