#include "colmap_ext/database/depth_database.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/colmap_schema.h"
#include "colmap_ext/database/depth_schema.h"
#include "colmap_ext/database/keypoint_depth_table.h"
#include "colmap_ext/database/keypoint_selection.h"
#include "colmap_ext/database/pair_geometry_table.h"

#include <algorithm>
#include <optional>
#include <stdexcept>

namespace dgsfm {
namespace {

SqliteConnection::Mode ConnectionMode(DepthDatabase::Mode mode) {
  switch (mode) {
    case DepthDatabase::Mode::READ_ONLY:
      return SqliteConnection::Mode::READ_ONLY;
    case DepthDatabase::Mode::UNCHANGING:
      return SqliteConnection::Mode::UNCHANGING;
    case DepthDatabase::Mode::READ_WRITE:
      break;
  }
  return SqliteConnection::Mode::READ_WRITE;
}

}  // namespace

DepthDatabase::DepthDatabase(const std::string& path,
                             Mode mode,
                             std::chrono::milliseconds busy_timeout)
    : connection_(path, ConnectionMode(mode), busy_timeout), mode_(mode) {
  CheckIsColmapDatabase(connection_);
  // Readers leave old tables alone; they may not be allowed to write.
  if (mode == Mode::READ_WRITE) UpdateDepthTables(connection_);
  HasDepthTables(connection_);  // Refuses other versions.
}

template <typename Write>
void DepthDatabase::RunWrite(const Write& write) {
  DGSFM_CHECK(mode_ == Mode::READ_WRITE) << connection_.Path();
  SqliteTransaction transaction(connection_, SqliteTransaction::Kind::WRITE);
  if (!HasDepthTables(connection_)) CreateDepthTables(connection_);
  write();
  transaction.Commit();
}

void DepthDatabase::WriteSamples(colmap::image_t image_id,
                                 const KeypointDepths& keypoint_depths) {
  const ImageKeypoints image = ReadImageKeypoints(connection_, image_id);
  DGSFM_CHECK(int64_t(keypoint_depths.depths.size()) == image.num_keypoints)
      << keypoint_depths.depths.size() << " depths for " << image.num_keypoints
      << " key points of " << image.name;
  SqliteStatement(connection_,
                  "INSERT OR REPLACE INTO dgsfm_keypoint_depths(image_id, "
                  "unit, rows, data, focal_length, keypoints_fingerprint, "
                  "source_fingerprint) VALUES (?, ?, ?, ?, ?, ?, ?)",
                  image_id,
                  keypoint_depths.unit,
                  keypoint_depths.depths.size(),
                  keypoint_depths.depths,
                  keypoint_depths.focal_length_px,
                  image.keypoints_fingerprint,
                  keypoint_depths.source_fingerprint)
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
  CheckKeypointDepths(keypoint_depths);
  RunWrite([&] {
    WriteSamples(image_id, keypoint_depths);
    SqliteStatement(connection_,
                    "INSERT OR REPLACE INTO dgsfm_depth_maps(image_id, width, "
                    "height, unit, data) VALUES (?, ?, ?, ?, ?)",
                    image_id,
                    depth_map.width,
                    depth_map.height,
                    depth_map.unit,
                    depth_map.bytes)
        .Run();
  });
}

void DepthDatabase::WriteKeypointDepths(colmap::image_t image_id,
                                        const KeypointDepths& keypoint_depths) {
  CheckKeypointDepths(keypoint_depths);
  RunWrite([&] {
    WriteSamples(image_id, keypoint_depths);
    SqliteStatement(connection_,
                    "DELETE FROM dgsfm_depth_maps WHERE image_id = ?",
                    image_id)
        .Run();
  });
}

bool DepthDatabase::HasDepthMap(colmap::image_t image_id) const {
  return HasDepthTables(connection_) &&
         SqliteStatement(connection_,
                         "SELECT 1 FROM dgsfm_depth_maps WHERE image_id = ?",
                         image_id)
             .Step();
}

DepthMap DepthDatabase::ReadDepthMap(colmap::image_t image_id) const {
  const std::string name = ReadImageKeypoints(connection_, image_id).name;
  if (!HasDepthMap(image_id)) {
    throw connection_.Error() << "image " << name << " has no depth map";
  }
  SqliteStatement select(connection_,
                         "SELECT width, height, unit, data "
                         "FROM dgsfm_depth_maps WHERE image_id = ?",
                         image_id);
  select.Step();
  const int64_t width = select.Int(0);
  const int64_t height = select.Int(1);
  // Checked as 64 bits, before the sizes become integers of 32.
  if (std::max(width, height) > kMaxDepthMapSize) {
    throw connection_.Error()
        << "image " << name << ": depth map of " << width << " x " << height;
  }
  const DepthUnit unit = CheckedUnit(connection_, select.Int(2), name);
  try {
    return DecompressDepth({static_cast<int>(width),
                            static_cast<int>(height),
                            unit,
                            select.Blob<uint8_t>(3)});
  } catch (const std::runtime_error& error) {
    throw connection_.Error() << "depth map of image " << name << ": "
                              << error.what() << "; run depth_importer again";
  }
}

std::map<colmap::image_t, KeypointDepths> DepthDatabase::ReadAllKeypointDepths(
    const KeptKeypoints& kept,
    const std::function<bool(colmap::image_t)>& selects) const {
  std::map<colmap::image_t, KeypointDepths> all_depths;
  if (!HasDepthTables(connection_)) return all_depths;
  SqliteStatement select(connection_, kSelectKeypointDepths);
  while (select.Step()) {
    const auto image_id = static_cast<colmap::image_t>(select.Int(0));
    if (selects && !selects(image_id)) continue;
    KeypointDepths depths = KeypointDepthsOfRow(connection_, select);
    depths.depths = RestrictToKept(kept, image_id, std::move(depths.depths));
    all_depths.emplace(image_id, std::move(depths));
  }
  return all_depths;
}

std::optional<KeypointDepths> DepthDatabase::ReadKeypointDepths(
    colmap::image_t image_id) const {
  if (!HasDepthTables(connection_)) return std::nullopt;
  SqliteStatement select(
      connection_,
      std::string(kSelectKeypointDepths) + " WHERE images.image_id = ?",
      image_id);
  if (!select.Step()) return std::nullopt;
  return KeypointDepthsOfRow(connection_, select);
}

std::map<colmap::image_t, uint64_t> DepthDatabase::ReadSourceFingerprints()
    const {
  std::map<colmap::image_t, uint64_t> fingerprints;
  if (!HasDepthTables(connection_)) return fingerprints;
  SqliteStatement select(
      connection_,
      "SELECT images.image_id, source_fingerprint, keypoints_fingerprint, "
      "keypoints.data FROM dgsfm_keypoint_depths "
      "JOIN images USING (image_id) LEFT JOIN keypoints USING (image_id)");
  while (select.Step()) {
    const auto [image_id, source, keypoints] =
        select.Columns<colmap::image_t, uint64_t, uint64_t>();
    if (keypoints == KeypointsFingerprint(select, 3)) {
      fingerprints.emplace(image_id, source);
    }
  }
  return fingerprints;
}

void DepthDatabase::WritePairGeometries(
    const std::map<colmap::image_pair_t, PairGeometry>& geometries) {
  // All are checked before the first is written.
  for (const auto& [pair_id, geometry] : geometries) {
    CheckPairGeometry(geometry);
  }
  RunWrite([&] {
    PairGeometryInserter inserter(connection_);
    for (const auto& [pair_id, geometry] : geometries) {
      inserter.Insert(pair_id, geometry);
    }
  });
}

std::map<colmap::image_pair_t, PairGeometry> DepthDatabase::ReadPairGeometries(
    const KeptKeypoints& kept,
    const std::function<bool(colmap::image_pair_t)>& selects) const {
  std::map<colmap::image_pair_t, PairGeometry> geometries;
  if (!HasPairTable(connection_)) return geometries;
  PairGeometryCursor cursor(connection_);
  while (cursor.Step()) {
    if (selects && !selects(cursor.PairId())) continue;
    PairGeometry geometry = cursor.Geometry();
    if (!kept.empty()) RestrictInliers(kept, cursor.PairId(), &geometry);
    geometries.emplace_hint(
        geometries.end(), cursor.PairId(), std::move(geometry));
  }
  return geometries;
}

std::map<colmap::image_pair_t, uint64_t> DepthDatabase::ReadPairFingerprints()
    const {
  if (!HasPairTable(connection_)) return {};
  return SelectMap<colmap::image_pair_t, uint64_t>(
      connection_,
      "SELECT pair_id, fingerprint FROM dgsfm_pair_geometries "
      "ORDER BY pair_id");
}

std::map<colmap::image_pair_t, size_t> DepthDatabase::ReadValidPairs() const {
  if (!HasPairTable(connection_)) return {};
  return SelectMap<colmap::image_pair_t, size_t>(
      connection_,
      "SELECT pair_id, rows FROM dgsfm_pair_geometries WHERE status = 0 "
      "ORDER BY pair_id");
}

PairTotals DepthDatabase::ReadPairTotals() const {
  PairTotals totals;
  if (!HasPairTable(connection_)) return totals;
  SqliteStatement select(connection_,
                         "SELECT status, degeneracies, count(*) "
                         "FROM dgsfm_pair_geometries GROUP BY 1, 2");
  while (select.Step()) {
    const auto [status, degeneracies, count] =
        select.Columns<PairStatus, uint32_t, size_t>();
    totals.Add(status, degeneracies, count);
  }
  return totals;
}

void DepthDatabase::DeletePairGeometries(
    const std::vector<colmap::image_pair_t>& pair_ids) {
  RunWrite([&] {
    SqliteStatement remove(
        connection_, "DELETE FROM dgsfm_pair_geometries WHERE pair_id = ?");
    for (const colmap::image_pair_t pair_id : pair_ids) {
      remove.Bind(pair_id).Run();
    }
  });
}

void DepthDatabase::DeleteAllPairGeometries() {
  RunWrite([&] { connection_.Execute("DELETE FROM dgsfm_pair_geometries"); });
}

void DepthDatabase::WritePairStatuses(
    const std::map<colmap::image_pair_t, PairStatus>& statuses) {
  RunWrite([&] {
    // Databases that no mapper has written to lack the table.
    CreatePairStatusTable(connection_);
    connection_.Execute("DELETE FROM dgsfm_pair_statuses");
    SqliteStatement insert(connection_,
                           "INSERT INTO dgsfm_pair_statuses(pair_id, status, "
                           "name) VALUES (?, ?, ?)");
    for (const auto& [pair_id, status] : statuses) {
      insert.Bind(pair_id, status, PairStatusName(status)).Run();
    }
  });
}

std::map<colmap::image_pair_t, PairStatus> DepthDatabase::ReadPairStatuses()
    const {
  if (!connection_.HasTable("dgsfm_pair_statuses")) return {};
  return SelectMap<colmap::image_pair_t, PairStatus>(
      connection_,
      "SELECT pair_id, status FROM dgsfm_pair_statuses ORDER BY pair_id");
}

void DepthDatabase::WriteIsDisplayed(colmap::image_t image_id,
                                     bool is_displayed) {
  RunWrite([&] {
    CreateDisplayedImageTable(connection_);
    SqliteStatement(
        connection_,
        is_displayed ? "INSERT OR IGNORE INTO dgsfm_displayed_images VALUES (?)"
                     : "DELETE FROM dgsfm_displayed_images WHERE image_id = ?",
        image_id)
        .Run();
  });
}

std::set<colmap::image_t> DepthDatabase::ReadDisplayedImages() const {
  std::set<colmap::image_t> image_ids;
  if (!connection_.HasTable("dgsfm_displayed_images")) return image_ids;
  SqliteStatement select(connection_,
                         "SELECT image_id FROM dgsfm_displayed_images");
  while (select.Step()) {
    image_ids.insert(static_cast<colmap::image_t>(select.Int(0)));
  }
  return image_ids;
}

void DepthDatabase::BeginTransaction() {
  DGSFM_CHECK(mode_ == Mode::READ_WRITE) << connection_.Path();
  // An inner commit would otherwise end the outer transaction.
  DGSFM_CHECK(!transaction_) << "transactions do not nest";
  transaction_.emplace(connection_, SqliteTransaction::Kind::WRITE);
}

void DepthDatabase::CommitTransaction() {
  DGSFM_CHECK(transaction_.has_value()) << "no transaction to commit";
  transaction_->Commit();
  transaction_.reset();
}

}  // namespace dgsfm
