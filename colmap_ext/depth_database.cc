#include "colmap_ext/depth_database.h"

#include "colmap_ext/check.h"
#include "colmap_ext/colmap_schema.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace dgsfm {
namespace {

constexpr int64_t kSchemaVersion = 1;

constexpr char kCreateTables[] = R"(
CREATE TABLE dgsfm_schema (version INTEGER NOT NULL);
INSERT INTO dgsfm_schema VALUES (1);
CREATE TABLE dgsfm_depth_maps (
  image_id INTEGER PRIMARY KEY NOT NULL
           REFERENCES images(image_id) ON DELETE CASCADE,
  width    INTEGER NOT NULL,
  height   INTEGER NOT NULL,
  unit     INTEGER NOT NULL,
  data     BLOB NOT NULL);
CREATE TABLE dgsfm_keypoint_depths (
  image_id INTEGER PRIMARY KEY NOT NULL
           REFERENCES images(image_id) ON DELETE CASCADE,
  unit     INTEGER NOT NULL,
  rows     INTEGER NOT NULL,
  data     BLOB NOT NULL);
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
  num_matches      INTEGER NOT NULL,
  rows             INTEGER NOT NULL,
  matches          BLOB NOT NULL,
  depth_verified   BLOB NOT NULL);
)";

bool IsDepth(float depth) { return std::isfinite(depth) && depth >= 0; }

void CheckContract(const PairGeometry& geometry) {
  const Rigid3d& pose = geometry.cam2_from_cam1;
  // The quaternion comes back as it is, so it has to be a rotation.
  DGSFM_CHECK(std::abs(pose.rotation.norm() - 1) < 1e-6)
      << pose.rotation.norm();
  DGSFM_CHECK(pose.translation.allFinite());
  DGSFM_CHECK(std::isfinite(geometry.scale_1_from_2) &&
              geometry.scale_1_from_2 > 0)
      << geometry.scale_1_from_2;
  for (const double focal_length_px :
       {geometry.focal_length1_px, geometry.focal_length2_px}) {
    DGSFM_CHECK(std::isfinite(focal_length_px) && focal_length_px >= 0)
        << focal_length_px;
  }
  DGSFM_CHECK(geometry.depth_verified.size() == geometry.inlier_matches.size());
}

std::vector<uint32_t> FlattenMatches(const colmap::FeatureMatches& matches) {
  std::vector<uint32_t> flat;
  flat.reserve(2 * matches.size());
  for (const colmap::FeatureMatch& match : matches) {
    flat.push_back(match.point2D_idx1);
    flat.push_back(match.point2D_idx2);
  }
  return flat;
}

}  // namespace

struct DepthDatabase::Impl {
  struct ImageInfo {
    std::string name;
    int64_t num_keypoints = 0;
  };

  Impl(const std::string& path,
       Mode open_mode,
       std::chrono::milliseconds timeout)
      : connection(path,
                   open_mode == Mode::READ_ONLY
                       ? SqliteConnection::Mode::READ_ONLY
                       : SqliteConnection::Mode::READ_WRITE,
                   timeout),
        mode(open_mode) {
    const SqliteTransaction snapshot(connection, SqliteTransaction::Kind::READ);
    CheckIsColmapDatabase(connection);
    HasTables();  // Refuses unknown versions.
  }

  // Whether the tables are there, in the version that we know.
  bool HasTables() const {
    if (!connection.HasTable("dgsfm_schema")) return false;
    SqliteStatement select(connection, "SELECT version FROM dgsfm_schema");
    const int64_t version = select.Step() ? select.Int(0) : 0;
    if (version != kSchemaVersion) {
      throw connection.Error()
          << "its depth tables have version " << version
          << ", this program knows version " << kSchemaVersion
          << "; use the version of the program that wrote them";
    }
    return true;
  }

  // Runs `write` with the tables in place; all or nothing.
  template <typename Write>
  void RunWrite(const Write& write) {
    DGSFM_CHECK(mode == Mode::READ_WRITE) << connection.Path();
    SqliteTransaction write_transaction(connection,
                                        SqliteTransaction::Kind::WRITE);
    if (!HasTables()) connection.Execute(kCreateTables);
    write();
    write_transaction.Commit();
  }

  ImageInfo ReadImage(colmap::image_t image_id) const {
    SqliteStatement select(
        connection,
        "SELECT name, coalesce(keypoints.rows, 0) FROM images "
        "LEFT JOIN keypoints USING (image_id) "
        "WHERE images.image_id = ?");
    select.BindInt(1, image_id);
    if (!select.Step()) {
      throw connection.Error() << "no image with id " << image_id;
    }
    return {select.Text(0), select.Int(1)};
  }

  DepthUnit CheckedUnit(int64_t unit, const std::string& name) const {
    if (unit != static_cast<int>(DepthUnit::METRIC) &&
        unit != static_cast<int>(DepthUnit::RELATIVE)) {
      throw connection.Error()
          << "image " << name << ": unknown depth unit " << unit;
    }
    return static_cast<DepthUnit>(unit);
  }

  // The statement's columns are those of ReadPairGeometries().
  PairGeometry ReadPairGeometry(const SqliteStatement& row) const {
    const std::string pair = "pair " + row.Text(14) + " - " + row.Text(15);
    const int64_t num_keypoints1 = row.Int(16);
    const int64_t num_keypoints2 = row.Int(17);
    const auto qvec = row.Blob<double>(2);
    const auto tvec = row.Blob<double>(3);
    const auto matches = row.Blob<uint32_t>(12);
    const size_t num_rows = matches.size() / 2;
    PairGeometry geometry;
    geometry.status = static_cast<PairStatus>(row.Int(1));
    geometry.has_scale = row.Int(4) != 0;
    geometry.scale_1_from_2 = row.Double(5);
    geometry.focal_length1_px = row.Double(6);
    geometry.focal_length2_px = row.Double(7);
    geometry.estimated_focal1 = row.Int(8) != 0;
    geometry.estimated_focal2 = row.Int(9) != 0;
    geometry.num_matches = static_cast<size_t>(row.Int(10));
    geometry.depth_verified = row.Blob<uint8_t>(13);
    if (qvec.size() != 4 || tvec.size() != 3 ||
        row.Int(11) != int64_t(num_rows)) {
      throw connection.Error()
          << pair << ": damaged geometry; run depth_geometric_verifier again";
    }
    geometry.cam2_from_cam1 = {{qvec[0], qvec[1], qvec[2], qvec[3]},
                               {tvec[0], tvec[1], tvec[2]}};
    for (size_t i = 0; i < num_rows; ++i) {
      geometry.inlier_matches.emplace_back(matches[2 * i], matches[2 * i + 1]);
      if (matches[2 * i] >= num_keypoints1 ||
          matches[2 * i + 1] >= num_keypoints2) {
        throw connection.Error()
            << pair
            << ": its geometry refers to key points that are gone; run "
               "depth_geometric_verifier again";
      }
    }
    try {
      PairStatusName(geometry.status);
      CheckContract(geometry);
    } catch (const std::invalid_argument&) {
      throw connection.Error()
          << pair << ": damaged geometry; run depth_geometric_verifier again";
    }
    return geometry;
  }

  SqliteConnection connection;
  const Mode mode;
  std::optional<SqliteTransaction> transaction;
};

DepthDatabase::DepthDatabase(const std::string& path,
                             Mode mode,
                             std::chrono::milliseconds busy_timeout)
    : impl_(std::make_unique<Impl>(path, mode, busy_timeout)) {}

DepthDatabase::~DepthDatabase() = default;

void DepthDatabase::WriteDepthMap(colmap::image_t image_id,
                                  const DepthMap& depth_map,
                                  const KeypointDepths& keypoint_depths) {
  WriteCompressedDepthMap(image_id, CompressDepth(depth_map), keypoint_depths);
}

void DepthDatabase::WriteCompressedDepthMap(
    colmap::image_t image_id,
    const CompressedDepthMap& depth_map,
    const KeypointDepths& keypoint_depths) {
  DGSFM_CHECK(std::all_of(
      keypoint_depths.depths.begin(), keypoint_depths.depths.end(), IsDepth));
  impl_->RunWrite([&] {
    const Impl::ImageInfo image = impl_->ReadImage(image_id);
    DGSFM_CHECK(int64_t(keypoint_depths.depths.size()) == image.num_keypoints)
        << keypoint_depths.depths.size() << " depths for "
        << image.num_keypoints << " key points of " << image.name;
    SqliteStatement(impl_->connection,
                    "INSERT OR REPLACE INTO dgsfm_depth_maps(image_id, width, "
                    "height, unit, data) VALUES (?, ?, ?, ?, ?)")
        .BindInt(1, image_id)
        .BindInt(2, depth_map.width)
        .BindInt(3, depth_map.height)
        .BindInt(4, static_cast<int>(depth_map.unit))
        .BindBlob(5, depth_map.bytes)
        .Run();
    SqliteStatement(impl_->connection,
                    "INSERT OR REPLACE INTO dgsfm_keypoint_depths(image_id, "
                    "unit, rows, data) VALUES (?, ?, ?, ?)")
        .BindInt(1, image_id)
        .BindInt(2, static_cast<int>(keypoint_depths.unit))
        .BindInt(3, static_cast<int64_t>(keypoint_depths.depths.size()))
        .BindBlob(4, keypoint_depths.depths)
        .Run();
  });
}

bool DepthDatabase::HasDepthMap(colmap::image_t image_id) const {
  if (!impl_->HasTables()) return false;
  SqliteStatement select(impl_->connection,
                         "SELECT 1 FROM dgsfm_depth_maps WHERE image_id = ?");
  return select.BindInt(1, image_id).Step();
}

DepthMap DepthDatabase::ReadDepthMap(colmap::image_t image_id) const {
  const std::string name = impl_->ReadImage(image_id).name;
  if (!HasDepthMap(image_id)) {
    throw impl_->connection.Error() << "image " << name << " has no depth map";
  }
  SqliteStatement select(impl_->connection,
                         "SELECT width, height, unit, data "
                         "FROM dgsfm_depth_maps WHERE image_id = ?");
  select.BindInt(1, image_id).Step();
  const int64_t width = select.Int(0);
  const int64_t height = select.Int(1);
  if (std::max(width, height) > kMaxDepthMapSize) {
    throw impl_->connection.Error()
        << "image " << name << ": depth map of " << width << " x " << height;
  }
  const DepthUnit unit = impl_->CheckedUnit(select.Int(2), name);
  try {
    return DecompressDepth({static_cast<int>(width),
                            static_cast<int>(height),
                            unit,
                            select.Blob<uint8_t>(3)});
  } catch (const std::runtime_error& error) {
    throw impl_->connection.Error()
        << "depth map of image " << name << ": " << error.what()
        << "; run depth_importer again";
  }
}

std::map<colmap::image_t, KeypointDepths> DepthDatabase::ReadAllKeypointDepths()
    const {
  std::map<colmap::image_t, KeypointDepths> all_depths;
  if (!impl_->HasTables()) return all_depths;
  SqliteStatement select(
      impl_->connection,
      "SELECT images.image_id, name, coalesce(keypoints.rows, 0), unit, "
      "depths.rows, "
      "depths.data FROM dgsfm_keypoint_depths AS depths "
      "JOIN images USING (image_id) LEFT JOIN keypoints USING (image_id)");
  while (select.Step()) {
    const std::string name = select.Text(1);
    const int64_t num_keypoints = select.Int(2);
    KeypointDepths depths;
    depths.unit = impl_->CheckedUnit(select.Int(3), name);
    depths.depths = select.Blob<float>(5);
    if (select.Int(4) != int64_t(depths.depths.size()) ||
        !std::all_of(depths.depths.begin(), depths.depths.end(), IsDepth)) {
      throw impl_->connection.Error()
          << "image " << name
          << ": damaged depth at key points; run depth_importer again";
    }
    if (select.Int(4) != num_keypoints) {
      throw impl_->connection.Error()
          << "image " << name << " has " << num_keypoints
          << " key points, but depth was imported for " << select.Int(4)
          << "; features were extracted again since: run depth_importer "
             "again";
    }
    all_depths.emplace(static_cast<colmap::image_t>(select.Int(0)),
                       std::move(depths));
  }
  return all_depths;
}

void DepthDatabase::WritePairGeometries(
    const std::map<colmap::image_pair_t, PairGeometry>& geometries) {
  for (const auto& [pair_id, geometry] : geometries) CheckContract(geometry);
  impl_->RunWrite([&] {
    SqliteStatement insert(
        impl_->connection,
        "INSERT OR REPLACE INTO dgsfm_pair_geometries(pair_id, status, qvec, "
        "tvec, has_scale, scale, focal1, focal2, estimated_focal1, "
        "estimated_focal2, num_matches, rows, matches, depth_verified) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
    for (const auto& [pair_id, geometry] : geometries) {
      const Rigid3d& pose = geometry.cam2_from_cam1;
      const Eigen::Vector4d qvec = QvecFromRotation(pose.rotation);
      insert.BindInt(1, static_cast<int64_t>(pair_id))
          .BindInt(2, static_cast<int>(geometry.status))
          .BindBytes(3, qvec.data(), 4 * sizeof(double))
          .BindBytes(4, pose.translation.data(), 3 * sizeof(double))
          .BindInt(5, geometry.has_scale)
          .BindDouble(6, geometry.scale_1_from_2)
          .BindDouble(7, geometry.focal_length1_px)
          .BindDouble(8, geometry.focal_length2_px)
          .BindInt(9, geometry.estimated_focal1)
          .BindInt(10, geometry.estimated_focal2)
          .BindInt(11, static_cast<int64_t>(geometry.num_matches))
          .BindInt(12, static_cast<int64_t>(geometry.inlier_matches.size()))
          .BindBlob(13, FlattenMatches(geometry.inlier_matches))
          .BindBlob(14, geometry.depth_verified)
          .Run();
    }
  });
}

std::map<colmap::image_pair_t, PairGeometry> DepthDatabase::ReadPairGeometries()
    const {
  std::map<colmap::image_pair_t, PairGeometry> geometries;
  if (!impl_->HasTables()) return geometries;
  // Joined by the ids in the pair id, images that have been deleted drop out.
  SqliteStatement select(
      impl_->connection,
      "SELECT pair_id, status, qvec, tvec, has_scale, scale, focal1, focal2, "
      "estimated_focal1, estimated_focal2, num_matches, pairs.rows, matches, "
      "depth_verified, image1.name, image2.name, "
      "coalesce(keypoints1.rows, 0), coalesce(keypoints2.rows, 0) "
      "FROM dgsfm_pair_geometries AS pairs "
      "JOIN images AS image1 ON image1.image_id = pair_id / 2147483647 "
      "JOIN images AS image2 ON image2.image_id = pair_id % 2147483647 "
      "LEFT JOIN keypoints AS keypoints1 "
      "ON keypoints1.image_id = image1.image_id "
      "LEFT JOIN keypoints AS keypoints2 "
      "ON keypoints2.image_id = image2.image_id");
  while (select.Step()) {
    geometries.emplace(static_cast<colmap::image_pair_t>(select.Int(0)),
                       impl_->ReadPairGeometry(select));
  }
  return geometries;
}

void DepthDatabase::DeletePairGeometries() {
  impl_->RunWrite(
      [&] { impl_->connection.Execute("DELETE FROM dgsfm_pair_geometries"); });
}

void DepthDatabase::BeginTransaction() {
  DGSFM_CHECK(impl_->mode == Mode::READ_WRITE) << impl_->connection.Path();
  DGSFM_CHECK(!impl_->transaction) << "transactions do not nest";
  impl_->transaction.emplace(impl_->connection, SqliteTransaction::Kind::WRITE);
}

void DepthDatabase::CommitTransaction() {
  DGSFM_CHECK(impl_->transaction.has_value()) << "no transaction to commit";
  impl_->transaction->Commit();
  impl_->transaction.reset();
}

}  // namespace dgsfm
