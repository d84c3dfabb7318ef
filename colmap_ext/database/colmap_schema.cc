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

int64_t CountPosePriors(const SqliteConnection& connection) {
  const auto count = [&connection](const std::string& query) {
    SqliteStatement select(connection, "SELECT count(*) FROM " + query);
    return select.Step() ? select.Int(0) : 0;
  };
  if (connection.HasTable("pose_priors")) {
    return count("pose_priors WHERE position IS NOT NULL");
  }
  // COLMAP 3.8 keeps them with the images.
  const bool has_column =
      count("pragma_table_info('images') WHERE name = 'prior_tx'") > 0;
  return has_column ? count("images WHERE prior_tx IS NOT NULL") : 0;
}

bool IsBlobSize(int64_t num_rows, int64_t num_cols, size_t num_values) {
  return num_rows >= 0 && num_values % num_cols == 0 &&
         num_values / num_cols == static_cast<size_t>(num_rows);
}

}  // namespace dgsfm
