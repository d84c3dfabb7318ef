#include "colmap_ext/database/colmap_schema.h"

namespace dgsfm {

// The message of SQLite about a missing table would not name the cause.
void CheckIsColmapDatabase(const SqliteConnection& connection) {
  for (const char* table :
       {"cameras", "images", "keypoints", "matches", "two_view_geometries"}) {
    if (!connection.HasTable(table)) {
      throw connection.Error()
          << "not a COLMAP database (it has no table " << table << ")";
    }
  }
}

bool IsBlobSize(int64_t num_rows, int64_t num_cols, size_t num_values) {
  return num_rows >= 0 && num_values % num_cols == 0 &&
         num_values / num_cols == static_cast<size_t>(num_rows);
}

}  // namespace dgsfm
