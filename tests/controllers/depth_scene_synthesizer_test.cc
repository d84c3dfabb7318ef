#include "controllers/depth_scene_synthesizer.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/file_size_limit.h"
#include "tests/testing/test_dir.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>
#include <colmap/util/bitmap.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

std::string FileBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(SynthesizeDepthScene, RendersImagesDepthAndTruth) {
  DepthSceneSynthesizerOptions options;
  options.scene.num_images = 3;
  options.scene.camera.width_px = 120;
  options.scene.camera.height_px = 90;
  options.scene.camera.focal_length_px = 100;
  options.scene.depth_noise.log_scale_stddev = 0.2;
  const std::string dir = CreateTestDir();
  for (const char* name : {"/a", "/b"}) {
    options.output_path = dir + name;
    SynthesizeDepthScene(options);
  }
  const std::string path = dir + "/a";
  colmap::Reconstruction model;
  model.Read(path + "/gt");
  ASSERT_EQ(model.NumRegImages(), 3);
  EXPECT_GT(model.NumPoints3D(), 20);
  for (const colmap::image_t image_id : model.RegImageIds()) {
    const colmap::Image& image = model.Image(image_id);
    colmap::Bitmap bitmap;
    ASSERT_TRUE(bitmap.Read(path + "/images/" + image.Name()));
    EXPECT_EQ(bitmap.Width(), 120);
    EXPECT_EQ(bitmap.Height(), 90);
    const std::string depth_path = "/depth/" + image.Name() + ".npy";
    const DepthMap depth_map = ReadDepthMap(
        path + depth_path, model.Camera(image.CameraId()), DepthReadOptions());
    EXPECT_GT(depth_map.Coverage(), 0.4);
    EXPECT_LT(depth_map.Coverage(), 1);  // the sky
    for (const std::string& file : {"/images/" + image.Name(),
                                    depth_path,
                                    std::string("/gt/points3D.bin")}) {
      EXPECT_EQ(FileBytes(dir + "/a" + file), FileBytes(dir + "/b" + file));
    }
  }
}

TEST(SynthesizeDepthScene, NamesTheFileThatDoesNotFit) {
  DepthSceneSynthesizerOptions options;
  options.database_only = true;
  options.scene.num_images = 10;
  options.output_path = CreateTestDir();
  const FileSizeLimit limit(20000);
  ExpectError([&] { SynthesizeDepthScene(options); },
              options.output_path + "/database.db");
}

TEST(SynthesizeDepthScene, RefusesNumbersBeyondReason) {
  DepthSceneSynthesizerOptions options;
  options.scene.num_images = 1000000000;
  options.output_path = CreateTestDir();
  ExpectError([&] { SynthesizeDepthScene(options); }, "num_images");
  options.scene.num_images = 1;
  options.scene.camera.width_px = 2000000000;
  ExpectError([&] { SynthesizeDepthScene(options); }, "image size");
  options.scene.camera = {};
  options.scene.camera.focal_length_px = 1e-320;
  ExpectError([&] { SynthesizeDepthScene(options); }, "focal_length_px");
}

TEST(SynthesizeDepthScene, DatabaseHoldsObservationsAndDepth) {
  DepthSceneSynthesizerOptions options;
  options.database_only = true;
  options.scene.num_images = 10;
  options.scene.no_depth_ratio = 0.2;
  options.output_path = CreateTestDir();
  SynthesizeDepthScene(options);
  const std::string path = options.output_path + "/database.db";
  const Scene scene = ReadScene(path);
  EXPECT_EQ(scene.images.size(), 10);
  const auto depths = DepthDatabase(path, DepthDatabase::Mode::READ_ONLY)
                          .ReadAllKeypointDepths();
  EXPECT_EQ(depths.size(), 8);
  colmap::Reconstruction model;
  model.Read(options.output_path + "/gt");
  for (const auto& [image_id, image_depths] : depths) {
    ASSERT_EQ(image_depths.depths.size(),
              scene.images.at(image_id).NumPoints2D());
  }
  EXPECT_EQ(model.NumRegImages(), 10);
}

TEST(SynthesizeDepthScene, RefusesToRenderFamiliesOfPoints) {
  DepthSceneSynthesizerOptions options;
  options.scene.family = SceneFamily::INTERNET;
  options.output_path = CreateTestDir();
  try {
    SynthesizeDepthScene(options);
    FAIL() << "rendered";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("internet"), std::string::npos);
  }
}

TEST(RunDepthSceneSynthesizer, NamesSetDefaultsOfOptions) {
  const std::string dir = CreateTestDir();
  const auto run = [&](const std::string& name, std::vector<std::string> args) {
    args.insert(args.end(),
                {"--database_only",
                 "1",
                 "--num_images",
                 "10",
                 "--num_points_per_image",
                 "50",
                 "--output_path",
                 dir + "/" + name});
    EXPECT_EQ(RunForTest(RunDepthSceneSynthesizer, args).code, 0);
    return ReadScene(dir + "/" + name + "/database.db");
  };
  // The family gives every image its camera, unless an option says otherwise,
  // before or after it.
  EXPECT_EQ(run("internet", {"--family", "internet"}).cameras.size(), 10);
  EXPECT_EQ(
      run("one", {"--num_cameras", "1", "--family", "internet"}).cameras.size(),
      1);
  const auto depths = [&](const std::string& name) {
    return DepthDatabase(dir + "/" + name + "/database.db",
                         DepthDatabase::Mode::READ_ONLY)
        .ReadAllKeypointDepths()
        .at(1)
        .depths;
  };
  run("exact", {"--depth_model", "exact"});
  run("drift", {"--depth_model", "drift"});
  run("drift0", {"--depth_model", "drift", "--depth_scale_drift", "0"});
  EXPECT_NE(depths("exact"), depths("drift"));
  EXPECT_EQ(depths("exact"), depths("drift0"));
}

TEST(SynthesizeDepthScene, RefusesWrongOptionsAndFilledFolders) {
  DepthSceneSynthesizerOptions options;
  options.database_only = true;
  options.output_path = CreateTestDir();
  options.scene.num_images = 0;
  EXPECT_THROW(SynthesizeDepthScene(options), std::runtime_error);
  options.scene.num_images = 5;
  std::ofstream(options.output_path + "/precious.txt") << "data";
  EXPECT_THROW(SynthesizeDepthScene(options), std::runtime_error);
  options.output_path += "/precious.txt";
  EXPECT_THROW(SynthesizeDepthScene(options), std::runtime_error);
  EXPECT_EQ(FileBytes(options.output_path), "data");
}

}  // namespace
}  // namespace dgsfm
