#include "colmap_ext/depth/depth_map_io.h"

#include "tests/testing/npz_file.h"
#include "tests/testing/test_dir.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <tiffio.h>
#include <zlib.h>

namespace dgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;
using namespace std::string_literals;

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

colmap::Camera CreateCamera(size_t width, size_t height) {
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_PINHOLE", 100, width, height);
  return camera;
}

class DepthMapIo : public testing::Test {
 protected:
  void SetUp() override { dir_ = CreateTestDir(); }

  std::string Path(const std::string& name) const { return dir_ + "/" + name; }

  std::string Write(const std::string& name, const std::string& bytes) const {
    std::ofstream(Path(name), std::ios::binary) << bytes;
    return Path(name);
  }

  std::string WriteNpz(const std::string& name,
                       const std::string& array_name,
                       const std::string& bytes,
                       int method) const {
    AddToNpz(Path(name), array_name, bytes, method);
    return Path(name);
  }

  // Expects an error that names the file and contains `reason`.
  void ExpectError(const std::string& path,
                   const std::string& reason,
                   const colmap::Camera& camera = CreateCamera(30, 20)) const {
    try {
      ReadDepthMap(path, camera, {});
      ADD_FAILURE() << path << " accepted, expected: " << reason;
    } catch (const std::runtime_error& error) {
      EXPECT_THAT(error.what(), HasSubstr(path));
      EXPECT_THAT(error.what(), HasSubstr(reason));
    }
  }

  std::string dir_;
  int num_files_ = 0;
};

template <typename T>
std::string Bytes(const std::vector<T>& values, bool is_big_endian = false) {
  std::string bytes;
  for (const T& value : values) {
    std::string number(sizeof(T), '\0');
    std::memcpy(number.data(), &value, sizeof(T));
    if (is_big_endian) number = {number.rbegin(), number.rend()};
    bytes += number;
  }
  return bytes;
}

std::string Npy(const std::string& type,
                const std::string& order,
                const std::string& shape,
                const std::string& data) {
  std::string text = "{'descr': '" + type + "', 'fortran_order': " + order +
                     ", 'shape': " + shape + ", }";
  text.resize(117, ' ');
  return "\x93NUMPY\x01\x00\x76\x00"s + text + "\n" + data;
}

std::string PngChunk(const std::string& content) {
  const uint32_t size = content.size() - 4;
  const uint32_t crc =
      crc32(0, reinterpret_cast<const Bytef*>(content.data()), content.size());
  return Bytes<uint32_t>({size}, true) + content + Bytes<uint32_t>({crc}, true);
}

// `rows` each begin with their filter type.
std::string Png(uint32_t width,
                uint32_t height,
                char bit_depth,
                char color_type,
                const std::string& rows) {
  std::string data(compressBound(rows.size()), '\0');
  uLongf data_size = data.size();
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(data.data()),
                     &data_size,
                     reinterpret_cast<const Bytef*>(rows.data()),
                     rows.size()),
            Z_OK);
  data.resize(data_size);
  return "\x89PNG\r\n\x1a\n" +
         PngChunk("IHDR" + Bytes<uint32_t>({width, height}, true) + bit_depth +
                  color_type + std::string(3, '\0')) +
         PngChunk("IDAT" + data) + PngChunk("IEND");
}

const std::vector<float> kValues = {1, 2, 3, 4, 5, 6};
const std::string kNpy2x3 = Npy("<f4", "False", "(2, 3)", Bytes(kValues));

std::vector<float> ReadValues(const std::string& path,
                              const DepthReadOptions& options = {}) {
  const DepthMap depth_map = ReadDepthMap(path, CreateCamera(30, 20), options);
  EXPECT_EQ(depth_map.width, 3);
  EXPECT_EQ(depth_map.height, 2);
  return depth_map.values;
}

TEST_F(DepthMapIo, ReadsNpyOfEveryType) {
  const auto expect = [&](const std::string& type, const std::string& data) {
    const std::string path = Write("a.npy", Npy(type, "False", "(2, 3)", data));
    EXPECT_EQ(ReadValues(path), kValues) << type;
  };
  const std::vector<uint16_t> halfs = {
      0x3c00, 0x4000, 0x4200, 0x4400, 0x4500, 0x4600};
  const std::vector<double> doubles(kValues.begin(), kValues.end());
  const std::vector<uint8_t> u1(kValues.begin(), kValues.end());
  const std::vector<uint16_t> u2(kValues.begin(), kValues.end());
  const std::vector<int32_t> i4(kValues.begin(), kValues.end());
  const std::vector<uint64_t> u8(kValues.begin(), kValues.end());
  expect("<f2", Bytes(halfs));
  expect(">f2", Bytes(halfs, true));
  expect("<f4", Bytes(kValues));
  expect(">f4", Bytes(kValues, true));
  expect("<f8", Bytes(doubles));
  expect(">f8", Bytes(doubles, true));
  expect("|u1", Bytes(u1));
  expect("|i1", Bytes(u1));
  expect(">u2", Bytes(u2, true));
  expect("<i2", Bytes(u2));
  expect("<i4", Bytes(i4));
  expect("<u4", Bytes(i4));
  expect(">i8", Bytes(u8, true));
  expect("<u8", Bytes(u8));
}

TEST_F(DepthMapIo, ReadsNpyOfEveryLayout) {
  const std::string transposed = Bytes<float>({1, 4, 2, 5, 3, 6});
  for (const std::string shape :
       {"(2, 3)", "(2, 3, 1)", "(1, 2, 3)", "(1,1,2,3)", "( 2 ,3,)"}) {
    EXPECT_EQ(
        ReadValues(Write("a.npy", Npy("<f4", "False", shape, Bytes(kValues)))),
        kValues)
        << shape;
    EXPECT_EQ(ReadValues(Write("a.npy", Npy("<f4", "True", shape, transposed))),
              kValues)
        << shape;
  }
}

TEST_F(DepthMapIo, ReadsNpyVersionTwo) {
  std::string bytes = kNpy2x3;
  bytes[6] = 2;
  bytes.insert(10, 2, '\0');
  EXPECT_EQ(ReadValues(Write("a.npy", bytes)), kValues);
}

TEST_F(DepthMapIo, RefusesWrongNpy) {
  const auto expect = [&](const std::string& bytes, const std::string& reason) {
    ExpectError(Write("a.npy", bytes), reason);
  };
  const std::string data = Bytes(kValues);
  expect("", "not a NumPy array");
  expect("no numpy at all", "not a NumPy array");
  expect("\x93NUMPY\x04\x00\x76\x00 more"s, "version 4");
  expect(kNpy2x3.substr(0, 50), "truncated");
  expect(Npy("<c8", "False", "(2, 3)", data), "'c8' are not supported");
  expect(Npy("<f16", "False", "(2, 3)", data), "'f16' are not supported");
  expect(Npy("O", "False", "(2, 3)", data), "not plain numbers");
  expect(Npy("<f4", "Maybe", "(2, 3)", data), "fortran_order");
  expect(Npy("<f4", "False", "(2, x)", data), "shape");
  expect(Npy("<f4", "False", "(2, -3)", data), "shape");
  expect(Npy("<f4", "False", "(2, 3", data), "shape");
  expect(Npy("<f4", "False", "2, 3)", data), "shape");
  expect(Npy("<f4", "False", "(9999999999999999999999, 3)", data), "shape");
  expect(Npy("<f4", "False", "(6,)", data), "1 dimensions");
  expect(Npy("<f4", "False", "(1, 2, 3, 2)", data + data), "3 dimensions");
  expect(Npy("<f4", "False", "(0, 3)", ""), "3 x 0");
  expect(Npy("|u1", "False", "(1, 16385)", std::string(16385, 1)), "16385 x 1");
  expect(Npy("<f4", "False", "(16384, 16384)", data), "24 bytes of data");
  expect(Npy("<f4", "False", "(99999999, 99999999)", data), "larger than");
  expect(kNpy2x3 + "x", "25 bytes of data instead of the 24 of 3 x 2");
  expect("\x93NUMPY\x01\x00\x76\x00"s + std::string(118, ' '), "without descr");
}

TEST_F(DepthMapIo, EveryTruncationIsAnError) {
  const std::string pfm = "Pf\n3 2\n-1.0\n" + Bytes(kValues);
  for (size_t size = 0; size < kNpy2x3.size(); ++size) {
    ExpectError(Write("a.npy", kNpy2x3.substr(0, size)), "");
  }
  for (size_t size = 0; size < pfm.size(); ++size) {
    ExpectError(Write("a.pfm", pfm.substr(0, size)), "");
  }
  const DepthMap depth_map = {3, 2, DepthUnit::METRIC, kValues};
  WriteDepthPng(Path("whole.png"), depth_map, 1);
  const std::string png = FileContent(Path("whole.png"));
  for (size_t size = 0; size < png.size(); ++size) {
    ExpectError(Write("a.png", png.substr(0, size)), "");
  }
  WriteNpz("whole.npz", "depth.npy", kNpy2x3, ZIP_CM_DEFLATE);
  const std::string npz = FileContent(Path("whole.npz"));
  for (size_t size = 0; size < npz.size(); ++size) {
    ExpectError(Write("a.npz", npz.substr(0, size)), "");
  }
}

TEST_F(DepthMapIo, ReadsFocalLengthOfTheDepthModel) {
  const auto focal_of = [&](const std::vector<float>& values,
                            const std::string& shape = "(3, 3)",
                            int orientation = 1) {
    const std::string name = std::to_string(num_files_++) + ".npz";
    WriteNpz(name, "depth.npy", kNpy2x3, ZIP_CM_DEFLATE);
    WriteNpz(name,
             "intrinsics.npy",
             Npy("<f4", "False", shape, Bytes(values)),
             ZIP_CM_DEFLATE);
    DepthFile file;
    file.path = Path(name);
    file.orientation = orientation;
    const colmap::Camera camera =
        orientation == 1 ? CreateCamera(300, 200) : CreateCamera(200, 300);
    return ReadDepth(file, camera, {}).focal_length_px;
  };
  // In units of the size: 0.5 (0.75 x 300 + 1.25 x 200).
  const std::vector<float> normalized = {
      0.75f, 0, 0.5f, 0, 1.25f, 0.5f, 0, 0, 1};
  EXPECT_DOUBLE_EQ(focal_of(normalized), 237.5);
  // The model saw the 200 x 300 image turned.
  EXPECT_DOUBLE_EQ(focal_of(normalized, "(3, 3)", 6), 237.5);
  // In pixels of the 3 x 2 map, which are 100 of the image.
  EXPECT_DOUBLE_EQ(focal_of({2.5f, 0, 1.5f, 0, 2.5f, 1, 0, 0, 1}), 250);
  EXPECT_DOUBLE_EQ(focal_of({2.5f, 1.5f, 1}, "(3,)"), 250);
  // In pixels of the image.
  EXPECT_DOUBLE_EQ(focal_of({260, 0, 155, 0, 240, 90, 0, 0, 1}), 250);
  EXPECT_DOUBLE_EQ(focal_of({260, 0, 155, 0, 240, 90, 0, 0, 1}, "(3, 3)", 6),
                   250);
  EXPECT_THROW(focal_of({260, 0, 15, 0, 240, 9, 0, 0, 1}), std::runtime_error);
  EXPECT_EQ(focal_of({1, 0, 0, 0, 1, 0, 0, 0, 1}), 0);
  EXPECT_THROW(focal_of({-2, 0, 0.5f, 0, 1, 0.5f, 0, 0, 1}),
               std::runtime_error);
  EXPECT_THROW(focal_of({kNaN, 0, 0.5f, 0, 1, 0.5f, 0, 0, 1}),
               std::runtime_error);
  EXPECT_THROW(focal_of(kValues, "(2, 3)"), std::runtime_error);
}

TEST_F(DepthMapIo, ReadsPointsAndExcludesPixels) {
  // z of 2 x 3 points.
  const std::vector<float> points = {
      9, 9, 1, 9, 9, 2, 9, 9, 3, 9, 9, 4, 9, 9, 5, 9, 9, 6};
  const auto add = [&](const std::string& name,
                       const std::string& type,
                       const std::string& shape,
                       const std::string& data) {
    WriteNpz("a.npz", name, Npy(type, "False", shape, data), ZIP_CM_STORE);
  };
  add("points.npy", "<f4", "(2, 3, 3)", Bytes(points));
  EXPECT_EQ(ReadValues(Path("a.npz")), kValues);
  add("mask.npy", "|b1", "(2, 3)", "\0\1\1\1\1\1"s);
  add("conf.npy", "<f4", "(2, 3)", Bytes<float>({1, 0, 0.25f, 1, kNaN, 1}));
  add("uncertainty.npy", "<f4", "(2, 3)", Bytes<float>({1, 1, 1, 2, 1, 1}));
  EXPECT_THAT(ReadValues(Path("a.npz")), ElementsAre(0, 0, 3, 4, 0, 6));
  DepthReadOptions options;
  options.min_confidence = 0.5;
  options.max_uncertainty = 1.5;
  EXPECT_THAT(ReadValues(Path("a.npz"), options),
              ElementsAre(0, 0, 0, 0, 0, 6));
  options = {};
  options.max_depth = 3;
  EXPECT_THAT(ReadValues(Path("a.npz"), options),
              ElementsAre(0, 0, 3, 0, 0, 0));
  WriteNpz("b.npz", "depth.npy", kNpy2x3, ZIP_CM_STORE);
  WriteNpz("b.npz",
           "mask.npy",
           Npy("|b1", "False", "(1, 3)", "\1\1\1"s),
           ZIP_CM_STORE);
  ExpectError(Path("b.npz"), "the mask is 3 x 1 but the depth map 3 x 2");
  WriteNpz("c.npz",
           "points.npy",
           Npy("<f4", "False", "(2, 3)", Bytes(kValues)),
           ZIP_CM_STORE);
  ExpectError(Path("c.npz"), "not height x width x 3");
}

TEST_F(DepthMapIo, ReadsConfidenceOfItsOwnFile) {
  DepthFile file;
  file.path = Write("a.npy", kNpy2x3);
  file.confidence_path =
      Write("c.png", Png(3, 2, 8, PNG_COLOR_TYPE_GRAY, "\0\0\1\2\0\2\2\2"s));
  DepthReadOptions options;
  EXPECT_THAT(ReadDepth(file, CreateCamera(30, 20), options).depth_map.values,
              ElementsAre(0, 2, 3, 4, 5, 6));
  options.min_confidence = 2;
  EXPECT_THAT(ReadDepth(file, CreateCamera(30, 20), options).depth_map.values,
              ElementsAre(0, 0, 3, 4, 5, 6));
  file.confidence_path = Write("c.png", "nonsense");
  EXPECT_THAT([&] { ReadDepth(file, CreateCamera(30, 20), options); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("a.npy"), HasSubstr("c.png"))));
}

TEST_F(DepthMapIo, LowConfidenceExcludes) {
  // The left half is wrong, as the depth model noticed.
  const DepthMap map = {20, 10, DepthUnit::METRIC, std::vector<float>(200, 5)};
  std::vector<float> confidences;
  std::vector<float> uncertainties;
  for (int i = 0; i < 200; ++i) {
    confidences.push_back(i % 20 < 10 ? 0.05f : 0.9f);
    uncertainties.push_back(i % 20 < 10 ? 3 : 0.1f);
  }
  const auto name_arrays = [&](const std::string& name,
                               const std::vector<float>& values) {
    DepthFile file;
    file.path = "memory";
    file.arrays =
        [=](const std::string& asked) -> std::optional<internal::NumberArray> {
      if (asked == "depth") return internal::NumberArray{{10, 20}, map.values};
      if (asked == name) return internal::NumberArray{{10, 20}, values};
      return std::nullopt;
    };
    return file;
  };
  for (const DepthFile& file : {name_arrays("confidence", confidences),
                                name_arrays("uncertainty", uncertainties)}) {
    DepthReadOptions options;
    const DepthMap read =
        ReadDepth(file, CreateCamera(200, 100), options).depth_map;
    for (int x = 0; x < 20; ++x) EXPECT_EQ(read.At(x, 5), x < 10 ? 0 : 5);
    options.min_relative_confidence = 0;
    EXPECT_EQ(ReadDepth(file, CreateCamera(200, 100), options).coverage, 1);
    options.min_relative_confidence = 0.01;
    EXPECT_EQ(ReadDepth(file, CreateCamera(200, 100), options).coverage, 1);
  }
}

TEST_F(DepthMapIo, TurnsMapsOfDisplayedImagesBack) {
  // The stored image has 3 x 2 pixels 1 to 6, so what a viewer shows of it
  // follows from the definition of the tag.
  const std::map<int, std::vector<float>> displayed = {
      {1, {1, 2, 3, 4, 5, 6}},   // as stored
      {2, {3, 2, 1, 6, 5, 4}},   // mirrored
      {3, {6, 5, 4, 3, 2, 1}},   // turned by 180 degrees
      {4, {4, 5, 6, 1, 2, 3}},   // upside down
      {5, {1, 4, 2, 5, 3, 6}},   // transposed, 2 x 3
      {6, {4, 1, 5, 2, 6, 3}},   // turned clockwise
      {7, {6, 3, 5, 2, 4, 1}},   // transposed along the other diagonal
      {8, {3, 6, 2, 5, 1, 4}}};  // turned counterclockwise
  for (const auto& [orientation, values] : displayed) {
    DepthFile file;
    file.path = Path("a.npy");
    file.orientation = orientation;
    const DepthMap map = orientation < 5
                             ? DepthMap{3, 2, DepthUnit::METRIC, values}
                             : DepthMap{2, 3, DepthUnit::METRIC, values};
    WriteDepthNpy(file.path, map, NpyPrecision::SINGLE);
    const ImportedDepth depth = ReadDepth(file, CreateCamera(30, 20), {});
    EXPECT_EQ(depth.depth_map.width, 3);
    EXPECT_EQ(depth.depth_map.values, kValues) << orientation;
  }
}

TEST_F(DepthMapIo, RefusesWrongDenseMaps) {
  const auto expect = [&](const std::string& bytes, const std::string& reason) {
    ExpectError(Write("a.bin", bytes), reason);
  };
  expect("", "not a map of COLMAP's dense stereo");
  expect("3&2", "not a map of COLMAP's dense stereo");
  expect("3&2&3&", "3 channels");
  expect("-3&2&1&", "size '-3'");
  expect("0&2&1&", "0 x 2");
  expect("3&2&1&" + Bytes<float>({1}), "4 bytes of data instead of the 24");
  WriteDepthDenseBin(Path("b.bin"), {3, 2, DepthUnit::METRIC, kValues});
  EXPECT_EQ(FileContent(Path("b.bin")), "3&2&1&" + Bytes(kValues));
  EXPECT_EQ(ReadValues(Path("b.bin")), kValues);
}

TEST_F(DepthMapIo, RoundTripsExr) {
  WriteDepthExr(Path("a.exr"), {3, 2, DepthUnit::METRIC, kValues});
  EXPECT_EQ(ReadValues(Path("a.exr")), kValues);
  WriteDepthExr(Path("b.exr"),
                {3, 2, DepthUnit::METRIC, {1e10, 1, 1, 1, 1, 1}});
  EXPECT_EQ(ReadValues(Path("b.exr"))[0], 0);
  EXPECT_THROW(
      WriteDepthExr(Path("missing/a.exr"), {1, 1, DepthUnit::METRIC, {1}}),
      std::runtime_error);
}

TEST_F(DepthMapIo, ReadsTiffOfTilesAndStrips) {
  for (const bool is_tiled : {false, true}) {
    for (const int bits : {8, 16, 32}) {
      TIFF* tiff = TIFFOpen(Path("a.tif").c_str(), "w");
      ASSERT_NE(tiff, nullptr);
      TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 40);
      TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 20);
      TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, bits);
      TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, 1);
      TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_LZW);
      const int size = is_tiled ? 16 : 40;
      const int num_rows = is_tiled ? 16 : 7;
      if (is_tiled) {
        TIFFSetField(tiff, TIFFTAG_TILEWIDTH, size);
        TIFFSetField(tiff, TIFFTAG_TILELENGTH, size);
      } else {
        TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, num_rows);
      }
      // Value 5 x + y + 1 at (x, y), little endian.
      for (int y0 = 0; y0 < 20; y0 += num_rows) {
        for (int x0 = 0; x0 < 40; x0 += size) {
          const int rows = is_tiled ? num_rows : std::min(num_rows, 20 - y0);
          std::string block(rows * size * bits / 8, '\0');
          for (int i = 0; i < rows * size; ++i) {
            block[i * bits / 8] = 5 * (x0 + i % size) + y0 + i / size + 1;
          }
          const int idx = is_tiled ? TIFFComputeTile(tiff, x0, y0, 0, 0)
                                   : TIFFComputeStrip(tiff, y0, 0);
          ASSERT_EQ(is_tiled ? TIFFWriteEncodedTile(
                                   tiff, idx, block.data(), block.size())
                             : TIFFWriteEncodedStrip(
                                   tiff, idx, block.data(), block.size()),
                    block.size());
        }
      }
      TIFFClose(tiff);
      const DepthMap map =
          ReadDepthMap(Path("a.tif"), CreateCamera(40, 20), {});
      ASSERT_EQ(map.values.size(), 800);
      for (int i = 0; i < 800; ++i) {
        ASSERT_EQ(map.values[i], 5 * (i % 40) + i / 40 + 1) << i;
      }
    }
  }
  ExpectError(Write("b.tif", "nonsense"), "TIFF");
}

TEST_F(DepthMapIo, DamagedBytesNeverCrash) {
  WriteNpz("whole.npz", "depth.npy", kNpy2x3, ZIP_CM_DEFLATE);
  WriteDepthPng(Path("whole.png"), {3, 2, DepthUnit::METRIC, kValues}, 0.001);
  std::ofstream(Path("whole.npy"), std::ios::binary) << kNpy2x3;
  std::ofstream(Path("whole.pfm"), std::ios::binary)
      << "Pf\n3 2\n-1.0\n" + Bytes(kValues);
  const DepthMap depth_map = {3, 2, DepthUnit::METRIC, kValues};
  WriteDepthExr(Path("whole.exr"), depth_map);
  WriteDepthDenseBin(Path("whole.bin"), depth_map);
  for (const std::string& extension : DepthFileExtensions()) {
    const std::string whole = FileContent(Path("whole" + extension));
    for (size_t i = 0; i < whole.size(); ++i) {
      for (const char flip : {'\x01', '\x80', '\xff'}) {
        std::string bytes = whole;
        bytes[i] ^= flip;
        try {
          ReadDepthMap(Write("a" + extension, bytes), CreateCamera(30, 20), {});
        } catch (const std::runtime_error& error) {
          EXPECT_THAT(error.what(), HasSubstr("a" + extension));
        }
      }
    }
  }
}

// 301 bytes that claim 755 MB, in the size of the compressed data too.
TEST_F(DepthMapIo, RefusesWhatTheFuzzerFound) {
  ExpectError(DGSFM_SOURCE_DIR "/tests/fuzz/findings/huge_sizes.npz",
              "impossible size");
}

TEST_F(DepthMapIo, ReadsNpzStoredAndDeflated) {
  for (const int method : {ZIP_CM_STORE, ZIP_CM_DEFLATE}) {
    const std::string path =
        WriteNpz(std::to_string(method) + ".npz", "depth.npy", kNpy2x3, method);
    EXPECT_EQ(ReadValues(path), kValues);
  }
}

TEST_F(DepthMapIo, RefusesWrongNpz) {
  ExpectError(WriteNpz("key.npz", "disparity.npy", kNpy2x3, ZIP_CM_STORE),
              "no array named depth or points");
  ExpectError(WriteNpz("array.npz", "depth.npy", "nonsense", ZIP_CM_STORE),
              "not a NumPy array");
  ExpectError(Write("archive.npz", "nonsense"), "no NumPy archive");
  ExpectError(Path("missing.npz"), "No such file");
}

TEST_F(DepthMapIo, ReadsPfmOfBothByteOrdersFromTheBottom) {
  const std::vector<float> from_bottom = {4, 5, 6, 1, 2, 3};
  EXPECT_EQ(ReadValues(Write("a.pfm", "Pf\n3 2\n-1.0\n" + Bytes(from_bottom))),
            kValues);
  EXPECT_EQ(
      ReadValues(Write("a.pfm", "Pf 3 2 0.5\n" + Bytes(from_bottom, true))),
      kValues);
}

TEST_F(DepthMapIo, RefusesWrongPfm) {
  const auto expect = [&](const std::string& header,
                          const std::string& reason) {
    ExpectError(Write("a.pfm", header + Bytes(kValues)), reason);
  };
  expect("PF\n3 2\n-1\n", "three channels");
  expect("P5\n3 2\n-1\n", "not a PFM");
  expect("Pf\n3 x\n-1\n", "size 'x'");
  expect("Pf\n-3 2\n-1\n", "size '-3'");
  expect("Pf\n9999999999 2\n-1\n", "size '9999999999'");
  expect("Pf\n3 2\nnan\n", "scale 'nan'");
  expect("Pf\n3 2\n0\n", "scale '0'");
  expect("Pf\n0 2\n-1\n", "0 x 2");
  expect("Pf\n16385 2\n-1\n", "16385 x 2");
  expect("Pf\n3 3\n-1\n", "24 bytes of data instead of the 36 of 3 x 3");
}

TEST_F(DepthMapIo, RoundTripsPng16WithScale) {
  DepthReadOptions options;
  options.scale = 0.001;
  DepthMap depth_map = {3, 2, DepthUnit::METRIC, {1, 0.0004, 70, 0, 4, 65.534}};
  WriteDepthPng(Path("a.png"), depth_map, options.scale);
  // At least one step; what has no step is unknown, not nearer than it is.
  EXPECT_THAT(ReadValues(Path("a.png"), options),
              testing::Pointwise(testing::FloatEq(),
                                 {1.f, 0.001f, 0.f, 0.f, 4.f, 65.534f}));
}

TEST_F(DepthMapIo, ReadsPngOfSixteenBits) {
  // Big endian; 0 and 65535 are unknown.
  const std::string rows =
      "\0\x01\x02\0\x07\0\0"
      "\0\xff\xff\xff\xfe\0\x01"s;
  EXPECT_THAT(
      ReadValues(Write("a.png", Png(3, 2, 16, PNG_COLOR_TYPE_GRAY, rows))),
      ElementsAre(258, 7, 0, 0, 65534, 1));
}

TEST_F(DepthMapIo, RefusesWrongPng) {
  const auto expect = [&](const std::string& bytes, const std::string& reason) {
    ExpectError(Write("a.png", bytes), reason);
  };
  expect("nonsense", "PNG");
  expect(Png(3, 1, 8, PNG_COLOR_TYPE_GRAY, "\0\1\2\3"s),
         "PNG of 8 bits and 1 channels");
  expect(Png(1, 1, 16, PNG_COLOR_TYPE_RGB, std::string(7, '\0')),
         "PNG of 16 bits and 3 channels");
  expect(Png(1, 1, 16, PNG_COLOR_TYPE_GRAY_ALPHA, std::string(5, '\0')),
         "PNG of 16 bits and 2 channels");
  expect(Png(16384, 16384, 16, PNG_COLOR_TYPE_GRAY, "\0\1"s), "truncated");
  expect(Png(16385, 1, 16, PNG_COLOR_TYPE_GRAY, "\0\1"s), "PNG");
  expect(Png(3, 2, 16, PNG_COLOR_TYPE_GRAY, "\0\1"s), "PNG");
  std::string bytes = Png(1, 1, 16, PNG_COLOR_TYPE_GRAY, "\0\1\2"s);
  bytes[bytes.size() - 15] ^= 1;  // checksum of the pixels
  expect(bytes, "CRC");
}

TEST_F(DepthMapIo, NumbersThatAreNoDepthAreUnknown) {
  const std::string path =
      Write("a.npy",
            Npy("<f4",
                "False",
                "(2, 3)",
                Bytes<float>({kNaN, kInf, -kInf, 0, -1, 7})));
  EXPECT_THAT(ReadValues(path), ElementsAre(0, 0, 0, 0, 0, 7));
  const std::string overflow =
      Write("b.npy",
            Npy("<f8",
                "False",
                "(2, 3)",
                Bytes<double>({1e300, -1e300, 1e-300, 1, 2, 3})));
  EXPECT_THAT(ReadValues(overflow), ElementsAre(0, 0, 0, 1, 2, 3));
}

TEST_F(DepthMapIo, InvertsInverseDepth) {
  const std::string path = Write(
      "a.npy",
      Npy("<f4", "False", "(2, 3)", Bytes<float>({0.5, 4, 0, -2, kInf, kNaN})));
  DepthReadOptions options;
  options.type = DepthType::INVERSE;
  EXPECT_THAT(ReadValues(path, options), ElementsAre(2, 0.25, 0, 0, 0, 0));
  options.scale = 10;
  EXPECT_THAT(ReadValues(path, options), ElementsAre(20, 2.5, 0, 0, 0, 0));
}

TEST_F(DepthMapIo, ConvertsRangeAlongTheRays) {
  // Plane z = 5 seen by a distorted camera through a map of a tenth of the
  // image's size.
  colmap::Camera camera;
  camera.InitializeWithName("SIMPLE_RADIAL", 250, 300, 200);
  camera.Params(3) = 0.1;
  std::vector<float> ranges;
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 30; ++x) {
      const Eigen::Vector2d x_norm =
          camera.ImageToWorld({10 * x + 5.0, 10 * y + 5.0});
      ranges.push_back(5 * x_norm.homogeneous().norm());
    }
  }
  const std::string path =
      Write("a.npy", Npy("<f4", "False", "(20, 30)", Bytes(ranges)));
  DepthReadOptions options;
  options.type = DepthType::RANGE;
  options.unit = DepthUnit::RELATIVE;
  const DepthMap depth_map = ReadDepthMap(path, camera, options);
  EXPECT_EQ(depth_map.unit, DepthUnit::RELATIVE);
  // Single precision.
  EXPECT_THAT(depth_map.values, testing::Each(testing::FloatNear(5, 1e-5)));
}

TEST_F(DepthMapIo, RefusesMapsThatKnowNothing) {
  for (const float value : {0.f, -1.f, kNaN, kInf}) {
    const std::string path = Write(
        "a.npy",
        Npy("<f4", "False", "(2, 3)", Bytes(std::vector<float>(6, value))));
    ExpectError(path, "no pixel of the 3 x 2 depth map");
  }
}

TEST_F(DepthMapIo, RefusesTurnedMapsOnly) {
  const auto write = [&](int width, int height) {
    DepthMap depth_map = {width, height, DepthUnit::METRIC, {}};
    depth_map.values.assign(width * height, 1.0f);
    WriteDepthNpy(Path("a.npy"), depth_map, NpyPrecision::HALF);
    return Path("a.npy");
  };
  ExpectError(write(100, 150),
              "depth map is 100 x 150 but the image 1500 x 1000",
              CreateCamera(1500, 1000));
  // Rounding of the sides: 66.7 x 100.
  ExpectError(write(67, 100), "turned", CreateCamera(1500, 1000));
  // Any other aspect may be a network's input.
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{
           {64, 48}, {128, 128}, {150, 100}, {3, 2}, {1, 1}}) {
    EXPECT_NO_THROW(
        ReadDepthMap(write(width, height), CreateCamera(1500, 1000), {}));
  }
  ExpectError(write(48, 64),
              "depth map is 48 x 64 but the image 1500 x 1000: width to height "
              "differs by the factor 2, more than max_aspect_factor, 1.5",
              CreateCamera(1500, 1000));
  DepthReadOptions options;
  options.max_aspect_factor = 2;
  EXPECT_NO_THROW(
      ReadDepthMap(write(48, 64), CreateCamera(1500, 1000), options));
  // Nearly square images cannot tell.
  EXPECT_NO_THROW(ReadDepthMap(write(99, 100), CreateCamera(1000, 990), {}));
}

TEST_F(DepthMapIo, RefusesUnreadableFiles) {
  ExpectError(Path("missing.npy"), "No such file");
  ExpectError(Path("missing.png"), "No such file");
  ExpectError(Write("a.jpg", "x"), "'.jpg' is no known depth format");
  ExpectError(Write("a.exr", "x"), "EXR");
  ExpectError(Path("missing.h5"), "HDF5");
  std::filesystem::create_directory(Path("folder.npy"));
  ExpectError(Path("folder.npy"), "directory");
}

TEST_F(DepthMapIo, RefusesInvalidOptions) {
  DepthReadOptions options;
  options.scale = -1;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "scale is -1 but must be positive and finite");
  const std::string path = Write("a.npy", kNpy2x3);
  EXPECT_THROW(ReadDepthMap(path, CreateCamera(30, 20), options),
               std::invalid_argument);
  options.scale = kNaN;
  EXPECT_FALSE(options.IsValid(nullptr));
}

TEST_F(DepthMapIo, WritesNpyThatItReads) {
  const DepthMap depth_map = {
      3, 2, DepthUnit::METRIC, {0, 1.5, 2, 3, 4, 65504}};
  for (const auto precision : {NpyPrecision::HALF, NpyPrecision::SINGLE}) {
    WriteDepthNpy(Path("a.npy"), depth_map, precision);
    EXPECT_EQ(ReadValues(Path("a.npy")), depth_map.values);
  }
  EXPECT_THROW(
      WriteDepthNpy(Path("missing/a.npy"), depth_map, NpyPrecision::SINGLE),
      std::runtime_error);
  EXPECT_THROW(WriteDepthPng(Path("missing/a.png"), depth_map, 1),
               std::runtime_error);
}

// NumPy's own files, where NumPy is installed.
TEST_F(DepthMapIo, AgreesWithNumPy) {
  const std::string script = R"(
import sys
import numpy as np
a = np.arange(1, 7).reshape(2, 3)
d = sys.argv[1] + '/'
names = []
for t in ['<f2', '>f2', '<f4', '>f4', '<f8', '>f8', 'u1', '<u2', '>i4']:
    for order in 'CF':
        name = d + 'n' + t[-2:] + ('b' if t[0] == '>' else 'l') + order + '.npy'
        np.save(name, np.array(a, dtype=t, order=order))
np.savez(d + 'stored.npz', depth=a.astype('f4'), other=a)
np.savez_compressed(d + 'deflated.npz', other=a, depth=a.astype('f2'))
)";
  const std::string command = DGSFM_PYTHON " " + Write("write.py", script) +
                              " " + dir_ + " 2>/dev/null";
  if (std::system(command.c_str()) != 0) GTEST_SKIP() << "no Python with NumPy";
  size_t num_files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(dir_)) {
    if (entry.path().extension() == ".py") continue;
    EXPECT_EQ(ReadValues(entry.path()), kValues) << entry.path();
    ++num_files;
  }
  EXPECT_EQ(num_files, 20);
  WriteDepthNpy(Path("ours.npy"), {3, 2, {}, kValues}, NpyPrecision::HALF);
  const std::string check = R"(
import sys
import numpy as np
a = np.load(sys.argv[1])
assert a.dtype == np.float16 and (a == np.arange(1, 7).reshape(2, 3)).all()
)";
  EXPECT_EQ(std::system((DGSFM_PYTHON " " + Write("check.py", check) + " " +
                         Path("ours.npy"))
                            .c_str()),
            0);
}

}  // namespace
}  // namespace dgsfm
