// Matches of a COLMAP database pair by pair, so that memory need not grow with
// them.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/scene.h"

#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

namespace dgsfm {

// Throws std::runtime_error naming the file and the pair where matches are
// damaged or refer to images or key points that are not there. Duplicate
// matches are left out. Not thread-safe.
class MatchReader {
 public:
  struct PairSize {
    colmap::image_pair_t pair_id = 0;
    // Before duplicates are left out.
    size_t num_matches = 0;
  };

  // The scene holds the images of the database, or some of them: pairs with
  // others do not count. Both must outlive the reader.
  MatchReader(const SqliteConnection& connection, const Scene& scene);

  // The pairs of Scene::matches by increasing id: those of the table matches
  // and, where that has none, what COLMAP's verification accepted.
  std::vector<PairSize> ListPairs() const;
  // Scene::matches of one of them; none if the pair is gone since.
  colmap::FeatureMatches Read(colmap::image_pair_t pair_id);

 private:
  colmap::image_pair_t CheckedPairId(int64_t pair_id) const;
  bool IsLeftOut(int64_t pair_id) const;
  colmap::FeatureMatches ReadRow(const SqliteStatement& row) const;
  // Throws for the first of the matches whose key point, of those `select`ed,
  // is not there.
  template <typename Select>
  void CheckIndices(const std::string& pair,
                    const colmap::Image& image,
                    const colmap::FeatureMatches& matches,
                    const Select& select) const;
  // Number of rows of the blob; 0 without one.
  int64_t NumKeypoints(const colmap::Image& image) const;

  const SqliteConnection& connection_;
  const Scene& scene_;
  std::map<colmap::image_t, int64_t> num_keypoints_;
  // Images of the database that the scene lacks.
  std::set<int64_t> left_out_images_;
  SqliteStatement select_putative_;
  SqliteStatement select_verified_;
};

// The matches of the key points that a scene keeps, read pair by pair from its
// database. The scene must outlive this and stay where it is.
class StoredMatches : public MatchSource {
 public:
  StoredMatches(const std::string& database_path, const Scene& scene);
  colmap::FeatureMatches Read(colmap::image_pair_t pair_id) const override;

 private:
  const SqliteConnection connection_;
  const Scene& scene_;
  // A connection serves one thread at a time.
  mutable std::mutex mutex_;
  mutable MatchReader reader_;
};

}  // namespace dgsfm
