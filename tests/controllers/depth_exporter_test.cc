#include "controllers/depth_exporter.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/sqlite.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/model/model_io.h"
#include "controllers/commands/commands.h"
#include "tests/controllers/run_command.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/test_dir.h"

#include <colmap/base/reconstruction.h>
#include <colmap/util/bitmap.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kNumPoints = 40;

// Image sub/a.jpg sees points of depths 2 to 6 which its map has too small by a
// factor of 4; b.jpg sees three points; c.jpg is not in the model; d.jpg has no
// map.
class DepthExporterTest : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = CreateTestDir();
    database_path_ = dir_ + "/database.db";
    {
      ColmapDatabaseWriter writer(database_path_, ColmapSchema::V4_2);
      writer.AddCamera(1, 640, 480, {500, 500, 320, 240});
      for (const char* name : {"sub/a.jpg", "b.jpg", "c.jpg", "d.jpg"}) {
        writer.AddImage(name, 1, {{320, 240}});
      }
    }
    DepthDatabase database(database_path_, DepthDatabase::Mode::READ_WRITE);
    for (const colmap::image_t image_id : {1, 2, 3}) {
      database.WriteDepthMap(
          image_id, CreateMap(), {DepthUnit::METRIC, {0.5f}});
    }
    WriteModel();
  }

  // Columns of depth 0.5 to 1.5, the last row unknown.
  static DepthMap CreateMap() {
    DepthMap map = {64, 48, DepthUnit::METRIC, {}};
    for (int y = 0; y < 48; ++y) {
      for (int x = 0; x < 64; ++x) {
        map.values.push_back(y == 47 ? 0 : 0.5f + x / 64.0f);
      }
    }
    return map;
  }

  // The camera may be of another size; key points are not.
  void WriteModel(const std::string& folder = "model",
                  double focal_length = 500,
                  int width = 640,
                  int height = 480) const {
    colmap::Reconstruction model;
    colmap::Camera camera;
    camera.SetCameraId(1);
    camera.InitializeWithName("SIMPLE_PINHOLE", focal_length, width, height);
    model.AddCamera(camera);
    for (const colmap::image_t image_id : {1, 2}) {
      colmap::Image image;
      image.SetImageId(image_id);
      image.SetCameraId(1);
      image.SetName(image_id == 1 ? "sub/a.jpg" : "b.jpg");
      image.SetQvec(Eigen::Vector4d(1, 0, 0, 0));
      image.SetTvec(Eigen::Vector3d(0, 0, 0));
      std::vector<Eigen::Vector2d> points2D;
      for (int i = 0; i < kNumPoints; ++i) {
        // At the centres of columns of the map.
        points2D.emplace_back(10 * (i + 10) + 5, 11 * i + 10);
      }
      image.SetPoints2D(points2D);
      model.AddImage(image);
      model.RegisterImage(image_id);
    }
    for (int i = 0; i < kNumPoints; ++i) {
      const Eigen::Vector2d xy = model.Image(1).Point2D(i).XY();
      const double depth = 4 * (0.5 + (i + 10) / 64.0);
      colmap::Track track;
      track.AddElement(1, i);
      if (i < 3) track.AddElement(2, i);
      model.AddPoint3D(
          depth *
              Eigen::Vector3d((xy.x() - 320) / 500, (xy.y() - 240) / 500, 1),
          track);
    }
    fs::create_directories(dir_ + "/" + folder);
    model.Write(dir_ + "/" + folder);
  }

  DepthMap ReadExported(const std::string& name) const {
    colmap::Camera camera;
    camera.InitializeWithName("SIMPLE_PINHOLE", 500, 640, 480);
    return ReadDepthMap(dir_ + "/out/" + name, camera, {});
  }

  std::string dir_;
  std::string database_path_;
};

TEST_F(DepthExporterTest, GivesRawMapsBack) {
  for (const auto& [format, name] :
       std::vector<std::pair<DepthExportFormat, std::string>>{
           {DepthExportFormat::NPY, "sub/a.jpg.npy"},
           {DepthExportFormat::EXR, "sub/a.jpg.exr"},
           {DepthExportFormat::DENSE_BIN, "sub/a.jpg.geometric.bin"}}) {
    DepthExportOptions options;
    options.format = format;
    const DepthExportSummary summary =
        ExportDepthMaps(database_path_, std::nullopt, dir_ + "/out", options);
    EXPECT_EQ(summary.exported.size(), 3);
    EXPECT_THAT(summary.images_without_map, ElementsAre("d.jpg"));
    EXPECT_EQ(ReadExported(name).values, CreateMap().values);
  }
}

TEST_F(DepthExporterTest, AlignsMapsToTheModel) {
  const DepthExportSummary summary =
      ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", {});
  ASSERT_EQ(summary.exported.size(), 1);
  EXPECT_EQ(summary.exported[0].alignment->num_points, kNumPoints);
  EXPECT_THAT(summary.images_with_few_points, ElementsAre("b.jpg"));
  EXPECT_THAT(summary.images_without_model, ElementsAre("c.jpg"));
  const DepthMap map = ReadExported("sub/a.jpg.npy");
  for (size_t i = 0; i < map.values.size(); ++i) {
    // Half floats and single precision.
    EXPECT_NEAR(map.values[i], 4 * CreateMap().values[i], 1e-3);
  }
  EXPECT_THAT(FileContent(dir_ + "/out/alignment.json"),
              HasSubstr("\"num_points\": 40"));
}

TEST_F(DepthExporterTest, WritesMapsOfUndistortedImages) {
  // Half as wide, a quarter of the pixels.
  WriteModel("undistorted", 250, 160, 240);
  DepthExportOptions options;
  options.undistorted_path = dir_ + "/undistorted";
  ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_PINHOLE", 250, 160, 240);
  const DepthMap map =
      ReadDepthMap(dir_ + "/out/sub/a.jpg.npy", camera, DepthReadOptions());
  ASSERT_EQ(map.width, 16);
  ASSERT_EQ(map.height, 24);
  // Column 4 of 16 is between columns 24 and 25 of 64; interpolation is of the
  // logarithm.
  EXPECT_NEAR(map.At(4, 5), 4 * (0.5 + 24.5 / 64), 1e-3);
  fs::remove_all(dir_ + "/undistorted");
  ExpectError(
      [&] {
        ExportDepthMaps(
            database_path_, dir_ + "/model", dir_ + "/out", options);
      },
      "undistorted does not exist");
}

TEST_F(DepthExporterTest, WritesTheWorkspaceOfDenseStereo) {
  DepthExportOptions options;
  options.format = DepthExportFormat::COLMAP_WORKSPACE;
  const std::string workspace = dir_ + "/out";
  const auto run = [&] {
    ExportDepthMaps(database_path_, dir_ + "/model", workspace, options);
  };
  ExpectError(run,
              "out is no workspace of undistorted images; write it first: "
              "colmap image_undistorter");
  WriteModel("out/sparse", 250, 160, 240);
  fs::create_directory(workspace + "/stereo");
  std::ofstream(workspace + "/stereo/fusion.cfg") << "sub/a.jpg\nb.jpg\n";
  run();
  EXPECT_EQ(FileContent(workspace + "/stereo/fusion.cfg"), "sub/a.jpg\n");
  const std::string depths = workspace + "/stereo/depth_maps/sub/a.jpg.";
  const std::string normals = workspace + "/stereo/normal_maps/sub/a.jpg.";
  const std::string size = "16&24&";
  for (const std::string kind : {"geometric.bin", "photometric.bin"}) {
    EXPECT_EQ(FileContent(depths + kind).size(), size.size() + 2 + 4 * 16 * 24);
    EXPECT_EQ(FileContent(normals + kind).substr(0, size.size() + 2),
              size + "3&");
    EXPECT_EQ(FileContent(normals + kind).size(),
              size.size() + 2 + 3 * 4 * 16 * 24);
  }
  options.undistorted_path = workspace + "/sparse";
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_THAT(error, HasSubstr("undistorted_path"));
}

TEST_F(DepthExporterTest, RefinesMapsByNeighbors) {
  // The one image with points has no neighbour.
  DepthExportOptions options;
  options.multi_view = true;
  options.confidence_path = dir_ + "/confidence";
  const DepthExportSummary summary =
      ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  ASSERT_EQ(summary.exported.size(), 1);
  EXPECT_EQ(summary.exported[0].agreeing_ratio, 0);
  EXPECT_THAT(summary.ToText(),
              HasSubstr("neighbours agree at 0.00 % of the pixels"));
  EXPECT_THAT(FileContent(dir_ + "/out/alignment.json"),
              HasSubstr("\"agreeing_ratio\": 0.0"));
  EXPECT_NEAR(ReadExported("sub/a.jpg.npy").At(20, 20),
              4 * CreateMap().At(20, 20),
              1e-3);
  colmap::Bitmap confidence;
  ASSERT_TRUE(
      confidence.Read(dir_ + "/confidence/sub/a.jpg.png", /*as_rgb=*/false));
  colmap::BitmapColor<uint8_t> color;
  ASSERT_TRUE(confidence.GetPixel(20, 20, &color));
  EXPECT_EQ(color.r, 128);
  ASSERT_TRUE(confidence.GetPixel(20, 47, &color));
  EXPECT_EQ(color.r, 0);

  std::string error;
  options.multi_view = false;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "confidence_path needs multi_view");
  const CommandResult result = RunForTest(RunDepthExporter,
                                          {"--database_path",
                                           database_path_,
                                           "--output_path",
                                           dir_ + "/out",
                                           "--multi_view",
                                           "1"});
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("multi_view needs input_path"));
}

TEST_F(DepthExporterTest, WritesPointsForSplatting) {
  DepthExportOptions options;
  options.points_path = dir_ + "/points";
  options.num_points = 100;
  const DepthExportSummary summary =
      ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  EXPECT_THAT(summary.ToText(), HasSubstr("wrote 100 points"));
  const auto images = ReadModelImages(options.points_path);
  // Those without depth have their poses.
  ASSERT_EQ(images.size(), 2);
  EXPECT_EQ(images.count("b.jpg"), 1);
  EXPECT_EQ(ReadModelCameras(options.points_path).size(), 1);
  const std::vector<ModelPoint> points = ReadModelPoints(options.points_path);
  ASSERT_EQ(points.size(), 100);
  EXPECT_EQ(images.at("sub/a.jpg").observations.size(), 100);
  for (const ModelPoint& point : points) {
    // Depth grows with the column: see CreateMap().
    const double column = point.xyz.x() / point.xyz.z() * 50 + 32;
    // Within a cell of points, of about 0.4.
    EXPECT_NEAR(point.xyz.z(), 4 * (0.5 + (column - 0.5) / 64), 0.1);
  }
  // In any order of threads.
  const std::string bytes = FileContent(options.points_path + "/points3D.bin");
  options.num_threads = 1;
  ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  EXPECT_EQ(FileContent(options.points_path + "/points3D.bin"), bytes);
  std::string error;
  options.num_points = 0;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "num_points must be at least 1");
}

TEST_F(DepthExporterTest, DrawsAlignments) {
  DepthExportOptions options;
  options.plot_path = dir_ + "/plots";
  ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  colmap::Bitmap plot;
  ASSERT_TRUE(plot.Read(dir_ + "/plots/sub/a.jpg.png", /*as_rgb=*/true));
  int num_blue = 0;
  for (int y = 0; y < plot.Height(); ++y) {
    for (int x = 0; x < plot.Width(); ++x) {
      colmap::BitmapColor<uint8_t> color;
      ASSERT_TRUE(plot.GetPixel(x, y, &color));
      if (color.b <= color.r) continue;
      ++num_blue;
      // The map is right: all are on the diagonal, by the size of a point.
      EXPECT_LE(std::abs(x + y - (plot.Width() - 1)), 3);
    }
  }
  EXPECT_GT(num_blue, 2 * kNumPoints);
  const CommandResult result = RunForTest(RunDepthExporter,
                                          {"--database_path",
                                           database_path_,
                                           "--output_path",
                                           dir_ + "/out",
                                           "--plot_path",
                                           options.plot_path});
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("plot_path needs input_path"));
}

// The different scales in depth_params.json.
std::set<std::string> FindScales(const std::string& json) {
  const std::string key = "\"scale\": ";
  std::set<std::string> scales;
  for (size_t pos = json.find(key); pos != std::string::npos;
       pos = json.find(key, pos + 1)) {
    const size_t begin = pos + key.size();
    scales.insert(json.substr(begin, json.find(',', begin) - begin));
  }
  return scales;
}

TEST_F(DepthExporterTest, SplattingGetsOneScaleForAllImages) {
  DepthExportOptions options;
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  ExportDepthMaps(database_path_, std::nullopt, dir_ + "/out", options);
  EXPECT_TRUE(fs::exists(dir_ + "/out/sub/a.png"));
  const std::string json = FileContent(dir_ + "/out/depth_params.json");
  EXPECT_THAT(json, HasSubstr("\"sub/a\""));
  EXPECT_THAT(json, HasSubstr("\"b\""));
  EXPECT_THAT(json, HasSubstr("\"offset\": 0.0"));
  // d.jpg has no map.
  EXPECT_EQ(FindScales(json).size(), 2);
  EXPECT_EQ(FindScales(json).count("0.0"), 1);
  EXPECT_TRUE(fs::exists(dir_ + "/out/d.png"));

  // b.jpg has few points, c.jpg and d.jpg are not in the model.
  ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/aligned", options);
  const std::string aligned = FileContent(dir_ + "/aligned/depth_params.json");
  EXPECT_THAT(aligned, HasSubstr("\"b\""));
  EXPECT_EQ(FindScales(aligned).count("0.0"), 1);
  EXPECT_TRUE(fs::exists(dir_ + "/aligned/b.png"));
  EXPECT_FALSE(fs::exists(dir_ + "/aligned/d.png"));
}

TEST_F(DepthExporterTest, ExportWithoutAnyDepthFails) {
  DepthExportOptions options;
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  options.alignment.min_num_points = kNumPoints + 1;
  ExpectError(
      [&] {
        ExportDepthMaps(
            database_path_, dir_ + "/model", dir_ + "/out", options);
      },
      "none of the 2 images with a map, such as sub/a.jpg, sees enough points");
  EXPECT_FALSE(fs::exists(dir_ + "/out/depth_params.json"));

  options.format = DepthExportFormat::PNG;
  const auto run = [&] {
    return ExportDepthMaps(
        database_path_, std::nullopt, dir_ + "/out", options);
  };
  options.png_scale = 1e-6;
  ExpectError(run, "choose a larger png_scale");
  DepthMap near = CreateMap();
  for (float& depth : near.values) depth *= 1e-3f;
  DepthDatabase(database_path_, DepthDatabase::Mode::READ_WRITE)
      .WriteDepthMap(1, near, {DepthUnit::METRIC, {0.5f}});
  EXPECT_THAT(run().images_out_of_range, ElementsAre("b.jpg", "c.jpg"));
}

// The trainer reads the images of the undistorted model.
TEST_F(DepthExporterTest, SplattingGetsAllUndistortedImages) {
  colmap::Reconstruction model;
  model.Read(dir_ + "/model");
  model.DeRegisterImage(2);
  fs::create_directories(dir_ + "/small");
  model.Write(dir_ + "/small");
  DepthExportOptions options;
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  options.undistorted_path = dir_ + "/model";
  ExportDepthMaps(database_path_, dir_ + "/small", dir_ + "/out", options);
  const std::string json = FileContent(dir_ + "/out/depth_params.json");
  EXPECT_THAT(json, HasSubstr("\"b\""));
  EXPECT_EQ(FindScales(json).count("0.0"), 1);
  EXPECT_TRUE(fs::exists(dir_ + "/out/b.png"));
}

TEST_F(DepthExporterTest, SplattingRefusesImagesOfOneName) {
  SqliteConnection(database_path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE images SET name = 'b.png' WHERE image_id = 4");
  DepthExportOptions options;
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  ExpectError(
      [&] {
        ExportDepthMaps(database_path_, std::nullopt, dir_ + "/out", options);
      },
      "images b.jpg and b.png would share the depth map b.png");
}

TEST_F(DepthExporterTest, WritesNothingOutsideTheFolder) {
  DepthExportOptions options;
  for (const DepthExportFormat format :
       {DepthExportFormat::NPY, DepthExportFormat::GAUSSIAN_SPLATTING}) {
    options.format = format;
    for (const std::string name : {"../b.jpg", "sub/../../b.jpg"}) {
      SqliteConnection(database_path_, SqliteConnection::Mode::READ_WRITE)
          .Execute("UPDATE images SET name = '" + name +
                   "' WHERE image_id = 2");
      ExpectError(
          [&] {
            ExportDepthMaps(
                database_path_, std::nullopt, dir_ + "/out", options);
          },
          {"../b", "leads out of the folder " + dir_ + "/out"});
    }
  }
  for (const fs::directory_entry& entry : fs::directory_iterator(dir_)) {
    EXPECT_NE(entry.path().filename().string().substr(0, 2), "b.");
  }
}

TEST_F(DepthExporterTest, ReplacesNoFileThatIsNotItsOwn) {
  const std::string own = dir_ + "/out/sub/a.jpg.npy";
  fs::create_directories(dir_ + "/out/sub");
  std::ofstream(own) << "somebody's own";
  DepthExportOptions options;
  options.plot_path = dir_ + "/plots";
  const auto run = [&] {
    ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  };
  ExpectErrorAndNoChange(
      own, run, {own + " is in the way", "choose another output folder"});
  EXPECT_FALSE(fs::exists(options.plot_path));
  EXPECT_FALSE(fs::exists(dir_ + "/out/alignment.json"));
  fs::remove(own);
  // A second run replaces what the first one wrote, in any of its formats.
  run();
  options.format = DepthExportFormat::PNG;
  run();
  run();

  options.plot_path = dir_ + "/out/";
  ExpectError(run, ".jpg.png would be written twice");
  options.plot_path.clear();
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  std::ofstream(dir_ + "/out/b.png") << "a photo";
  ExpectErrorAndNoChange(dir_ + "/out/b.png", run, {"out/b.png is in the way"});
}

TEST_F(DepthExporterTest, ReplacesNoModelThatItReads) {
  const std::string points = dir_ + "/model/points3D.bin";
  DepthExportOptions options;
  options.points_path = dir_ + "/model/";
  const auto run = [&] {
    ExportDepthMaps(database_path_, dir_ + "/model", dir_ + "/out", options);
  };
  ExpectErrorAndNoChange(
      points, run, {"model/ is the folder of a model that is read"});
  WriteModel("undistorted");
  ExpectErrorAndNoChange(
      points,
      [&] {
        ExportDepthMaps(
            database_path_, dir_ + "/undistorted", dir_ + "/out", options);
      },
      {"cameras.bin is in the way"});
  options.undistorted_path = options.points_path = dir_ + "/undistorted";
  ExpectErrorAndNoChange(
      points, run, {"undistorted is the folder of a model that is read"});
  EXPECT_FALSE(fs::exists(dir_ + "/out"));
}

TEST_F(DepthExporterTest, NamesNeedNotBeUtf8) {
  SqliteConnection(database_path_, SqliteConnection::Mode::READ_WRITE)
      .Execute(
          "UPDATE images SET name = CAST(x'e92e6a7067' AS TEXT) "
          "WHERE image_id = 2");
  DepthExportOptions options;
  options.format = DepthExportFormat::GAUSSIAN_SPLATTING;
  ExportDepthMaps(database_path_, std::nullopt, dir_ + "/out", options);
  EXPECT_TRUE(fs::exists(dir_ + "/out/\xe9.png"));
  EXPECT_THAT(FileContent(dir_ + "/out/depth_params.json"),
              HasSubstr("\"\uFFFD\""));
}

TEST_F(DepthExporterTest, SaysWhatIsMissing) {
  const auto message = [&](const std::string& database_path,
                           const std::string& model_path) -> std::string {
    try {
      ExportDepthMaps(database_path, model_path, dir_ + "/out", {});
      return "";
    } catch (const std::runtime_error& error) {
      return error.what();
    }
  };
  EXPECT_THAT(message(database_path_, dir_ + "/missing"),
              HasSubstr("does not exist"));
  std::ofstream(dir_ + "/file") << "no folder";
  ExpectError(
      [&] {
        ExportDepthMaps(database_path_, std::nullopt, dir_ + "/file", {});
      },
      "cannot create the output folder " + dir_ + "/file");
  DepthDatabase(database_path_, DepthDatabase::Mode::READ_WRITE)
      .WriteKeypointDepths(1, {DepthUnit::METRIC, {1}});
  DepthDatabase(database_path_, DepthDatabase::Mode::READ_WRITE)
      .WriteKeypointDepths(2, {DepthUnit::METRIC, {1}});
  EXPECT_THAT(message(database_path_, dir_ + "/model"),
              HasSubstr("with a depth map is in the model"));
  DepthDatabase(database_path_, DepthDatabase::Mode::READ_WRITE)
      .WriteKeypointDepths(3, {DepthUnit::METRIC, {1}});
  EXPECT_THAT(message(database_path_, dir_ + "/model"),
              HasSubstr("run depth_importer without --keypoints_only"));
}

TEST_F(DepthExporterTest, CommandReportsUsageAndResult) {
  EXPECT_EQ(RunForTest(RunDepthExporter, {"--database_path", "a"}).code, 2);
  EXPECT_EQ(RunForTest(RunDepthExporter,
                       {"--database_path",
                        database_path_,
                        "--output_path",
                        dir_ + "/out",
                        "--format",
                        "jpg"})
                .code,
            2);
  const CommandResult result = RunForTest(RunDepthExporter,
                                          {"--database_path",
                                           database_path_,
                                           "--input_path",
                                           dir_ + "/model",
                                           "--output_path",
                                           dir_ + "/out"});
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.out,
              HasSubstr("sub/a.jpg: sub/a.jpg.npy, 40 points, scale 4.0000"));
  EXPECT_THAT(result.out, HasSubstr("image with too few points: b.jpg"));
}

}  // namespace
}  // namespace dgsfm
