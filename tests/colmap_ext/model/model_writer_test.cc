#include "colmap_ext/model/model_writer.h"

#include "tests/testing/expect_error.h"
#include "tests/testing/file_size_limit.h"
#include "tests/testing/ring_model.h"
#include "tests/testing/test_dir.h"

#include <limits>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(WriteModel, WritesWhatColmapReads) {
  const std::string dir = CreateTestDir();
  const colmap::Reconstruction model = CreateRingModel(5);
  WriteModel(model, dir);
  colmap::Reconstruction read;
  read.ReadBinary(dir);
  EXPECT_EQ(read.NumRegImages(), model.NumRegImages());
  EXPECT_EQ(read.NumPoints3D(), model.NumPoints3D());
  for (const auto& [id, image] : model.Images()) {
    EXPECT_EQ(read.Image(id).Name(), image.Name());
    EXPECT_EQ(read.Image(id).Tvec(), image.Tvec());
    ASSERT_EQ(read.Image(id).NumPoints2D(), image.NumPoints2D());
    for (size_t i = 0; i < image.NumPoints2D(); ++i) {
      EXPECT_EQ(read.Image(id).Point2D(i).XY(), image.Point2D(i).XY());
      EXPECT_EQ(read.Image(id).Point2D(i).Point3DId(),
                image.Point2D(i).Point3DId());
    }
  }
  for (const auto& [id, point] : model.Points3D()) {
    EXPECT_EQ(read.Point3D(id).XYZ(), point.XYZ());
    EXPECT_EQ(read.Point3D(id).Color(), point.Color());
    EXPECT_EQ(read.Point3D(id).Track().Length(), point.Track().Length());
  }
}

TEST(WriteModel, NamesTheFileThatDoesNotFit) {
  const std::string dir = CreateTestDir();
  // The cameras fit, the images do not.
  const FileSizeLimit limit(200);
  ExpectError([&] { WriteModel(CreateRingModel(5), dir); },
              dir + "/images.bin");
}

TEST(WriteModel, RefusesNumbersThatAreNotFinite) {
  const std::string dir = CreateTestDir();
  colmap::Reconstruction model = CreateRingModel(5);
  const colmap::image_t image_id = model.RegImageIds().front();
  model.Image(image_id).Tvec(1) = std::numeric_limits<double>::quiet_NaN();
  ExpectError([&] { WriteModel(model, dir); },
              "image " + model.Image(image_id).Name());
}

}  // namespace
}  // namespace dgsfm
