#include "controllers/report/thumbnails.h"

#include "tests/testing/test_dir.h"

#include <colmap/util/bitmap.h>

#include <memory>
#include <numeric>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// A picture of which every pixel differs from its neighbours.
void WriteImage(const std::string& path, int width, int height) {
  colmap::Bitmap bitmap;
  bitmap.Allocate(width, height, true);
  uint32_t state = 1;
  for (int x = 0; x < width; ++x) {
    for (int y = 0; y < height; ++y) {
      state = 1664525 * state + 1013904223;
      bitmap.SetPixel(
          x, y, colmap::BitmapColor<uint8_t>(state >> 24, state >> 16, x));
    }
  }
  ASSERT_TRUE(bitmap.Write(path));
}

// Width and height of a JPEG file in memory; zero if it is none.
std::pair<int, int> SizeOf(std::string jpeg) {
  const std::unique_ptr<FIMEMORY, decltype(&FreeImage_CloseMemory)> memory(
      FreeImage_OpenMemory(reinterpret_cast<BYTE*>(jpeg.data()), jpeg.size()),
      &FreeImage_CloseMemory);
  FIBITMAP* bitmap = FreeImage_LoadFromMemory(FIF_JPEG, memory.get(), 0);
  if (bitmap == nullptr) return {0, 0};
  const std::pair<int, int> size(FreeImage_GetWidth(bitmap),
                                 FreeImage_GetHeight(bitmap));
  FreeImage_Unload(bitmap);
  return size;
}

TEST(Thumbnails, AreSmallPicturesOfAnyFormat) {
  const std::string folder = CreateTestDir();
  WriteImage(folder + "/a.jpg", 640, 480);
  WriteImage(folder + "/b.png", 300, 900);
  WriteImage(folder + "/c.png", 20, 10);
  const std::vector<std::string> thumbnails =
      MakeThumbnails(folder, {"a.jpg", "b.png", "c.png"}, 1000000, 2);
  ASSERT_EQ(thumbnails.size(), 3);
  EXPECT_EQ(SizeOf(thumbnails[0]), std::make_pair(320, 240));
  EXPECT_EQ(SizeOf(thumbnails[1]), std::make_pair(107, 320));
  EXPECT_EQ(SizeOf(thumbnails[2]), std::make_pair(20, 10));
}

TEST(Thumbnails, StayWithinTheirBudgetForAnyNumberOfThreads) {
  const std::string folder = CreateTestDir();
  std::vector<std::string> names;
  for (int i = 0; i < 8; ++i) {
    names.push_back(std::to_string(i) + ".png");
    WriteImage(folder + "/" + names.back(), 200, 150);
  }
  constexpr size_t kMaxNumBytes = 20000;
  const auto thumbnails = MakeThumbnails(folder, names, kMaxNumBytes, 3);
  size_t num_bytes = 0;
  for (const std::string& thumbnail : thumbnails) {
    num_bytes += thumbnail.size();
  }
  EXPECT_FALSE(thumbnails[0].empty());
  EXPECT_LE(num_bytes, kMaxNumBytes);
  EXPECT_EQ(MakeThumbnails(folder, names, kMaxNumBytes, 1), thumbnails);
}

TEST(Thumbnails, AreEmptyOfUnreadableImages) {
  const std::string folder = CreateTestDir();
  WriteImage(folder + "/b.png", 40, 30);
  const auto thumbnails =
      MakeThumbnails(folder, {"missing.jpg", "../b.png", "b.png"}, 100000, 1);
  EXPECT_TRUE(thumbnails[0].empty());
  EXPECT_TRUE(thumbnails[1].empty());
  EXPECT_FALSE(thumbnails[2].empty());
}

// Browsers would turn the picture, and the place is nobody's business.
TEST(Thumbnails, HaveNoExifData) {
  const std::string folder = CreateTestDir();
  const std::string path = folder + "/a.jpg";
  WriteImage(path, 64, 48);
  std::string jpeg = FileContent(path);
  // An APP1 segment with an orientation of 6 behind the start of the image.
  const char kExif[] =
      "\xff\xe1\x00\x22"
      "Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
  jpeg.insert(2, std::string(kExif, sizeof(kExif) - 1));
  FILE* file = fopen(path.c_str(), "wb");
  fwrite(jpeg.data(), 1, jpeg.size(), file);
  fclose(file);
  const std::string thumbnail = MakeThumbnails(folder, {"a.jpg"}, 100000, 1)[0];
  EXPECT_EQ(SizeOf(thumbnail), std::make_pair(64, 48));
  EXPECT_EQ(thumbnail.find("Exif"), std::string::npos);
}

}  // namespace
}  // namespace dgsfm
