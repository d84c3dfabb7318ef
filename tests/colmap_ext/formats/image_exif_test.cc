#include "colmap_ext/formats/image_exif.h"

#include "tests/testing/expect_error.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include <FreeImage.h>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Little-endian numbers.
std::string Bytes(uint32_t value, int size) {
  std::string bytes;
  for (int i = 0; i < size; ++i) bytes += char(value >> (8 * i) & 255);
  return bytes;
}

// A directory of TIFF tags at some offset, and the texts that follow it.
class TagDirectory {
 public:
  void AddShort(int tag, int value) { Add(tag, 3, 1, Bytes(value, 4)); }
  void AddLong(int tag, uint32_t value) { Add(tag, 4, 1, Bytes(value, 4)); }
  void AddText(int tag, std::string text) {
    text += '\0';
    text.resize(std::max<size_t>(text.size(), 5));
    texts_.push_back({entries_.size(), text});
    Add(tag, 2, uint32_t(text.size()), "");
  }

  size_t Size() const {
    size_t size = 2 + 12 * entries_.size() + 4;
    for (const auto& [entry, text] : texts_) size += text.size();
    return size;
  }

  std::string At(uint32_t offset) const {
    std::string directory = Bytes(uint32_t(entries_.size()), 2);
    std::string content;
    uint32_t next = offset + uint32_t(2 + 12 * entries_.size() + 4);
    std::vector<std::string> entries = entries_;
    for (const auto& [entry, text] : texts_) {
      entries[entry] += Bytes(next, 4);
      next += uint32_t(text.size());
      content += text;
    }
    for (const std::string& entry : entries) directory += entry;
    return directory + Bytes(0, 4) + content;
  }

 private:
  void Add(int tag, int type, uint32_t count, const std::string& value) {
    entries_.push_back(Bytes(tag, 2) + Bytes(type, 2) + Bytes(count, 4) +
                       value);
  }

  std::vector<std::string> entries_;
  std::vector<std::pair<size_t, std::string>> texts_;
};

class ReadImageExifTest : public testing::Test {
 protected:
  ReadImageExifTest()
      : path_((fs::path(CreateTestDir()) / "exif.jpg").string()) {
    FIBITMAP* bitmap = FreeImage_Allocate(40, 30, 24);
    FreeImage_Save(FIF_JPEG, bitmap, path_.c_str());
    FreeImage_Unload(bitmap);
  }

  // Make, model and the focal length on film, EXIF 2.3, as cameras write them.
  void AddExif() const {
    TagDirectory exif;
    exif.AddShort(0xa405, 28);
    TagDirectory main;
    main.AddText(0x010f, "Maker");
    main.AddText(0x0110, "Model 7");
    main.AddLong(0x8769, 0);
    const auto exif_offset = uint32_t(8 + main.Size());
    TagDirectory complete;
    complete.AddText(0x010f, "Maker");
    complete.AddText(0x0110, "Model 7");
    complete.AddLong(0x8769, exif_offset);
    const std::string tiff = std::string("II*\0", 4) + Bytes(8, 4) +
                             complete.At(8) + exif.At(exif_offset);
    const std::string segment = std::string("Exif\0\0", 6) + tiff;
    const size_t length = segment.size() + 2;
    std::ifstream file(path_, std::ios::binary);
    std::string bytes{std::istreambuf_iterator<char>(file), {}};
    bytes.insert(2,
                 std::string("\xff\xe1") + char(length >> 8) +
                     char(length & 255) + segment);
    std::ofstream(path_, std::ios::binary) << bytes;
  }

  const std::string path_;
};

TEST_F(ReadImageExifTest, CameraAndFocalLength) {
  AddExif();
  const ImageExif exif = ReadImageExif(path_);
  EXPECT_EQ(exif.camera, "Maker|Model 7||");
  // The diagonal of 36 mm x 24 mm film, to the digits that are given.
  EXPECT_NEAR(exif.focal_length_ratio, 28 / 43.2666, 1e-9);
}

TEST_F(ReadImageExifTest, PhotosWithoutItAreEmpty) {
  const ImageExif exif = ReadImageExif(path_);
  EXPECT_EQ(exif.camera, "");
  EXPECT_EQ(exif.focal_length_ratio, 0);
}

TEST_F(ReadImageExifTest, NamesFilesThatAreNoImages) {
  ExpectError([&] { ReadImageExif(path_ + ".missing"); }, path_ + ".missing");
}

}  // namespace
}  // namespace dgsfm
