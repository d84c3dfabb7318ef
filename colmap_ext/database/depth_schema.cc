#include "colmap_ext/database/depth_schema.h"

namespace dgsfm {
namespace {

constexpr int64_t kVersion = 4;
// Has the same tables of depth.
constexpr int64_t kFirstVersionOfDepth = 3;

constexpr char kCreateDepthTables[] = R"(
CREATE TABLE dgsfm_schema (version INTEGER NOT NULL);
INSERT INTO dgsfm_schema VALUES (4);
CREATE TABLE dgsfm_depth_maps (
  image_id INTEGER PRIMARY KEY NOT NULL
           REFERENCES images(image_id) ON DELETE CASCADE,
  width    INTEGER NOT NULL,
  height   INTEGER NOT NULL,
  unit     INTEGER NOT NULL,
  data     BLOB NOT NULL);
CREATE TABLE dgsfm_keypoint_depths (
  image_id              INTEGER PRIMARY KEY NOT NULL
                        REFERENCES images(image_id) ON DELETE CASCADE,
  unit                  INTEGER NOT NULL,
  rows                  INTEGER NOT NULL,
  data                  BLOB NOT NULL,
  focal_length          REAL NOT NULL DEFAULT 0,
  keypoints_fingerprint INTEGER NOT NULL DEFAULT 0,
  source_fingerprint    INTEGER NOT NULL DEFAULT 0);
)";

constexpr char kCreatePairTable[] = R"(
CREATE TABLE dgsfm_pair_geometries (
  pair_id          INTEGER PRIMARY KEY NOT NULL,
  status           INTEGER NOT NULL,
  qvec             BLOB NOT NULL,
  tvec             BLOB NOT NULL,
  has_scale        INTEGER NOT NULL,
  scale            REAL NOT NULL,
  focal1           REAL NOT NULL,
  focal2           REAL NOT NULL,
  estimated_focal1 INTEGER NOT NULL,
  estimated_focal2 INTEGER NOT NULL,
  degeneracies     INTEGER NOT NULL,
  log_scale_stddev REAL NOT NULL,
  num_matches      INTEGER NOT NULL,
  rows             INTEGER NOT NULL,
  matches          BLOB NOT NULL,
  depth_verified   BLOB NOT NULL,
  fingerprint      INTEGER NOT NULL);
)";

constexpr char kCreatePairStatusTable[] = R"(
CREATE TABLE IF NOT EXISTS dgsfm_pair_statuses (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  status  INTEGER NOT NULL,
  name    TEXT NOT NULL);
)";

constexpr char kCreateDisplayedImageTable[] = R"(
CREATE TABLE IF NOT EXISTS dgsfm_displayed_images (
  image_id INTEGER PRIMARY KEY NOT NULL
           REFERENCES images(image_id) ON DELETE CASCADE);
)";

// Each update leads to the next version, so that they can be chained.
constexpr char kUpdateFromVersion1[] = R"(
ALTER TABLE dgsfm_keypoint_depths
  ADD COLUMN focal_length REAL NOT NULL DEFAULT 0;
)";

constexpr char kUpdateFromVersion2[] = R"(
ALTER TABLE dgsfm_keypoint_depths
  ADD COLUMN keypoints_fingerprint INTEGER NOT NULL DEFAULT 0;
ALTER TABLE dgsfm_keypoint_depths
  ADD COLUMN source_fingerprint INTEGER NOT NULL DEFAULT 0;
)";

// What earlier versions of the program found about pairs does not hold any
// more.
constexpr char kUpdatePairs[] = R"(
DROP TABLE dgsfm_pair_geometries;
UPDATE dgsfm_schema SET version = 4;
)";

// 0 without tables.
int64_t TablesVersion(const SqliteConnection& connection) {
  if (!connection.HasTable("dgsfm_schema")) return 0;
  SqliteStatement select(connection, "SELECT version FROM dgsfm_schema");
  // A table without a row is of no version, which HasDepthTables() refuses.
  return select.Step() ? select.Int(0) : -1;
}

}  // namespace

bool HasDepthTables(const SqliteConnection& connection) {
  const int64_t version = TablesVersion(connection);
  if (version == 0) return false;
  if (version >= kFirstVersionOfDepth && version <= kVersion) return true;
  throw connection.Error()
      << "its depth tables have version " << version
      << ", this program uses version " << kVersion
      << (version >= 1 && version < kVersion
              ? "; run depth_geometric_verifier, which brings them up to date"
              : "; use the version of the program that wrote them");
}

bool HasPairTable(const SqliteConnection& connection) {
  return HasDepthTables(connection) && TablesVersion(connection) == kVersion;
}

void CreateDepthTables(const SqliteConnection& connection) {
  connection.Execute(kCreateDepthTables);
  CreatePairTable(connection);
}

void CreatePairTable(const SqliteConnection& connection) {
  connection.Execute(kCreatePairTable);
}

void CreatePairStatusTable(const SqliteConnection& connection) {
  connection.Execute(kCreatePairStatusTable);
}

void CreateDisplayedImageTable(const SqliteConnection& connection) {
  connection.Execute(kCreateDisplayedImageTable);
}

void UpdateDepthTables(const SqliteConnection& connection) {
  const int64_t version = TablesVersion(connection);
  if (version < 1 || version >= kVersion) return;
  SqliteTransaction transaction(connection, SqliteTransaction::Kind::WRITE);
  if (version < 2) connection.Execute(kUpdateFromVersion1);
  if (version < 3) connection.Execute(kUpdateFromVersion2);
  connection.Execute(kUpdatePairs);
  connection.Execute(kCreatePairTable);
  transaction.Commit();
}

}  // namespace dgsfm
