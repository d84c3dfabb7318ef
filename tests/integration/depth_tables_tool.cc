// Helper of pycolmap_compat.py:
//   depth_tables_tool create DB   writes a small database with COLMAP 3.8
//   depth_tables_tool extend DB   adds depth and pair geometries to a database
//   depth_tables_tool check DB    fails unless they are all there

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"

#include <colmap/base/database.h>

#include <iostream>
#include <stdexcept>
#include <string>

namespace dgsfm {
namespace {

void Create(const std::string& path) {
  colmap::Database database(path);
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_RADIAL", 500, 640, 480);
  database.WriteCamera(camera);
  for (int i = 1; i <= 3; ++i) {
    colmap::Image image;
    image.SetName("image" + std::to_string(i) + ".jpg");
    image.SetCameraId(1);
    const colmap::image_t image_id = database.WriteImage(image);
    colmap::FeatureKeypoints keypoints;
    for (int j = 0; j < 10; ++j) {
      keypoints.emplace_back(10.5f * i + j, 20.25f + j);
    }
    database.WriteKeypoints(image_id, keypoints);
  }
  for (const auto& [id1, id2] : {std::make_pair(1, 2), std::make_pair(2, 3)}) {
    colmap::TwoViewGeometry geometry;
    geometry.config = colmap::TwoViewGeometry::CALIBRATED;
    geometry.inlier_matches = {{0, 1}, {2, 3}};
    database.WriteMatches(id1, id2, {{0, 1}, {2, 3}, {4, 4}});
    database.WriteTwoViewGeometry(id1, id2, geometry);
  }
}

void Extend(const std::string& path) {
  const Scene scene = ReadScene(path);
  DepthDatabase database(path, DepthDatabase::Mode::READ_WRITE);
  for (const auto& [image_id, image] : scene.images) {
    const DepthMap depth_map = {
        8, 6, DepthUnit::METRIC, std::vector<float>(8 * 6, 2.5f)};
    database.WriteDepthMap(
        image_id,
        depth_map,
        {DepthUnit::METRIC, std::vector<float>(image.NumPoints2D(), 2.5f)});
  }
  std::map<colmap::image_pair_t, PairGeometry> geometries;
  for (const auto& [pair_id, matches] : scene.matches) {
    PairGeometry& geometry = geometries[pair_id];
    geometry.status = PairStatus::VALID;
    geometry.num_matches = matches.size();
    geometry.inlier_matches = matches;
    geometry.depth_verified.assign(matches.size(), 1);
  }
  database.WritePairGeometries(geometries);
}

void Check(const std::string& path) {
  const Scene scene = ReadScene(path);
  const DepthDatabase database(path, DepthDatabase::Mode::READ_ONLY);
  if (database.ReadAllKeypointDepths().size() != scene.images.size() ||
      database.ReadPairGeometries().size() != scene.matches.size()) {
    throw std::runtime_error(path + ": depth tables are not complete");
  }
}

int Run(const std::string& command, const std::string& path) {
  try {
    if (command == "create") Create(path);
    if (command == "extend") Extend(path);
    if (command == "check") Check(path);
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << std::endl;
    return 1;
  }
}

}  // namespace
}  // namespace dgsfm

int main(int argc, char** argv) {
  return argc == 3 ? dgsfm::Run(argv[1], argv[2]) : 2;
}
