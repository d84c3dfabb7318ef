// Matches of a COLMAP database, all at once or pair by pair, so that memory
// need not grow with them.

#pragma once

#include "colmap_ext/scene.h"
#include "colmap_ext/sqlite.h"

#include <map>
#include <string>
#include <vector>

namespace dgsfm {

// Throws std::runtime_error naming the file and the pair where matches are
// damaged or refer to images or key points that are not there. Duplicate
// matches are left out. Not thread-safe.
class MatchReader {
 public:
  using Matches = std::map<colmap::image_pair_t, colmap::FeatureMatches>;

  struct PairSize {
    colmap::image_pair_t pair_id = 0;
    // Before duplicates are left out.
    size_t num_matches = 0;
  };

  // The scene holds the images of the database with their key points. Both
  // must outlive the reader.
  MatchReader(const SqliteConnection& connection, const Scene& scene);

  // Of the tables matches and two_view_geometries.
  Matches ReadAllPutative() const;
  Matches ReadAllVerified() const;

  // The pairs of Scene::matches by increasing id.
  std::vector<PairSize> ListPairs() const;
  // Scene::matches of one of them; none if the pair is gone since.
  colmap::FeatureMatches Read(colmap::image_pair_t pair_id);

 private:
  // The query returns pair_id, rows, cols, data.
  Matches ReadAll(const std::string& query) const;
  colmap::image_pair_t CheckedPairId(int64_t pair_id) const;
  colmap::FeatureMatches ReadRow(const SqliteStatement& row) const;
  void CheckIndex(const std::string& pair,
                  const colmap::Image& image,
                  colmap::point2D_t point2D_idx) const;

  const SqliteConnection& connection_;
  const Scene& scene_;
  SqliteStatement select_putative_;
  SqliteStatement select_verified_;
};

}  // namespace dgsfm
