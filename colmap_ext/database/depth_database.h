// Depth priors and depth-aware pair geometries as extra tables in a COLMAP
// database; the schema is documented to the byte in depth_database.md. COLMAP
// of every version from 3.8 ignores the tables and keeps opening the database.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/pair_geometry.h"
#include "colmap_ext/scene.h"

#include <colmap/util/types.h>

#include <chrono>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dgsfm {

// One connection to the tables. Not thread-safe. All methods throw
// std::runtime_error with the path and SQLite's message; a failed call leaves
// the database as it was.
class DepthDatabase {
 public:
  // UNCHANGING as SqliteConnection has it.
  enum class Mode { READ_ONLY, UNCHANGING, READ_WRITE };

  // The file must exist and be a COLMAP database. Without our tables it is
  // read as one without priors; the first write creates them, so that opening
  // alone changes nothing. Tables of an older version are brought up to date
  // when opened for writing (see UpdateDepthTables). Otherwise another version
  // is refused, with the remedy.
  DepthDatabase(const std::string& path,
                Mode mode,
                std::chrono::milliseconds busy_timeout = kDefaultBusyTimeout);

  // Writes map and samples of one image, one per key point of the image in the
  // database, replacing earlier ones. The second form lets threads compress.
  void WriteDepthMap(colmap::image_t image_id,
                     const DepthMap& depth_map,
                     const KeypointDepths& keypoint_depths);
  void WriteCompressedDepthMap(colmap::image_t image_id,
                               const CompressedDepthMap& depth_map,
                               const KeypointDepths& keypoint_depths);
  // Writes the samples alone: a map of the image from before is deleted.
  void WriteKeypointDepths(colmap::image_t image_id,
                           const KeypointDepths& keypoint_depths);

  bool HasDepthMap(colmap::image_t image_id) const;
  DepthMap ReadDepthMap(colmap::image_t image_id) const;

  // Samples of all images that have them. Throws if an image has other key
  // points in the database than at the import (features were extracted again),
  // naming the image and the remedy. Restricted to the key points that are
  // kept, and to the images that `selects` takes, if it is given.
  std::map<colmap::image_t, KeypointDepths> ReadAllKeypointDepths(
      const KeptKeypoints& kept = {},
      const std::function<bool(colmap::image_t)>& selects = nullptr) const;
  // All samples of one image; nothing if it has none.
  std::optional<KeypointDepths> ReadKeypointDepths(
      colmap::image_t image_id) const;
  // KeypointDepths::source_fingerprint of the images with samples that are not
  // outdated in that sense.
  std::map<colmap::image_t, uint64_t> ReadSourceFingerprints() const;

  // Replaces the geometries of the given pairs in one transaction; the others
  // stay.
  void WritePairGeometries(
      const std::map<colmap::image_pair_t, PairGeometry>& geometries);
  // Leaves out pairs whose images have been deleted since. Throws if inliers
  // refer to key points that are gone, naming the pair and the remedy. Inliers
  // are restricted to the key points that are kept. Only of the pairs that are
  // selected, if `selects` is given.
  std::map<colmap::image_pair_t, PairGeometry> ReadPairGeometries(
      const KeptKeypoints& kept = {},
      const std::function<bool(colmap::image_pair_t)>& selects = {}) const;
  // Numbers of inliers of the valid pairs.
  std::map<colmap::image_pair_t, size_t> ReadValidPairs() const;
  // Fingerprints of all rows, by increasing pair id.
  std::map<colmap::image_pair_t, uint64_t> ReadPairFingerprints() const;
  // Totals of all rows.
  PairTotals ReadPairTotals() const;
  void DeletePairGeometries(const std::vector<colmap::image_pair_t>& pair_ids);
  void DeleteAllPairGeometries();

  // Replaces the table of pair statuses: what a mapper decided on each pair,
  // while the geometries keep the result of verification. It is created where
  // missing.
  void WritePairStatuses(
      const std::map<colmap::image_pair_t, PairStatus>& statuses);
  // Empty if no mapper has written any.
  std::map<colmap::image_pair_t, PairStatus> ReadPairStatuses() const;

  // Images whose maps were made of them as viewers show them, and were turned
  // back by EXIF. An importer sets it for each map.
  void WriteIsDisplayed(colmap::image_t image_id, bool is_displayed);
  std::set<colmap::image_t> ReadDisplayedImages() const;

  // Makes all writes until CommitTransaction() one transaction; without the
  // commit the destructor undoes them.
  void BeginTransaction();
  void CommitTransaction();

 private:
  // Runs `write` with the tables in place; all or nothing.
  template <typename Write>
  void RunWrite(const Write& write);
  void WriteSamples(colmap::image_t image_id,
                    const KeypointDepths& keypoint_depths);

  const SqliteConnection connection_;
  const Mode mode_;
  std::optional<SqliteTransaction> transaction_;
};

}  // namespace dgsfm
