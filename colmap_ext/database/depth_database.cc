#include "colmap_ext/database/depth_database.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/colmap_schema.h"
#include "colmap_ext/database/depth_schema.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/pair_geometry_table.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/fnv_hash.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

namespace dgsfm {
namespace {

constexpr char kSelectSamples[] =
    "SELECT images.image_id, name, coalesce(keypoints.rows, 0), unit, "
    "depths.rows, depths.data, focal_length, keypoints_fingerprint, "
    "source_fingerprint, keypoints.data FROM dgsfm_keypoint_depths AS depths "
    "JOIN images USING (image_id) LEFT JOIN keypoints USING (image_id)";

bool AreDepths(const KeypointDepths& keypoint_depths) {
  const bool is_affine = IsAffine(keypoint_depths.unit);
  return std::all_of(keypoint_depths.depths.begin(),
                     keypoint_depths.depths.end(),
                     [&](float depth) {
                       return std::isfinite(depth) && (is_affine || depth >= 0);
                     });
}

bool IsFocalLength(double focal_length_px) {
  return std::isfinite(focal_length_px) && focal_length_px >= 0;
}

void CheckSamples(const KeypointDepths& keypoint_depths) {
  DGSFM_CHECK(IsFocalLength(keypoint_depths.focal_length_px))
      << keypoint_depths.focal_length_px;
  DGSFM_CHECK(AreDepths(keypoint_depths));
}

// Hash of the blob of key points; a NULL is an empty one.
uint64_t KeypointsFingerprint(const SqliteStatement& row, int column) {
  FnvHash hash;
  hash.AddAll(row.Blob<uint32_t>(column));
  return hash.Value();
}

}  // namespace

struct DepthDatabase::Impl {
  struct ImageInfo {
    std::string name;
    int64_t num_keypoints = 0;
    uint64_t keypoints_fingerprint = 0;
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
    CheckIsColmapDatabase(connection);
    if (mode == Mode::READ_WRITE) UpdateDepthTables(connection);
    HasTables();  // Refuses other versions.
  }

  bool HasTables() const { return HasDepthTables(connection); }
  bool HasPairs() const { return HasPairTable(connection); }

  // Runs `write` with the tables in place; all or nothing.
  template <typename Write>
  void RunWrite(const Write& write) {
    DGSFM_CHECK(mode == Mode::READ_WRITE) << connection.Path();
    SqliteTransaction write_transaction(connection,
                                        SqliteTransaction::Kind::WRITE);
    if (!HasTables()) CreateDepthTables(connection);
    write();
    write_transaction.Commit();
  }

  ImageInfo ReadImage(colmap::image_t image_id) const {
    SqliteStatement select(
        connection,
        "SELECT name, coalesce(keypoints.rows, 0), keypoints.data FROM images "
        "LEFT JOIN keypoints USING (image_id) "
        "WHERE images.image_id = ?");
    select.BindInt(1, image_id);
    if (!select.Step()) {
      throw connection.Error() << "no image with id " << image_id;
    }
    return {select.Text(0), select.Int(1), KeypointsFingerprint(select, 2)};
  }

  DepthUnit CheckedUnit(int64_t unit, const std::string& name) const {
    if (unit < static_cast<int>(DepthUnit::METRIC) ||
        unit > static_cast<int>(kAffineDepth)) {
      throw connection.Error()
          << "image " << name << ": unknown depth unit " << unit
          << "; use the version of the program that wrote it";
    }
    return static_cast<DepthUnit>(unit);
  }

  void WriteSamples(colmap::image_t image_id,
                    const KeypointDepths& keypoint_depths);
  // Reads a row of kSelectSamples.
  KeypointDepths ReadSamples(const SqliteStatement& row) const;

  SqliteConnection connection;
  const Mode mode;
  std::optional<SqliteTransaction> transaction;
};

DepthDatabase::DepthDatabase(const std::string& path,
                             Mode mode,
                             std::chrono::milliseconds busy_timeout)
    : impl_(std::make_unique<Impl>(path, mode, busy_timeout)) {}

DepthDatabase::~DepthDatabase() = default;

void DepthDatabase::Impl::WriteSamples(colmap::image_t image_id,
                                       const KeypointDepths& keypoint_depths) {
  const ImageInfo image = ReadImage(image_id);
  DGSFM_CHECK(int64_t(keypoint_depths.depths.size()) == image.num_keypoints)
      << keypoint_depths.depths.size() << " depths for " << image.num_keypoints
      << " key points of " << image.name;
  SqliteStatement(connection,
                  "INSERT OR REPLACE INTO dgsfm_keypoint_depths(image_id, "
                  "unit, rows, data, focal_length, keypoints_fingerprint, "
                  "source_fingerprint) VALUES (?, ?, ?, ?, ?, ?, ?)")
      .BindInt(1, image_id)
      .BindInt(2, static_cast<int>(keypoint_depths.unit))
      .BindInt(3, static_cast<int64_t>(keypoint_depths.depths.size()))
      .BindBlob(4, keypoint_depths.depths)
      .BindDouble(5, keypoint_depths.focal_length_px)
      .BindInt(6, static_cast<int64_t>(image.keypoints_fingerprint))
      .BindInt(7, static_cast<int64_t>(keypoint_depths.source_fingerprint))
      .Run();
}

void DepthDatabase::WriteDepthMap(colmap::image_t image_id,
                                  const DepthMap& depth_map,
                                  const KeypointDepths& keypoint_depths) {
  WriteCompressedDepthMap(image_id, CompressDepth(depth_map), keypoint_depths);
}

void DepthDatabase::WriteCompressedDepthMap(
    colmap::image_t image_id,
    const CompressedDepthMap& depth_map,
    const KeypointDepths& keypoint_depths) {
  CheckSamples(keypoint_depths);
  impl_->RunWrite([&] {
    impl_->WriteSamples(image_id, keypoint_depths);
    SqliteStatement(impl_->connection,
                    "INSERT OR REPLACE INTO dgsfm_depth_maps(image_id, width, "
                    "height, unit, data) VALUES (?, ?, ?, ?, ?)")
        .BindInt(1, image_id)
        .BindInt(2, depth_map.width)
        .BindInt(3, depth_map.height)
        .BindInt(4, static_cast<int>(depth_map.unit))
        .BindBlob(5, depth_map.bytes)
        .Run();
  });
}

void DepthDatabase::WriteKeypointDepths(colmap::image_t image_id,
                                        const KeypointDepths& keypoint_depths) {
  CheckSamples(keypoint_depths);
  impl_->RunWrite([&] {
    impl_->WriteSamples(image_id, keypoint_depths);
    SqliteStatement(impl_->connection,
                    "DELETE FROM dgsfm_depth_maps WHERE image_id = ?")
        .BindInt(1, image_id)
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

KeypointDepths DepthDatabase::Impl::ReadSamples(
    const SqliteStatement& row) const {
  const std::string name = row.Text(1);
  KeypointDepths depths;
  depths.unit = CheckedUnit(row.Int(3), name);
  depths.depths = row.Blob<float>(5);
  depths.focal_length_px = row.Double(6);
  depths.source_fingerprint = static_cast<uint64_t>(row.Int(8));
  if (!IsFocalLength(depths.focal_length_px) ||
      row.Int(4) != int64_t(depths.depths.size()) || !AreDepths(depths)) {
    throw connection.Error()
        << "image " << name
        << ": damaged depth at key points; run depth_importer again";
  }
  const auto fingerprint = static_cast<uint64_t>(row.Int(7));
  if (row.Int(4) != row.Int(2) ||
      (fingerprint != 0 && fingerprint != KeypointsFingerprint(row, 9))) {
    throw connection.Error()
        << "image " << name << " has " << row.Int(2)
        << " key points, but depth was imported for "
        << (row.Int(4) == row.Int(2) ? "other " : "") << row.Int(4)
        << "; features were "
        << (row.Int(2) == 0 ? "deleted since: extract them and"
                            : "extracted again since:")
        << " run depth_importer again";
  }
  return depths;
}

std::map<colmap::image_t, KeypointDepths> DepthDatabase::ReadAllKeypointDepths(
    const KeptKeypoints& kept) const {
  std::map<colmap::image_t, KeypointDepths> all_depths;
  if (!impl_->HasTables()) return all_depths;
  SqliteStatement select(impl_->connection, kSelectSamples);
  while (select.Step()) {
    const auto image_id = static_cast<colmap::image_t>(select.Int(0));
    KeypointDepths depths = impl_->ReadSamples(select);
    depths.depths = RestrictToKept(kept, image_id, std::move(depths.depths));
    all_depths.emplace(image_id, std::move(depths));
  }
  return all_depths;
}

std::optional<KeypointDepths> DepthDatabase::ReadKeypointDepths(
    colmap::image_t image_id) const {
  if (!impl_->HasTables()) return std::nullopt;
  SqliteStatement select(
      impl_->connection,
      std::string(kSelectSamples) + " WHERE images.image_id = ?");
  if (!select.BindInt(1, image_id).Step()) return std::nullopt;
  return impl_->ReadSamples(select);
}

std::map<colmap::image_t, uint64_t> DepthDatabase::ReadSourceFingerprints()
    const {
  std::map<colmap::image_t, uint64_t> fingerprints;
  if (!impl_->HasTables()) return fingerprints;
  SqliteStatement select(
      impl_->connection,
      "SELECT images.image_id, source_fingerprint, keypoints_fingerprint, "
      "keypoints.data FROM dgsfm_keypoint_depths "
      "JOIN images USING (image_id) LEFT JOIN keypoints USING (image_id)");
  while (select.Step()) {
    if (static_cast<uint64_t>(select.Int(2)) !=
        KeypointsFingerprint(select, 3)) {
      continue;
    }
    fingerprints.emplace(static_cast<colmap::image_t>(select.Int(0)),
                         static_cast<uint64_t>(select.Int(1)));
  }
  return fingerprints;
}

void DepthDatabase::WritePairGeometries(
    const std::map<colmap::image_pair_t, PairGeometry>& geometries) {
  for (const auto& [pair_id, geometry] : geometries) {
    CheckPairGeometry(geometry);
  }
  impl_->RunWrite([&] {
    PairGeometryInserter inserter(impl_->connection);
    for (const auto& [pair_id, geometry] : geometries) {
      inserter.Insert(pair_id, geometry);
    }
  });
}

std::map<colmap::image_pair_t, PairGeometry> DepthDatabase::ReadPairGeometries(
    const KeptKeypoints& kept) const {
  std::map<colmap::image_pair_t, PairGeometry> geometries;
  if (!impl_->HasPairs()) return geometries;
  PairGeometryCursor cursor(impl_->connection);
  while (cursor.Step()) {
    PairGeometry geometry = cursor.Geometry();
    if (!kept.empty()) RestrictInliers(kept, cursor.PairId(), &geometry);
    geometries.emplace_hint(
        geometries.end(), cursor.PairId(), std::move(geometry));
  }
  return geometries;
}

std::map<colmap::image_pair_t, uint64_t> DepthDatabase::ReadPairFingerprints()
    const {
  std::map<colmap::image_pair_t, uint64_t> fingerprints;
  if (!impl_->HasPairs()) return fingerprints;
  SqliteStatement select(impl_->connection,
                         "SELECT pair_id, fingerprint "
                         "FROM dgsfm_pair_geometries ORDER BY pair_id");
  while (select.Step()) {
    fingerprints.emplace_hint(fingerprints.end(),
                              static_cast<colmap::image_pair_t>(select.Int(0)),
                              static_cast<uint64_t>(select.Int(1)));
  }
  return fingerprints;
}

PairTotals DepthDatabase::ReadPairTotals() const {
  PairTotals totals;
  if (!impl_->HasPairs()) return totals;
  SqliteStatement select(impl_->connection,
                         "SELECT status, degeneracies, count(*) "
                         "FROM dgsfm_pair_geometries GROUP BY 1, 2");
  while (select.Step()) {
    totals.Add(static_cast<PairStatus>(select.Int(0)),
               static_cast<uint32_t>(select.Int(1)),
               static_cast<size_t>(select.Int(2)));
  }
  return totals;
}

void DepthDatabase::DeletePairGeometries(
    const std::vector<colmap::image_pair_t>& pair_ids) {
  impl_->RunWrite([&] {
    SqliteStatement remove(
        impl_->connection,
        "DELETE FROM dgsfm_pair_geometries WHERE pair_id = ?");
    for (const colmap::image_pair_t pair_id : pair_ids) {
      remove.BindInt(1, static_cast<int64_t>(pair_id)).Run();
    }
  });
}

void DepthDatabase::DeleteAllPairGeometries() {
  impl_->RunWrite(
      [&] { impl_->connection.Execute("DELETE FROM dgsfm_pair_geometries"); });
}

void DepthDatabase::WritePairStatuses(
    const std::map<colmap::image_pair_t, PairStatus>& statuses) {
  impl_->RunWrite([&] {
    CreatePairStatusTable(impl_->connection);
    impl_->connection.Execute("DELETE FROM dgsfm_pair_statuses");
    SqliteStatement insert(impl_->connection,
                           "INSERT INTO dgsfm_pair_statuses(pair_id, status, "
                           "name) VALUES (?, ?, ?)");
    for (const auto& [pair_id, status] : statuses) {
      insert.BindInt(1, static_cast<int64_t>(pair_id))
          .BindInt(2, static_cast<int>(status))
          .BindText(3, PairStatusName(status))
          .Run();
    }
  });
}

std::map<colmap::image_pair_t, PairStatus> DepthDatabase::ReadPairStatuses()
    const {
  std::map<colmap::image_pair_t, PairStatus> statuses;
  if (!impl_->connection.HasTable("dgsfm_pair_statuses")) return statuses;
  SqliteStatement select(
      impl_->connection,
      "SELECT pair_id, status FROM dgsfm_pair_statuses ORDER BY pair_id");
  while (select.Step()) {
    statuses.emplace_hint(statuses.end(),
                          static_cast<colmap::image_pair_t>(select.Int(0)),
                          static_cast<PairStatus>(select.Int(1)));
  }
  return statuses;
}

void DepthDatabase::WriteIsDisplayed(colmap::image_t image_id,
                                     bool is_displayed) {
  impl_->RunWrite([&] {
    CreateDisplayedImageTable(impl_->connection);
    SqliteStatement(
        impl_->connection,
        is_displayed ? "INSERT OR IGNORE INTO dgsfm_displayed_images VALUES (?)"
                     : "DELETE FROM dgsfm_displayed_images WHERE image_id = ?")
        .BindInt(1, image_id)
        .Run();
  });
}

std::set<colmap::image_t> DepthDatabase::ReadDisplayedImages() const {
  std::set<colmap::image_t> image_ids;
  if (!impl_->connection.HasTable("dgsfm_displayed_images")) return image_ids;
  SqliteStatement select(impl_->connection,
                         "SELECT image_id FROM dgsfm_displayed_images");
  while (select.Step()) {
    image_ids.insert(static_cast<colmap::image_t>(select.Int(0)));
  }
  return image_ids;
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
