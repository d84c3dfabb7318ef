// Rows of the table of pair geometries, which depth_database.md documents.

#pragma once

#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/pair_geometry.h"

#include <functional>
#include <string>

namespace dgsfm {

// Throws std::invalid_argument unless the geometry is one that can be stored:
// a rotation, finite numbers, positive scale.
void CheckPairGeometry(const PairGeometry& geometry);

// Inserts rows, or replaces those that are there.
class PairGeometryInserter {
 public:
  explicit PairGeometryInserter(const SqliteConnection& connection);
  void Insert(colmap::image_pair_t pair_id, const PairGeometry& geometry);

 private:
  SqliteStatement insert_;
};

// The columns of the table, in the order of GeometryOfRow.
extern const char kPairGeometryColumns[];

// Reads a row that begins with these columns. Calls `fail`, which must throw,
// with what is wrong with it.
PairGeometry GeometryOfRow(
    const SqliteStatement& row,
    const std::function<void(const std::string& problem)>& fail);

// Goes through the rows by pair id, leaving out those whose images have been
// deleted.
class PairGeometryCursor {
 public:
  explicit PairGeometryCursor(const SqliteConnection& connection);
  // False behind the last row.
  bool Step() { return select_.Step(); }
  colmap::image_pair_t PairId() const;
  // Throws std::runtime_error with the names of the images if the row is
  // damaged or its inliers refer to key points that are gone.
  PairGeometry Geometry() const;

 private:
  std::string PairName() const;

  const SqliteConnection& connection_;
  SqliteStatement select_;
};

}  // namespace dgsfm
