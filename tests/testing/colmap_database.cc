#include "tests/testing/colmap_database.h"

#include <utility>

namespace dgsfm {
namespace {

// Tables that are the same in all versions.
constexpr char kCommonTables[] = R"(
CREATE TABLE cameras (
  camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  model INTEGER NOT NULL, width INTEGER NOT NULL, height INTEGER NOT NULL,
  params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE keypoints (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB);
CREATE TABLE two_view_geometries (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  config INTEGER NOT NULL, F BLOB, E BLOB, H BLOB, qvec BLOB, tvec BLOB);
)";

constexpr char kImagesOfV3_8[] = R"(
CREATE TABLE images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
  prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL,
  prior_tx REAL, prior_ty REAL, prior_tz REAL,
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
PRAGMA user_version = 3800;
)";

constexpr char kImagesRigsAndFrames[] = R"(
CREATE TABLE images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE, camera_id INTEGER NOT NULL,
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE rigs (
  rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  ref_sensor_id INTEGER NOT NULL, ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment
  ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (
  rig_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
  sensor_type INTEGER NOT NULL, sensor_from_rig BLOB,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX rig_sensor_assignment
  ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE frames (
  frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  rig_id INTEGER NOT NULL,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (
  frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL,
  sensor_id INTEGER NOT NULL, sensor_type INTEGER NOT NULL,
  FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment
  ON frame_data(data_id, sensor_type);
)";

constexpr char kRestOfV3_12[] = R"(
CREATE TABLE descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE pose_priors (
  image_id INTEGER PRIMARY KEY NOT NULL, position BLOB,
  coordinate_system INTEGER NOT NULL, position_covariance BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
PRAGMA user_version = 3120000;
)";

constexpr char kRestOfV4_2[] = R"(
CREATE TABLE descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL, type INTEGER NOT NULL,
  rows INTEGER NOT NULL, cols INTEGER NOT NULL, data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE pose_priors (
  pose_prior_id INTEGER PRIMARY KEY NOT NULL,
  corr_data_id INTEGER NOT NULL, corr_sensor_id INTEGER NOT NULL,
  corr_sensor_type INTEGER NOT NULL, position BLOB,
  position_covariance BLOB, gravity BLOB, coordinate_system INTEGER NOT NULL);
CREATE UNIQUE INDEX pose_prior_data_assignment
  ON pose_priors(corr_data_id, corr_sensor_id, corr_sensor_type);
ALTER TABLE two_view_geometries ADD COLUMN camera1 BLOB;
ALTER TABLE two_view_geometries ADD COLUMN camera2 BLOB;
PRAGMA user_version = 4020100;
)";

std::vector<uint32_t> MatchBlob(const colmap::FeatureMatches& matches) {
  std::vector<uint32_t> blob;
  for (const colmap::FeatureMatch& match : matches) {
    blob.push_back(match.point2D_idx1);
    blob.push_back(match.point2D_idx2);
  }
  return blob;
}

}  // namespace

ColmapDatabaseWriter::ColmapDatabaseWriter(const std::string& path,
                                           ColmapSchema schema)
    : connection_(path, SqliteConnection::Mode::CREATE), schema_(schema) {
  // As COLMAP opens its databases; syncing would only slow the tests down.
  Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = OFF");
  Execute(kCommonTables);
  if (schema == ColmapSchema::V3_8) {
    Execute(kImagesOfV3_8);
  } else {
    Execute(kImagesRigsAndFrames);
    Execute(schema == ColmapSchema::V3_12 ? kRestOfV3_12 : kRestOfV4_2);
  }
}

colmap::camera_t ColmapDatabaseWriter::AddCamera(
    int model_id,
    int width,
    int height,
    const std::vector<double>& params,
    bool has_prior_focal_length) {
  SqliteStatement(connection_,
                  "INSERT INTO cameras(model, width, height, params, "
                  "prior_focal_length) VALUES(?, ?, ?, ?, ?)")
      .Bind(model_id, width, height, params, has_prior_focal_length)
      .Run();
  const int64_t camera_id = sqlite3_last_insert_rowid(connection_.Handle());
  if (schema_ != ColmapSchema::V3_8) {
    // Sensor type 0 is a camera.
    SqliteStatement(
        connection_,
        "INSERT INTO rigs(ref_sensor_id, ref_sensor_type) VALUES(?, 0)")
        .Bind(camera_id)
        .Run();
  }
  return static_cast<colmap::camera_t>(camera_id);
}

colmap::image_t ColmapDatabaseWriter::AddImage(
    const std::string& name,
    colmap::camera_t camera_id,
    const std::vector<Eigen::Vector2d>& keypoints,
    int num_cols) {
  SqliteStatement(connection_,
                  "INSERT INTO images(name, camera_id) VALUES(?, ?)")
      .Bind(name, camera_id)
      .Run();
  const int64_t image_id = sqlite3_last_insert_rowid(connection_.Handle());
  if (schema_ != ColmapSchema::V3_8) {
    SqliteStatement(connection_,
                    "INSERT INTO frames(rig_id) SELECT rig_id FROM rigs "
                    "WHERE ref_sensor_id = ? AND ref_sensor_type = 0")
        .Bind(camera_id)
        .Run();
    SqliteStatement(connection_,
                    "INSERT INTO frame_data VALUES(last_insert_rowid(), ?, ?, "
                    "0)")
        .Bind(image_id, camera_id)
        .Run();
  }
  if (!keypoints.empty()) {
    std::vector<float> data;
    for (const Eigen::Vector2d& keypoint : keypoints) {
      data.push_back(static_cast<float>(keypoint.x()));
      data.push_back(static_cast<float>(keypoint.y()));
      for (int col = 2; col < num_cols; ++col) {
        data.push_back(col == 2 || col == 5 ? 1.0f : 0.0f);
      }
    }
    SqliteStatement(connection_, "INSERT INTO keypoints VALUES(?, ?, ?, ?)")
        .Bind(image_id, keypoints.size(), num_cols, data)
        .Run();
  }
  return static_cast<colmap::image_t>(image_id);
}

void ColmapDatabaseWriter::AddMatches(colmap::image_t image_id1,
                                      colmap::image_t image_id2,
                                      colmap::FeatureMatches matches,
                                      bool verified) {
  if (image_id1 > image_id2) {
    std::swap(image_id1, image_id2);
    for (colmap::FeatureMatch& match : matches) {
      std::swap(match.point2D_idx1, match.point2D_idx2);
    }
  }
  const int64_t pair_id = int64_t{2147483647} * image_id1 + image_id2;
  const std::vector<uint32_t> blob = MatchBlob(matches);
  SqliteStatement(connection_, "INSERT INTO matches VALUES(?, ?, 2, ?)")
      .Bind(pair_id, matches.size(), blob)
      .Run();
  if (!verified) return;
  // Config 2 is a calibrated pair.
  SqliteStatement(connection_,
                  "INSERT INTO two_view_geometries(pair_id, rows, cols, data, "
                  "config) VALUES(?, ?, 2, ?, 2)")
      .Bind(pair_id, matches.size(), blob)
      .Run();
}

}  // namespace dgsfm
