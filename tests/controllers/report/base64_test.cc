#include "controllers/report/base64.h"

#include <cstdint>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// The vectors of RFC 4648, section 10.
TEST(Base64, FollowsTheStandard) {
  EXPECT_EQ(ToBase64(""), "");
  EXPECT_EQ(ToBase64("f"), "Zg==");
  EXPECT_EQ(ToBase64("fo"), "Zm8=");
  EXPECT_EQ(ToBase64("foo"), "Zm9v");
  EXPECT_EQ(ToBase64("foob"), "Zm9vYg==");
  EXPECT_EQ(ToBase64("fooba"), "Zm9vYmE=");
  EXPECT_EQ(ToBase64("foobar"), "Zm9vYmFy");
}

TEST(Base64, NumbersAreLittleEndian) {
  EXPECT_EQ(ToBase64(std::vector<uint32_t>()), "");
  EXPECT_EQ(ToBase64(std::vector<uint32_t>{0xff010203}), "AwIB/w==");
}

}  // namespace
}  // namespace dgsfm
