#include "controllers/depth_importer.h"

#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/formats/depth_file_formats.h"
#include "colmap_ext/output_file.h"
#include "controllers/commands/commands.h"
#include "tests/testing/colmap_database.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/npz_file.h"
#include "tests/testing/test_dir.h"

#include <colmap/util/bitmap.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

constexpr int kPinhole = 1;
const std::vector<Eigen::Vector2d> kNoKeypoints;

class DepthImporter : public testing::Test {
 protected:
  // Images of 30 x 20 pixels: sub/a.jpg and b.jpg with key points, c.jpg
  // without.
  void SetUp() override {
    const std::string dir = CreateTestDir();
    database_path_ = dir + "/database.db";
    depth_path_ = dir + "/depth";
    fs::create_directories(depth_path_ + "/sub");
    ColmapDatabaseWriter writer(database_path_, ColmapSchema::V4_2);
    const auto camera_id = writer.AddCamera(kPinhole, 30, 20, {30, 30, 15, 10});
    image_id1_ = writer.AddImage("sub/a.jpg", camera_id, {{5, 5}, {25, 15}});
    image_id2_ = writer.AddImage("b.jpg", camera_id, {{5, 5}});
    image_id3_ = writer.AddImage("c.jpg", camera_id, kNoKeypoints);
  }

  // A 3 x 2 map whose left column is unknown.
  void WriteMap(const std::string& file, float depth) const {
    WriteDepthNpy(depth_path_ + "/" + file,
                  {3, 2, DepthUnit::METRIC, {0, depth, depth, 0, depth, depth}},
                  NpyPrecision::SINGLE);
  }

  DepthImportSummary Import(const DepthImportOptions& options = {}) const {
    return ImportDepthMaps(database_path_, depth_path_, options);
  }

  void WriteGeometry() const {
    PairGeometry geometry;
    geometry.status = PairStatus::TOO_FEW_MATCHES;
    DepthDatabase(database_path_, DepthDatabase::Mode::READ_WRITE)
        .WritePairGeometries(
            {{PairIdOfImages(image_id1_, image_id2_), geometry}});
  }

  // Expects an error with all these parts, and an unchanged database.
  void ExpectError(const std::vector<std::string>& parts) const {
    ExpectErrorAndNoChange(
        database_path_, [this] { Import(); }, parts);
  }

  std::string database_path_;
  std::string depth_path_;
  colmap::image_t image_id1_ = 0;
  colmap::image_t image_id2_ = 0;
  colmap::image_t image_id3_ = 0;
};

TEST_F(DepthImporter, RefusesDepthsThatItCannotStore) {
  WriteMap("c.npy", 3);
  for (const double scale : {1e5, 1e-6}) {
    DepthImportOptions options;
    options.overwrite = true;
    options.reading.scale = scale;
    options.reading.unit = DepthUnit::RELATIVE;
    const DepthImportSummary summary = Import(options);
    ASSERT_FALSE(summary.failed.empty());
    EXPECT_THAT(summary.failed.back().reason, HasSubstr("its median depth is"));
    EXPECT_THAT(summary.failed.back().reason,
                HasSubstr("give another --depth_scale"));
  }
}

TEST_F(DepthImporter, WarnsOfMillimetres) {
  const std::string warning = "warning: 1 maps hold whole numbers";
  WriteMap("sub/a.npy", 2310);
  WriteMap("c.npy", 3);
  EXPECT_THAT(Import().ToText(), HasSubstr(warning));
  DepthImportOptions options;
  options.overwrite = true;
  options.reading.scale = 0.001;
  EXPECT_THAT(Import(options).ToText(), Not(HasSubstr("warning")));
  options.reading.scale = 1;
  options.reading.unit = DepthUnit::RELATIVE;
  EXPECT_THAT(Import(options).ToText(), Not(HasSubstr("warning")));
  WriteMap("sub/a.npy", 2310.5);
  options.reading.unit = DepthUnit::METRIC;
  EXPECT_THAT(Import(options).ToText(), Not(HasSubstr("warning")));
}

TEST_F(DepthImporter, NamesMapsWithoutConfidence) {
  WriteMap("sub/a.npy", 2.5);
  WriteMap("b.npy", 2.5);
  DepthImportOptions options;
  options.overwrite = true;
  options.confidence_path = depth_path_ + "/../confidence";
  fs::create_directories(options.confidence_path + "/sub");
  ExpectErrorAndNoChange(
      database_path_,
      [&] { Import(options); },
      {"has no confidence map of 2 of 2 images with depth, e.g. sub/a.jpg",
       "leave confidence_path out"});
  const auto warnings = [&](const std::string& depth_file) {
    fs::copy_file(depth_path_ + "/" + depth_file,
                  options.confidence_path + "/" + depth_file);
    testing::internal::CaptureStderr();
    Import(options);
    return testing::internal::GetCapturedStderr();
  };
  EXPECT_THAT(warnings("sub/a.npy"),
              HasSubstr("no confidence map of 1 of 2 images with depth, e.g. "
                        "b.jpg: their depth is imported without"));
  EXPECT_THAT(warnings("b.npy"), Not(HasSubstr("confidence")));
}

TEST_F(DepthImporter, StoresRelativeMapsAsTheyAre) {
  WriteFile(depth_path_ + "/b.npy",
            internal::FormatNpyFloat({3, 2, {-2, -2, 4, -2, -2, 4}}));
  DepthImportOptions options;
  options.reading.type = DepthType::RELATIVE_DISPARITY;
  ASSERT_EQ(Import(options).imported.size(), 1);
  const DepthDatabase database(database_path_, DepthDatabase::Mode::READ_ONLY);
  const KeypointDepths depths = database.ReadAllKeypointDepths().at(image_id2_);
  EXPECT_EQ(depths.unit, DepthUnit::AFFINE_DISPARITY);
  EXPECT_THAT(depths.depths, ElementsAre(-2));
  // Maps are positive in the database.
  EXPECT_EQ(database.ReadDepthMap(image_id2_).At(0, 0), 1);

  std::string error;
  options.reading.scale = 0.001;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_THAT(error, HasSubstr("depth_scale"));
}

TEST_F(DepthImporter, StoresFocalLengthOfTheDepthModel) {
  const auto add = [&](const std::string& name,
                       const internal::DepthGrid& grid) {
    AddToNpz(depth_path_ + "/b.npz", name, internal::FormatNpyFloat(grid));
  };
  add("depth.npy", {3, 2, std::vector<float>(6, 2)});
  // As MoGe has it, in units of the 30 x 20 image's sides.
  add("intrinsics.npy", {3, 3, {1.25f, 0, 0.5f, 0, 1.875f, 0.5f, 0, 0, 1}});
  WriteMap("c.npy", 3);
  const DepthImportSummary summary = Import();
  ASSERT_EQ(summary.imported.size(), 2);
  EXPECT_EQ(summary.imported[0].focal_length_px, 37.5);
  EXPECT_EQ(summary.imported[1].focal_length_px, 0);
  EXPECT_THAT(summary.ToText(), HasSubstr("focal length 37.5 px"));
  const auto depths =
      DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
          .ReadAllKeypointDepths();
  EXPECT_EQ(depths.at(image_id2_).focal_length_px, 37.5);
  EXPECT_EQ(depths.at(image_id3_).focal_length_px, 0);
}

TEST_F(DepthImporter, StoresMapsAndSamples) {
  WriteMap("sub/a.jpg.npy", 2);
  WriteMap("c.npy", 3);
  WriteMap("other.npy", 4);
  DepthImportOptions options;
  options.reading.unit = DepthUnit::RELATIVE;
  options.reading.scale = 10;
  const DepthImportSummary summary = Import(options);

  ASSERT_EQ(summary.imported.size(), 2);
  EXPECT_EQ(summary.imported[0].name, "sub/a.jpg");
  EXPECT_EQ(summary.imported[0].file, depth_path_ + "/sub/a.jpg.npy");
  EXPECT_EQ(summary.imported[0].width, 3);
  EXPECT_EQ(summary.imported[0].height, 2);
  EXPECT_DOUBLE_EQ(summary.imported[0].coverage, 2.0 / 3.0);
  EXPECT_EQ(summary.imported[0].num_keypoints, 2);
  EXPECT_EQ(summary.imported[0].num_keypoints_with_depth, 1);
  EXPECT_EQ(summary.imported[1].name, "c.jpg");
  EXPECT_EQ(summary.imported[1].num_keypoints, 0);
  EXPECT_THAT(summary.images_without_depth, ElementsAre("b.jpg"));
  EXPECT_THAT(summary.files_without_image, ElementsAre("other.npy"));

  const DepthDatabase database(database_path_, DepthDatabase::Mode::READ_ONLY);
  const DepthMap depth_map = database.ReadDepthMap(image_id1_);
  EXPECT_EQ(depth_map.unit, DepthUnit::RELATIVE);
  EXPECT_THAT(depth_map.values, ElementsAre(0, 20, 20, 0, 20, 20));
  EXPECT_FALSE(database.HasDepthMap(image_id2_));
  EXPECT_TRUE(database.HasDepthMap(image_id3_));
  const auto depths = database.ReadAllKeypointDepths();
  EXPECT_EQ(depths.at(image_id1_).unit, DepthUnit::RELATIVE);
  EXPECT_THAT(depths.at(image_id1_).depths, ElementsAre(0, 20));
  EXPECT_EQ(depths.count(image_id2_), 0);
}

TEST_F(DepthImporter, FindsFilesInCapitals) {
  WriteMap("b.npy", 2);
  fs::rename(depth_path_ + "/b.npy", depth_path_ + "/b.NPY");
  EXPECT_EQ(Import().imported.size(), 1);
}

TEST_F(DepthImporter, SummaryAsText) {
  WriteMap("sub/a.npy", 2);
  WriteMap("z.npy", 2);
  EXPECT_EQ(Import().ToText(),
            "sub/a.jpg: 3 x 2 map, 66.7 % known, 1 of 2 key points with depth "
            "(50.0 %), median depth 2\n"
            "file without image: z.npy\n"
            "image without depth: b.jpg\n"
            "image without depth: c.jpg\n"
            "warning: 2 of 3 images have no depth map, and depth helps pairs "
            "of two images with maps alone: let the depth model run on all "
            "images\n"
            "imported 1 of 3 images, 1 key points with depth (50.0 %)\n");
}

TEST_F(DepthImporter, NamesLinksToNothingAndInCircles) {
  WriteMap("b.npy", 2);
  fs::create_symlink("nowhere.npy", depth_path_ + "/c.npy");
  const DepthImportSummary summary = Import();
  ASSERT_EQ(summary.failed.size(), 1);
  EXPECT_EQ(summary.failed[0].name, "c.jpg");
  EXPECT_THAT(summary.failed[0].reason, HasSubstr("No such file"));
  EXPECT_EQ(summary.imported.size(), 1);

  fs::create_directory_symlink(".", depth_path_ + "/circle");
  ExpectError({"cannot search " + depth_path_ + ": Too many levels"});
}

TEST_F(DepthImporter, ReplacesEarlierImportAndItsGeometries) {
  WriteMap("b.npy", 2);
  WriteMap("c.npy", 2);
  Import();
  WriteGeometry();
  fs::remove(depth_path_ + "/c.npy");
  WriteMap("b.npy", 5);
  const DepthImportSummary summary = Import();
  EXPECT_THAT(summary.images_without_depth, ElementsAre("sub/a.jpg", "c.jpg"));
  EXPECT_EQ(summary.num_kept, 1);
  EXPECT_THAT(summary.ToText(),
              HasSubstr("1 of these keep the depth of an earlier import"));
  const DepthDatabase database(database_path_, DepthDatabase::Mode::READ_ONLY);
  EXPECT_EQ(database.ReadDepthMap(image_id2_).At(1, 0), 5);
  EXPECT_EQ(database.ReadDepthMap(image_id3_).At(1, 0), 2);
  EXPECT_TRUE(database.ReadPairGeometries().empty());
}

TEST_F(DepthImporter, BadFilesAreNamedAndTheOthersImported) {
  // More images than one batch.
  {
    ColmapDatabaseWriter writer(database_path_ + "2", ColmapSchema::V3_8);
    const auto camera_id = writer.AddCamera(kPinhole, 30, 20, {30, 30, 15, 10});
    for (int i = 10; i < 30; ++i) {
      const std::string name = std::to_string(i);
      writer.AddImage(name + ".jpg", camera_id, {{15, 10}});
      WriteMap(name + ".npy", 1);
    }
  }
  database_path_ += "2";
  std::ofstream(depth_path_ + "/12.npy") << "nonsense";
  WriteMap("28.npy", 0);
  for (const int num_threads : {1, 4}) {
    DepthImportOptions options;
    options.num_threads = num_threads;
    options.overwrite = true;
    const DepthImportSummary summary = Import(options);
    EXPECT_EQ(summary.imported.size(), 18);
    ASSERT_EQ(summary.failed.size(), 2);
    EXPECT_EQ(summary.failed[0].name, "12.jpg");
    EXPECT_THAT(summary.failed[0].reason,
                HasSubstr(depth_path_ + "/12.npy: not a NumPy array"));
    EXPECT_THAT(summary.ToText(),
                HasSubstr("failed: 28.jpg: depth map " + depth_path_ +
                          "/28.npy: no pixel of the 3 x 2 depth map"));
  }
  // Only what failed is left to do.
  WriteMap("12.npy", 1);
  const DepthImportSummary rest = Import();
  ASSERT_EQ(rest.imported.size(), 1);
  EXPECT_EQ(rest.imported[0].name, "12.jpg");
  EXPECT_EQ(rest.num_unchanged, 18);
  EXPECT_THAT(rest.ToText(), HasSubstr("imported 1 of 20 images"));
}

TEST_F(DepthImporter, ImportsAgainOnlyWhatChanged) {
  WriteMap("sub/a.npy", 2);
  WriteMap("b.npy", 3);
  Import();
  WriteGeometry();
  EXPECT_EQ(Import().num_unchanged, 2);
  const auto num_geometries = [&] {
    return DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
        .ReadPairGeometries()
        .size();
  };
  EXPECT_EQ(num_geometries(), 1);
  // Key points, options and files decide.
  SqliteConnection(database_path_, SqliteConnection::Mode::READ_WRITE)
      .Execute("UPDATE keypoints SET data = x'" + std::string(48, '0') +
               "' WHERE image_id = " + std::to_string(image_id2_));
  DepthImportSummary summary = Import();
  ASSERT_EQ(summary.imported.size(), 1);
  EXPECT_EQ(summary.imported[0].name, "b.jpg");
  EXPECT_EQ(num_geometries(), 0);
  DepthImportOptions options;
  options.reading.scale = 2;
  EXPECT_EQ(Import(options).imported.size(), 2);
  fs::last_write_time(
      depth_path_ + "/b.npy",
      fs::last_write_time(depth_path_ + "/b.npy") + std::chrono::seconds(1));
  EXPECT_EQ(Import(options).imported.size(), 1);
}

TEST_F(DepthImporter, StoresDepthAtKeypointsOnly) {
  WriteMap("sub/a.npy", 2);
  Import();
  DepthImportOptions options;
  options.keypoints_only = true;
  EXPECT_EQ(Import(options).imported.size(), 1);
  const DepthDatabase database(database_path_, DepthDatabase::Mode::READ_ONLY);
  EXPECT_FALSE(database.HasDepthMap(image_id1_));
  EXPECT_THAT(database.ReadAllKeypointDepths().at(image_id1_).depths,
              ElementsAre(0, 2));
}

TEST_F(DepthImporter, PrefersGeometricDenseMaps) {
  const auto write = [&](const std::string& file, float depth) {
    WriteDepthDenseBin(depth_path_ + "/" + file,
                       {3, 2, DepthUnit::METRIC, std::vector<float>(6, depth)});
  };
  write("sub/a.jpg.geometric.bin", 2);
  write("sub/a.jpg.photometric.bin", 3);
  write("b.jpg.photometric.bin", 4);
  EXPECT_EQ(Import().imported.size(), 2);
  const auto depths =
      DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
          .ReadAllKeypointDepths();
  EXPECT_THAT(depths.at(image_id1_).depths, ElementsAre(2, 2));
  EXPECT_THAT(depths.at(image_id2_).depths, ElementsAre(4));
}

TEST_F(DepthImporter, TurnsMapsOfImagesWithExifOrientation) {
  // What a viewer shows of c.jpg is 20 x 30.
  colmap::Bitmap bitmap;
  bitmap.Allocate(30, 20, /*as_rgb=*/false);
  const std::string image_path = depth_path_ + "/../images";
  fs::create_directories(image_path);
  ASSERT_TRUE(bitmap.Write(image_path + "/plain.jpg", FIF_JPEG));
  std::string bytes = FileContent(image_path + "/plain.jpg");
  // An EXIF segment with one tag: orientation 6 as a little-endian short.
  bytes.insert(2,
               std::string("\xff\xe1\x00\x22"
                           "Exif\0\0II*\0\x08\0\0\0\x01\0"
                           "\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0",
                           36));
  std::ofstream(image_path + "/c.jpg", std::ios::binary) << bytes;
  std::vector<float> values(24);
  std::iota(values.begin(), values.end(), 1.0f);
  WriteDepthNpy(depth_path_ + "/c.npy",
                {4, 6, DepthUnit::METRIC, values},
                NpyPrecision::SINGLE);
  const DepthImportSummary refused = Import();
  ASSERT_EQ(refused.failed.size(), 1);
  EXPECT_THAT(refused.failed[0].reason,
              HasSubstr("the depth map is 4 x 6 but the image 30 x 20: one of "
                        "them is turned by 90 degrees"));
  DepthImportOptions options;
  options.displayed_image_path = image_path;
  EXPECT_EQ(Import(options).imported.size(), 1);
  const DepthMap stored =
      DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
          .ReadDepthMap(image_id3_);
  ASSERT_EQ(stored.width, 6);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 6; ++x) {
      // The upper left corner of what is stored is the upper right one of what
      // is shown.
      EXPECT_EQ(stored.At(x, y), values[4 * x + 3 - y]);
    }
  }
}

TEST_F(DepthImporter, AmbiguousNamesAreRefused) {
  WriteMap("b.npy", 1);
  WriteMap("b.jpg.npy", 1);
  ExpectError({"image b.jpg", "b.npy", "b.jpg.npy"});
  fs::remove(depth_path_ + "/b.npy");
  std::ofstream(depth_path_ + "/b.jpg.pfm") << "";
  ExpectError({"image b.jpg", "b.jpg.npy", "b.jpg.pfm"});
  fs::remove(depth_path_ + "/b.jpg.pfm");
  fs::remove(depth_path_ + "/b.jpg.npy");
  {
    ColmapDatabaseWriter writer(database_path_ + "2", ColmapSchema::V3_8);
    const auto camera_id = writer.AddCamera(kPinhole, 30, 20, {30, 30, 15, 10});
    writer.AddImage("b.jpg", camera_id, kNoKeypoints);
    writer.AddImage("b.png", camera_id, kNoKeypoints);
  }
  database_path_ += "2";
  WriteMap("b.npy", 1);
  ExpectError({"b.npy fits two images, b.jpg and b.png"});
}

TEST_F(DepthImporter, NothingToImportIsAnError) {
  ExpectError({depth_path_, "3 images", database_path_});
  WriteMap("a.npy", 1);  // the image is in a sub-folder
  ExpectError({depth_path_, "3 images", database_path_});
  depth_path_ += "/missing";
  ExpectError({depth_path_, "does not exist"});
}

TEST_F(DepthImporter, CommandReportsUsageAndResult) {
  const auto run = [](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "colmap");
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    const Command command = {"depth_importer", "", RunDepthImporter};
    return RunCommand(command, static_cast<int>(argv.size()), argv.data());
  };
  WriteMap("b.npy", 0.5);
  const std::vector<std::string> paths = {
      "--database_path", database_path_, "--depth_path", depth_path_};
  const auto with_paths = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), paths.begin(), paths.end());
    return arguments;
  };
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  EXPECT_EQ(run(with_paths({"--depth_type", "metres"})), 2);
  EXPECT_EQ(run(with_paths({"--depth_unit", "inches"})), 2);
  EXPECT_EQ(run(with_paths({"--depth_scale", "0"})), 2);
  EXPECT_EQ(run(with_paths({"--depth", "x"})), 2);
  EXPECT_EQ(run({"--database_path", database_path_}), 2);
  EXPECT_EQ(run({"--database_path", "missing.db", "--depth_path", depth_path_}),
            1);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("'inches'"));

  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  EXPECT_EQ(run(with_paths({"--depth_type", "inverse", "--depth_scale", "2"})),
            0);
  EXPECT_THAT(testing::internal::GetCapturedStdout(),
              testing::EndsWith("imported 1 of 3 images, 0 key points with "
                                "depth (0.0 %)\n"));
  testing::internal::GetCapturedStderr();
  const DepthDatabase database(database_path_, DepthDatabase::Mode::READ_ONLY);
  EXPECT_EQ(database.ReadDepthMap(image_id2_).At(1, 0), 4);
}

// Real maps: floats, a tiny network's, and a sensor's in millimetres.
struct RealSet {
  std::string name;
  std::string folder;
  double scale;
  // Bounds on the median depth of the key points [m], and on the share of key
  // points with depth, from a look at the scene.
  double min_median;
  double max_median;
  double min_share;
};

class DepthImporterOnRealData : public testing::TestWithParam<RealSet> {};

TEST_P(DepthImporterOnRealData, GivesPlausibleDepth) {
  const RealSet& set = GetParam();
  const auto path = SharedDataSet(set.name);
  if (!path) GTEST_SKIP() << "no data set " << set.name;
  const std::string database_path = CreateTestDir() + "/database.db";
  fs::copy_file(*path + "/database.db", database_path);
  DepthImportOptions options;
  options.reading.scale = set.scale;
  const DepthImportSummary summary =
      ImportDepthMaps(database_path, *path + "/" + set.folder, options);
  EXPECT_TRUE(summary.images_without_depth.empty());
  EXPECT_TRUE(summary.files_without_image.empty());

  size_t num_keypoints = 0;
  std::vector<float> known_depths;
  const DepthDatabase database(database_path, DepthDatabase::Mode::READ_ONLY);
  for (const auto& [image_id, depths] : database.ReadAllKeypointDepths()) {
    num_keypoints += depths.depths.size();
    for (const float depth : depths.depths) {
      if (depth > 0) known_depths.push_back(depth);
    }
  }
  EXPECT_GT(known_depths.size(), set.min_share * num_keypoints);
  const auto median = known_depths.begin() + known_depths.size() / 2;
  std::nth_element(known_depths.begin(), median, known_depths.end());
  EXPECT_GT(*median, set.min_median);
  EXPECT_LT(*median, set.max_median);
}

INSTANTIATE_TEST_SUITE_P(
    RealData,
    DepthImporterOnRealData,
    testing::Values(RealSet{"fountain-P11", "depth", 1, 6, 14, 0.9},
                    RealSet{"fountain-P11", "depth_meter", 1, 2, 5, 0.999},
                    RealSet{"redkitchen50", "depth_sensor", 0.001, 1, 4, 0.7}),
    [](const auto& test) {
      std::string name = std::string(test.param.name) + "_" + test.param.folder;
      name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
      return name;
    });

}  // namespace
}  // namespace dgsfm
