// Depth priors and depth-aware pair geometries as extra tables in a COLMAP
// database; the schema is documented to the byte in depth_database.md. COLMAP
// of every version from 3.8 ignores the tables and keeps opening the database.

#pragma once

#include "colmap_ext/depth_map.h"
#include "colmap_ext/pair_geometry.h"

#include <colmap/util/types.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace dgsfm {

// Depth [unit of the image's map] at each key point of an image; 0 unknown.
struct KeypointDepths {
  DepthUnit unit = DepthUnit::METRIC;
  std::vector<float> depths;
};

// One connection to the tables. Not thread-safe. All methods throw
// std::runtime_error with the path and SQLite's message; a failed call leaves
// the database as it was.
class DepthDatabase {
 public:
  enum class Mode { READ_ONLY, READ_WRITE };

  // The file must exist and be a COLMAP database. READ_WRITE creates the
  // tables where they are missing and refuses a schema newer than ours;
  // READ_ONLY reads a database without our tables as one without priors.
  DepthDatabase(const std::string& path, Mode mode);
  ~DepthDatabase();

  // Writes map and samples of one image, replacing earlier ones.
  void WriteDepthMap(colmap::image_t image_id,
                     const DepthMap& depth_map,
                     const KeypointDepths& keypoint_depths);
  bool HasDepthMap(colmap::image_t image_id) const;
  DepthMap ReadDepthMap(colmap::image_t image_id) const;

  // Samples of all images that have them. Throws if the number of samples of
  // an image is not its number of key points in the database (features were
  // extracted again after the import), naming the image and the remedy.
  std::map<colmap::image_t, KeypointDepths> ReadAllKeypointDepths() const;

  // Replaces the geometries of the given pairs in one transaction.
  void WritePairGeometries(
      const std::map<colmap::image_pair_t, PairGeometry>& geometries);
  std::map<colmap::image_pair_t, PairGeometry> ReadPairGeometries() const;
  void DeletePairGeometries();

  // Runs everything written until Commit() as one transaction.
  void BeginTransaction();
  void CommitTransaction();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm
