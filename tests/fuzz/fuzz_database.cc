// Puts arbitrary bytes and numbers into our tables and COLMAP's and reads all
// of them: all the readers may do is throw std::runtime_error.

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "tests/testing/colmap_database.h"

#include <cstring>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <unistd.h>

namespace dgsfm {
namespace {

// Statements with a blob and a number.
const char* const kUpdates[] = {
    "UPDATE dgsfm_depth_maps SET data = ?1, width = ?2",
    "UPDATE dgsfm_keypoint_depths SET data = ?1, rows = ?2, "
    "keypoints_fingerprint = 0",
    "UPDATE dgsfm_pair_geometries SET matches = ?1, rows = ?2",
    "UPDATE dgsfm_pair_geometries SET qvec = ?1, status = ?2",
    "UPDATE dgsfm_pair_geometries SET tvec = ?1, degeneracies = ?2",
    "UPDATE dgsfm_pair_geometries SET log_scale_stddev = ?1, has_scale = ?2",
    "UPDATE dgsfm_pair_geometries SET depth_verified = ?1, num_matches = ?2",
    "UPDATE dgsfm_pair_geometries SET matches = matches || ?1, pair_id = ?2",
    "UPDATE keypoints SET data = ?1, rows = ?2",
    "UPDATE keypoints SET data = ?1, cols = ?2",
    "UPDATE matches SET data = ?1, rows = ?2",
    "UPDATE matches SET data = ?1, pair_id = ?2",
    "UPDATE cameras SET params = ?1, model = ?2",
    "UPDATE cameras SET params = ?1, width = ?2"};

std::string CreateDatabase() {
  const std::string path =
      "/dev/shm/dgsfm_fuzz_" + std::to_string(getpid()) + ".db";
  std::filesystem::remove(path);
  {
    ColmapDatabaseWriter writer(path, ColmapSchema::V4_2);
    writer.AddCamera(0, 64, 48, {50, 32, 24});
    writer.AddImage("a.jpg", 1, {{1, 2}, {3, 4}, {5, 6}});
    writer.AddImage("b.jpg", 1, {{7, 8}, {9, 10}});
    writer.AddMatches(1, 2, {{0, 1}, {2, 0}});
  }
  DepthDatabase database(path, DepthDatabase::Mode::READ_WRITE);
  const DepthMap map = {2, 1, DepthUnit::METRIC, {1, 2}};
  database.WriteDepthMap(1, map, {DepthUnit::METRIC, {1, 2, 3}});
  PairGeometry geometry;
  geometry.num_matches = 2;
  geometry.inlier_matches = {{0, 1}, {2, 0}};
  geometry.depth_verified = {0, 1};
  database.WritePairGeometries({{PairIdOfImages(1, 2), geometry}});
  return path;
}

template <typename Read>
void Try(const Read& read) {
  try {
    read();
  } catch (const std::runtime_error&) {
  }
}

void ReadAll(const std::string& path) {
  Try([&] { ReadScene(path); });
  Try([&] {
    const DepthDatabase database(path, DepthDatabase::Mode::READ_ONLY);
    Try([&] { database.ReadDepthMap(1); });
    Try([&] { database.ReadAllKeypointDepths(); });
    Try([&] { database.ReadSourceFingerprints(); });
    Try([&] { database.ReadPairGeometries(); });
    Try([&] { database.ReadPairTotals(); });
  });
}

}  // namespace
}  // namespace dgsfm

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace dgsfm;
  static const std::string original = CreateDatabase();
  static const std::string path = original + "2";
  if (size < 9) return 0;
  std::filesystem::remove(path + "-wal");
  std::filesystem::copy_file(
      original, path, std::filesystem::copy_options::overwrite_existing);
  int64_t number = 0;
  std::memcpy(&number, data + 1, sizeof(number));
  {
    const SqliteConnection connection(path, SqliteConnection::Mode::READ_WRITE);
    connection.Execute("PRAGMA synchronous = OFF");
    const size_t idx = data[0] % (sizeof(kUpdates) / sizeof(kUpdates[0]));
    SqliteStatement update(connection, kUpdates[idx]);
    const std::vector<uint8_t> blob(data + 9, data + size);
    Try([&] { update.Bind(blob, number).Run(); });
  }
  ReadAll(path);
  return 0;
}
