#include "colmap_ext/model/model_io.h"

#include "tests/testing/expect_error.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

using testing::HasSubstr;

std::string WriteModel(const std::string& folder,
                       bool is_binary,
                       int num_images) {
  fs::create_directories(folder);
  const colmap::Reconstruction model = CreateRingModel(num_images);
  is_binary ? model.WriteBinary(folder) : model.WriteText(folder);
  return folder;
}

class ModelIo : public testing::TestWithParam<bool> {
 protected:
  std::string Extension() const { return GetParam() ? ".bin" : ".txt"; }
};

TEST_P(ModelIo, ReadsWhatColmapWrites) {
  const std::string folder =
      WriteModel(CreateTestDir(), GetParam(), /*num_images=*/5);
  const colmap::Reconstruction truth = CreateRingModel(5);

  const auto images = ReadModelImages(folder);
  ASSERT_EQ(images.size(), 5);
  for (const auto& [id, expected] : truth.Images()) {
    const ModelImage& image = images.at(expected.Name());
    EXPECT_EQ(image.camera_id, 1);
    // Equal up to the normalisation of the quaternion.
    EXPECT_TRUE(QvecFromRotation(image.cam_from_world.rotation)
                    .isApprox(expected.Qvec(), 1e-15));
    EXPECT_EQ(image.cam_from_world.translation, expected.Tvec());
    // The third key point sees nothing.
    ASSERT_EQ(image.observations.size(), 2);
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(image.observations[i].xy, expected.Point2D(i).XY());
      EXPECT_EQ(image.observations[i].point3D_id,
                expected.Point2D(i).Point3DId());
    }
  }
  const auto cameras = ReadModelCameras(folder);
  ASSERT_EQ(cameras.size(), 1);
  EXPECT_EQ(cameras.at(1).Params(), truth.Camera(1).Params());
  EXPECT_EQ(cameras.at(1).ModelName(), "SIMPLE_RADIAL");
  EXPECT_EQ(cameras.at(1).Width(), 640);

  const auto points = ReadModelPoints(folder);
  ASSERT_EQ(points.size(), 5);
  for (const ModelPoint& point : points) {
    const auto& expected = truth.Point3D(point.color(1) + 1);
    EXPECT_EQ(point.point3D_id, point.color(1) + 1);
    EXPECT_EQ(point.xyz, expected.XYZ());
    EXPECT_EQ(point.color, expected.Color());
    EXPECT_EQ(point.track_length, 2);
  }
}

TEST_P(ModelIo, EveryTruncationIsReportedOrStillReadable) {
  const std::string folder =
      WriteModel(CreateTestDir(), GetParam(), /*num_images=*/2);
  for (const std::string stem : {"cameras", "images", "points3D"}) {
    const fs::path path = fs::path(folder) / (stem + Extension());
    for (uintmax_t size = fs::file_size(path); size-- > 0;) {
      fs::resize_file(path, size);
      try {
        if (stem == "cameras") ReadModelCameras(folder);
        if (stem == "images") ReadModelImages(folder);
        if (stem == "points3D") ReadModelPoints(folder);
        EXPECT_FALSE(GetParam()) << stem << " with " << size << " bytes";
      } catch (const std::runtime_error& error) {
        EXPECT_THAT(error.what(), HasSubstr(path.string()));
      }
    }
  }
}

TEST_P(ModelIo, MissingFilesAreNamed) {
  const std::string folder =
      WriteModel(CreateTestDir(), GetParam(), /*num_images=*/2);
  fs::remove(folder + "/points3D" + Extension());
  EXPECT_EQ(ReadModelImages(folder).size(), 2);
  ExpectError([&] { ReadModelPoints(folder); }, "points3D.txt");
  fs::remove(folder + "/images" + Extension());
  ExpectError([&] { ReadModelImages(folder); }, "images.txt");
  ExpectError([&] { FindModels(folder); }, folder);
  ExpectError([] { FindModels("/does/not/exist"); }, "/does/not/exist");
}

TEST_P(ModelIo, FindsModelOrSubFolders) {
  const std::string dir = CreateTestDir();
  const std::string second = WriteModel(dir + "/1", GetParam(), 3);
  const std::string first = WriteModel(dir + "/0", GetParam(), 2);
  fs::create_directory(dir + "/other");
  // What a run has not completed.
  WriteModel(dir + "/.hidden", GetParam(), 4);
  EXPECT_THAT(FindModels(dir), testing::ElementsAre(first, second));
  EXPECT_THAT(FindModels(first), testing::ElementsAre(first));
  EXPECT_EQ(FindLargestModel(dir), second);
  EXPECT_EQ(FindLargestModel(first), first);
}

INSTANTIATE_TEST_SUITE_P(Forms, ModelIo, testing::Bool(), [](const auto& form) {
  return form.param ? "Binary" : "Text";
});

TEST(ModelIoText, NamesWithSpacesAndLinesWithoutPointsAreRead) {
  const std::string folder = CreateTestDir();
  std::ofstream(folder + "/images.txt")
      << "# comment\n\n"
      << "1 2 0 0 0 1 2 3 7 a folder/b.jpg\r\n\r\n"
      << "2 1 0 0 0 1 2 3 7 c.jpg";
  const auto images = ReadModelImages(folder);
  ASSERT_EQ(images.size(), 2);
  EXPECT_EQ(images.at("a folder/b.jpg").camera_id, 7);
  EXPECT_EQ(images.at("a folder/b.jpg").cam_from_world.rotation.w(), 1);
  EXPECT_EQ(images.count("c.jpg"), 1);
}

TEST(ModelIoText, MalformedLinesAreReportedWithTheirNumber) {
  const std::string folder = CreateTestDir();
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"1 1 0 0 0 1 2 3 7\n", "without name (line 1)"},
      {"\n1 1 0 0 zero 1 2 3 7 a\n", "malformed (line 2)"},
      {"1 0 0 0 0 1 2 3 7 a\n", "invalid pose (line 1)"},
      {"1 1 0 0 0 1 1e200 3 7 a\n", "invalid pose (line 1)"},
      {"1 1 0 0 0 1 2 3 7 a\n\n2 1 0 0 0 1 2 3 7 a\n", "twice (line 3)"}};
  for (const auto& [text, problem] : cases) {
    std::ofstream(folder + "/images.txt") << text;
    ExpectError([&folder = folder] { ReadModelImages(folder); }, problem);
  }
  std::ofstream(folder + "/cameras.txt") << "1 EUCM 8 6 1 2 3 4 5 6\n";
  ExpectError([&] { ReadModelCameras(folder); }, "camera model");
  std::ofstream(folder + "/cameras.txt") << "1 PINHOLE 2147483648 6 1 1 3 3\n";
  ExpectError([&] { ReadModelCameras(folder); }, "2147483648 x 6 (line 1)");
  std::ofstream(folder + "/cameras.txt") << "1 PINHOLE 8 0 1 1 3 3\n";
  ExpectError([&] { ReadModelCameras(folder); }, "8 x 0 (line 1)");
}

TEST(ModelIoBinary, CountsBeyondTheFileAllocateNothing) {
  const std::string folder = CreateTestDir();
  for (const char* name : {"images", "points3D", "cameras"}) {
    std::ofstream(folder + "/" + name + ".bin") << std::string(16, '\xff');
  }
  ExpectError([&] { ReadModelImages(folder); }, "images.bin is truncated");
  ExpectError([&] { ReadModelPoints(folder); }, "points3D.bin is truncated");
  ExpectError([&] { ReadModelCameras(folder); }, "cameras.bin is truncated");
}

}  // namespace
}  // namespace dgsfm
