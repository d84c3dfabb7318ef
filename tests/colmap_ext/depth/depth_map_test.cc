#include "colmap_ext/depth/depth_map.h"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

namespace dgsfm {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr double kInf = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

DepthMap CreateMap(int width, int height, std::vector<float> values) {
  return {width, height, DepthUnit::METRIC, std::move(values)};
}

float SampleOne(const DepthMap& depth_map,
                double u,
                double v,
                int image_width,
                int image_height,
                const DepthSamplingOptions& options = {}) {
  return SampleDepth(depth_map, {{u, v}}, image_width, image_height, options)
      .at(0);
}

DepthMap RoundTrip(const DepthMap& depth_map) {
  return DecompressDepth(CompressDepth(depth_map));
}

TEST(DepthMap, CoverageIsShareOfKnownPixels) {
  EXPECT_EQ(CreateMap(2, 2, {0, 1, 2, 0}).Coverage(), 0.5);
  EXPECT_EQ(CreateMap(1, 1, {0}).Coverage(), 0);
  EXPECT_EQ(DepthMap().Coverage(), 0);
}

TEST(SampleDepth, PixelCentresGiveTheirOwnValue) {
  const DepthMap depth_map = CreateMap(3, 2, {1, 2, 3, 4, 5, 6});
  for (int y = 0; y < 2; ++y) {
    for (int x = 0; x < 3; ++x) {
      EXPECT_EQ(SampleOne(depth_map, x + 0.5, y + 0.5, 3, 2),
                depth_map.At(x, y));
    }
  }
}

TEST(SampleDepth, InterpolatesLinearlyInLogDepth) {
  DepthSamplingOptions options;
  options.max_neighbor_ratio = 100;
  const DepthMap depth_map = CreateMap(2, 2, {1, 2, 4, 8});
  // Bilinear in log depth: log2 is x + 2 y from the first pixel's centre.
  // Tolerance: single precision.
  for (const double x : {0.0, 0.25, 0.7, 1.0}) {
    for (const double y : {0.0, 0.1, 0.5, 1.0}) {
      EXPECT_NEAR(SampleOne(depth_map, x + 0.5, y + 0.5, 2, 2, options),
                  std::exp2(x + 2 * y),
                  1e-6 * std::exp2(x + 2 * y));
    }
  }
}

TEST(SampleDepth, MapCoversImageOfOtherSizeAndAspect) {
  // A 4 x 1 map of a 400 x 300 image: centres at u = 50, 150, 250, 350.
  const DepthMap depth_map = CreateMap(4, 1, {1.00, 1.02, 1.04, 1.06});
  EXPECT_FLOAT_EQ(SampleOne(depth_map, 150, 7, 400, 300), 1.02);
  EXPECT_FLOAT_EQ(SampleOne(depth_map, 200, 299, 400, 300),
                  std::sqrt(1.02 * 1.04));
}

TEST(SampleDepth, BorderPixelsExtendToImageBorderAndNotBeyond) {
  const DepthMap depth_map = CreateMap(2, 1, {1.0, 1.05});
  EXPECT_EQ(SampleOne(depth_map, 0, 0, 20, 10), 1.0f);
  EXPECT_EQ(SampleOne(depth_map, 20, 10, 20, 10), 1.05f);
  EXPECT_EQ(SampleOne(depth_map, -0.001, 5, 20, 10), 0);
  EXPECT_EQ(SampleOne(depth_map, 20.001, 5, 20, 10), 0);
  EXPECT_EQ(SampleOne(depth_map, 10, -0.001, 20, 10), 0);
  EXPECT_EQ(SampleOne(depth_map, 10, 10.001, 20, 10), 0);
  EXPECT_EQ(SampleOne(depth_map, kNaN, 5, 20, 10), 0);
  EXPECT_EQ(SampleOne(depth_map, 5, kInf, 20, 10), 0);
}

TEST(SampleDepth, UnknownNeighboursAreLeftOut) {
  const DepthMap depth_map = CreateMap(2, 2, {0, 1.0, 0, 1.05});
  // The right column alone, half way between its pixels.
  EXPECT_FLOAT_EQ(SampleOne(depth_map, 0.9, 1, 2, 2), std::sqrt(1.05));
  EXPECT_EQ(SampleOne(depth_map, 0.5, 1, 2, 2), 0);
  EXPECT_EQ(SampleOne(CreateMap(2, 2, {0, 0, 0, 0}), 1, 1, 2, 2), 0);
}

TEST(SampleDepth, DepthEdgesTakeNearestNeighbourOrNothing) {
  const DepthMap depth_map = CreateMap(2, 1, {1.0, 2.0});
  DepthSamplingOptions options;
  EXPECT_EQ(SampleOne(depth_map, 0.9, 0.5, 2, 1, options), 1);
  EXPECT_EQ(SampleOne(depth_map, 1.1, 0.5, 2, 1, options), 2);
  options.keep_edges = false;
  EXPECT_EQ(SampleOne(depth_map, 0.9, 0.5, 2, 1, options), 0);
  // A pixel of weight zero makes no edge.
  EXPECT_EQ(SampleOne(depth_map, 0.5, 0.5, 2, 1, options), 1);
  options.max_neighbor_ratio = 2;
  EXPECT_FLOAT_EQ(SampleOne(depth_map, 1, 0.5, 2, 1, options), std::sqrt(2));
}

TEST(SampleDepth, RefusesBrokenContracts) {
  const DepthMap depth_map = CreateMap(1, 1, {1});
  EXPECT_THROW(SampleOne(CreateMap(2, 1, {1}), 0, 0, 1, 1),
               std::invalid_argument);
  EXPECT_THROW(SampleOne(DepthMap(), 0, 0, 1, 1), std::invalid_argument);
  EXPECT_THROW(SampleOne(depth_map, 0, 0, 0, 1), std::invalid_argument);
  DepthSamplingOptions options;
  options.max_neighbor_ratio = 0.9;
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "max_neighbor_ratio is 0.9 but must be at least 1");
  EXPECT_THROW(SampleOne(depth_map, 0, 0, 1, 1, options),
               std::invalid_argument);
}

TEST(CompressDepth, RoundTripsHalfFloatsExactly) {
  DepthMap depth_map =
      CreateMap(3, 2, {0, 1, 1.5, 1234, 65504, std::ldexp(1.0f, -24)});
  depth_map.unit = DepthUnit::RELATIVE;
  const DepthMap result = RoundTrip(depth_map);
  EXPECT_EQ(result.width, 3);
  EXPECT_EQ(result.height, 2);
  EXPECT_EQ(result.unit, DepthUnit::RELATIVE);
  EXPECT_EQ(result.values, depth_map.values);
}

TEST(CompressDepth, RoundsWithinHalfPrecision) {
  DepthMap depth_map = CreateMap(64, 64, {});
  for (int i = 0; i < 64 * 64; ++i) {
    depth_map.values.push_back(0.01f * std::exp(0.003f * i));
  }
  const DepthMap result = RoundTrip(depth_map);
  for (int i = 0; i < 64 * 64; ++i) {
    // Half floats have 11 significant bits: half a unit of the last is 2^-11.
    EXPECT_NEAR(result.values[i] / depth_map.values[i], 1, std::exp2(-11));
  }
}

TEST(CompressDepth, SaturatesInsteadOfLosingKnownDepth) {
  const std::vector<float> values =
      RoundTrip(CreateMap(4, 1, {65519, 65536, 1e30f, 1e-30f})).values;
  EXPECT_THAT(values, ElementsAre(65504, 65504, 65504, std::ldexp(1.0f, -24)));
}

TEST(CompressDepth, BytesAreAsDocumented) {
  // Half bits 0x3c00 (1), 0x3c01 (1 + 2^-10), 0x3c00: differences 0x3c00, 1,
  // -1, codes 0x7800, 2, 1; low bytes, then high bytes.
  const std::vector<uint8_t> blob =
      CompressDepth(CreateMap(3, 1, {1, 1 + std::ldexp(1.0f, -10), 1})).bytes;
  std::vector<uint8_t> bytes(100);
  uLongf num_bytes = bytes.size();
  ASSERT_EQ(uncompress(bytes.data(), &num_bytes, blob.data(), blob.size()),
            Z_OK);
  bytes.resize(num_bytes);
  EXPECT_THAT(bytes, ElementsAre(0, 2, 1, 0x78, 0, 0));
}

TEST(CompressDepth, RefusesDepthThatIsNoDepth) {
  for (const double value : {-1.0, kInf, kNaN}) {
    EXPECT_THROW(CompressDepth(CreateMap(1, 1, {static_cast<float>(value)})),
                 std::invalid_argument);
  }
  EXPECT_THROW(CompressDepth(CreateMap(2, 1, {1})), std::invalid_argument);
  EXPECT_THROW(CompressDepth(DepthMap()), std::invalid_argument);
}

TEST(CompressDepth, RoundsAsHalfFloatsDo) {
  // Every half of one octave with its neighbours in single precision, the ties
  // between two halfs included, then the ends of the range.
  std::vector<float> values = {0, 6.1035156e-5f, 65504, 65503.996f};
  for (int i = 0; i < 1024; ++i) {
    for (const float step : {0.f, 0.25f, 0.5f, 0.75f}) {
      values.push_back((1024 + i + step) / 512);
    }
  }
  const int size = static_cast<int>(values.size());
  const DepthMap map =
      DecompressDepth(CompressDepth(CreateMap(size, 1, values)));
  for (int i = 0; i < size; ++i) {
    EXPECT_EQ(map.values[i], static_cast<float>(Eigen::half(values[i])));
  }
}

void ExpectDamaged(const std::vector<uint8_t>& blob,
                   int width,
                   int height,
                   const std::string& reason) {
  try {
    DecompressDepth({width, height, DepthUnit::METRIC, blob});
    ADD_FAILURE() << "accepted, expected: " << reason;
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr(reason));
  }
}

TEST(DecompressDepth, RefusesDamagedBlobs) {
  const std::vector<uint8_t> blob =
      CompressDepth(CreateMap(2, 2, {1, 2, 3, 4})).bytes;
  ExpectDamaged({}, 2, 2, "2 x 2");
  ExpectDamaged({1, 2, 3}, 2, 2, "damaged");
  ExpectDamaged(blob, 3, 2, "too few values");
  ExpectDamaged(blob, 2, 1, "too many values");
  ExpectDamaged(blob, 0, 2, "size");
  ExpectDamaged(blob, 2, -2, "size");
  ExpectDamaged(blob, 16385, 2, "size");
  ExpectDamaged(blob, 16384, 16384, "too little data");
  std::vector<uint8_t> longer = blob;
  longer.push_back(0);
  ExpectDamaged(longer, 2, 2, "after its end");
  for (size_t size = 0; size < blob.size(); ++size) {
    ExpectDamaged({blob.begin(), blob.begin() + size}, 2, 2, "damaged");
  }
  for (size_t i = 0; i < blob.size(); ++i) {
    std::vector<uint8_t> damaged = blob;
    damaged[i] ^= 0x55;
    ExpectDamaged(damaged, 2, 2, "2 x 2");
  }
}

TEST(DecompressDepth, RefusesValuesThatAreNoDepth) {
  // -1 is 0xbc00, infinity 0x7c00, as the codes of a single value.
  for (const uint16_t code : {0x87ff, 0xf800}) {
    const std::vector<uint8_t> bytes = {uint8_t(code & 0xff),
                                        uint8_t(code >> 8)};
    std::vector<uint8_t> blob(100);
    uLongf size = blob.size();
    ASSERT_EQ(compress(blob.data(), &size, bytes.data(), bytes.size()), Z_OK);
    blob.resize(size);
    ExpectDamaged(blob, 1, 1, "negative or not finite");
  }
}

}  // namespace
}  // namespace dgsfm
