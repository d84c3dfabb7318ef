#include "colmap_ext/colmap_schema.h"

namespace dgsfm {

void CheckIsColmapDatabase(const SqliteConnection& connection) {
  for (const char* table :
       {"cameras", "images", "keypoints", "matches", "two_view_geometries"}) {
    if (!connection.HasTable(table)) {
      throw connection.Error()
          << "not a COLMAP database (it has no table " << table << ")";
    }
  }
}

}  // namespace dgsfm
