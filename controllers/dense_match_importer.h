// `dense_match_importer`: correspondences of dense matchers into the database,
// as key points and matches without quantisation.

#pragma once

#include "colmap_ext/formats/dense_match_file.h"

#include <cstddef>
#include <string>
#include <vector>

namespace dgsfm {

struct DenseMatchImportOptions {
  // Points of different pairs of an image closer than this are one key point
  // [px of the image]. Sub-pixel: a larger radius moves points.
  double merge_radius_px = 0.25;
  // Matches of lower confidence are left out.
  double min_confidence = 0;
  // Added to both coordinates [px]: 0.5 for matchers whose first pixel has its
  // centre at (0, 0); COLMAP's is at (0.5, 0.5).
  double coordinate_offset_px = 0;
  // Whether to replace the features and matches of the database.
  bool overwrite = false;

  bool IsValid(std::string* error) const;
};

struct DenseMatchImportSummary {
  size_t num_pairs = 0;
  size_t num_matches = 0;
  // Before points were merged, and after.
  size_t num_points = 0;
  size_t num_keypoints = 0;
  // Outside of their image, not finite, or of low confidence.
  size_t num_matches_left_out = 0;
  std::vector<std::string> groups_without_images;

  std::string ToText() const;
};

// Reads the pairs of a DenseMatchFile. A group is called "NAME1<>NAME2",
// "NAME1_NAME2", "NAME1-NAME2" or "NAME1/NAME2" after two images of the
// database, with their folders or, where that is unique, without them, and '/'
// in a name as '/' or '-'; groups of other names are listed. Several groups of
// one pair, such as both directions, are merged.
//
// Key points get two columns, so COLMAP of every version reads them. Existing
// key points and matches are refused unless `overwrite` replaces them, with
// descriptors and geometries; depth has to be imported afterwards.
//
// All or nothing. Images are merged one after the other: memory grows with the
// points of one image and the longest pair, the indices in between go to a
// temporary file of SQLite. Each pair is read twice.
//
// Throws std::runtime_error naming file, pair or database.
DenseMatchImportSummary ImportDenseMatches(
    const std::string& database_path,
    const DenseMatchFile& file,
    const DenseMatchImportOptions& options);

}  // namespace dgsfm
