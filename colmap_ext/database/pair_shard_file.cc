#include "colmap_ext/database/pair_shard_file.h"

#include "colmap_ext/database/depth_schema.h"
#include "colmap_ext/database/pair_geometry_table.h"
#include "colmap_ext/fnv_hash.h"
#include "colmap_ext/output_file.h"

#include <filesystem>

#include <unistd.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr int64_t kFormat = 1;

constexpr char kCreateHeader[] = R"(
CREATE TABLE dgsfm_pair_shard (
  format         INTEGER NOT NULL,
  shard_index    INTEGER NOT NULL,
  num_shards     INTEGER NOT NULL,
  method_version INTEGER NOT NULL,
  options        TEXT NOT NULL,
  content_hash   INTEGER NOT NULL);
)";

// Adds all that is stored of a pair.
void AddPair(colmap::image_pair_t pair_id,
             const PairGeometry& pair,
             FnvHash* hash) {
  hash->Add(pair_id);
  hash->Add(static_cast<int>(pair.status));
  const Eigen::Vector4d qvec = QvecFromRotation(pair.cam2_from_cam1.rotation);
  for (int i = 0; i < 4; ++i) hash->Add(qvec[i]);
  for (int i = 0; i < 3; ++i) hash->Add(pair.cam2_from_cam1.translation[i]);
  hash->Add(pair.has_scale);
  hash->Add(pair.scale_1_from_2);
  hash->Add(pair.focal_length1_px);
  hash->Add(pair.focal_length2_px);
  hash->Add(pair.estimated_focal1);
  hash->Add(pair.estimated_focal2);
  hash->Add(pair.degeneracies);
  hash->Add(pair.log_scale_stddev);
  hash->Add(pair.num_matches);
  hash->Add(pair.inlier_matches.size());
  for (const colmap::FeatureMatch& match : pair.inlier_matches) {
    hash->Add(match.point2D_idx1);
    hash->Add(match.point2D_idx2);
  }
  hash->AddAll(pair.depth_verified);
  hash->Add(pair.fingerprint);
}

// A name that no other process uses, on no other machine either.
std::string PartialPath(const std::string& path) {
  char host[256] = {};
  gethostname(host, sizeof(host) - 1);
  return path + "." + host + "." + std::to_string(getpid()) + ".partial";
}

// Removes a file that did not get its place.
class PartialFile {
 public:
  explicit PartialFile(const std::string& path) : path_(path) { Remove(); }
  ~PartialFile() { Remove(); }
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;

 private:
  void Remove() {
    std::error_code error;
    fs::remove(path_, error);
  }

  const std::string path_;
};

void WriteRows(const SqliteConnection& connection,
               const PairShardHeader& header,
               const std::map<colmap::image_pair_t, PairGeometry>& geometries) {
  // A file that is incomplete never gets its name.
  connection.Execute(
      "PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;"
      "PRAGMA locking_mode = EXCLUSIVE");
  SqliteTransaction transaction(connection, SqliteTransaction::Kind::WRITE);
  connection.Execute(kCreateHeader);
  CreatePairTable(connection);
  FnvHash hash;
  PairGeometryInserter inserter(connection);
  for (const auto& [pair_id, geometry] : geometries) {
    CheckPairGeometry(geometry);
    AddPair(pair_id, geometry, &hash);
    inserter.Insert(pair_id, geometry);
  }
  SqliteStatement(connection,
                  "INSERT INTO dgsfm_pair_shard VALUES (?, ?, ?, ?, ?, ?)",
                  kFormat,
                  header.shard_index,
                  header.num_shards,
                  header.method_version,
                  header.options_text,
                  hash.Value())
      .Run();
  transaction.Commit();
}

}  // namespace

// A database given by mistake would be lost. An empty file is what mktemp
// makes.
void CheckPairShardPath(const std::string& path) {
  const fs::path folder = fs::absolute(path).parent_path();
  if (!fs::is_directory(folder)) {
    throw std::runtime_error("cannot write " + path + ": no folder " +
                             folder.string());
  }
  if (fs::exists(path) && !(fs::is_regular_file(path) && fs::is_empty(path))) {
    const PairShardFile earlier(path);
  }
}

void WritePairShard(
    const std::string& path,
    const PairShardHeader& header,
    const std::map<colmap::image_pair_t, PairGeometry>& geometries) {
  CheckPairShardPath(path);
  const std::string partial_path = PartialPath(path);
  const PartialFile partial(partial_path);
  WriteRows(
      SqliteConnection(partial_path, SqliteConnection::Mode::CREATE_ALONE),
      header,
      geometries);
  ReplaceFile(partial_path, path);
}

PairShardFile::PairShardFile(const std::string& path)
    : connection_(path, SqliteConnection::Mode::UNCHANGING) {
  if (!connection_.HasTable("dgsfm_pair_shard")) {
    throw connection_.Error()
        << "is no result of depth_geometric_verifier --output_path";
  }
  SqliteStatement select(connection_, "SELECT * FROM dgsfm_pair_shard");
  if (!select.Step()) Fail("has no header");
  if (select.Int(0) != kFormat) {
    throw connection_.Error()
        << "has format " << select.Int(0) << ", this program reads " << kFormat
        << "; use one version of the program for all shards";
  }
  const auto [format, index, num_shards, method] =
      select.Columns<int64_t, int, int, uint32_t>();
  header_ = {index, num_shards, method, select.Text(4)};
  content_hash_ = static_cast<uint64_t>(select.Int(5));
  if (num_shards < 1 || num_shards > kMaxNumPairShards || index < 0 ||
      index >= num_shards) {
    Fail("has a damaged header");
  }
}

void PairShardFile::Fail(const std::string& problem) const {
  throw connection_.Error()
      << problem << "; delete the file and verify the shard again";
}

std::map<colmap::image_pair_t, uint64_t> PairShardFile::ReadFingerprints()
    const {
  return SelectMap<colmap::image_pair_t, uint64_t>(
      connection_,
      "SELECT pair_id, fingerprint FROM dgsfm_pair_geometries "
      "ORDER BY pair_id");
}

void PairShardFile::ForEach(
    const std::function<void(colmap::image_pair_t, const PairGeometry&)>&
        function) const {
  SqliteStatement select(connection_,
                         std::string("SELECT ") + kPairGeometryColumns +
                             " FROM dgsfm_pair_geometries ORDER BY pair_id");
  FnvHash hash;
  while (select.Step()) {
    const auto pair_id = static_cast<colmap::image_pair_t>(select.Int(0));
    const PairGeometry geometry =
        GeometryOfRow(select, [&](const std::string& problem) {
          Fail("pair " + std::to_string(pair_id) + ": " + problem);
        });
    AddPair(pair_id, geometry, &hash);
    function(pair_id, geometry);
  }
  if (hash.Value() != content_hash_) Fail("is damaged");
}

}  // namespace dgsfm
