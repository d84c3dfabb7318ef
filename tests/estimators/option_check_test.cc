#include "estimators/option_check.h"

#include <limits>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

struct InnerOptions {
  double scale = 1;
  bool IsValid(std::string* error) const {
    return OptionBounds(error).Above("scale", scale, 0).AreKept();
  }
};

struct Options {
  int count = 3;
  double share = 0.5;
  InnerOptions inner;
  bool IsValid(std::string* error) const {
    return OptionBounds(error)
        .AtLeast("count", count, 1)
        .Within("share", share, 0, 1)
        .Valid(inner)
        .AreKept();
  }
};

TEST(OptionBounds, NamesTheFirstFault) {
  Options options;
  std::string error;
  EXPECT_TRUE(options.IsValid(&error));
  EXPECT_EQ(error, "");
  options.inner.scale = 0;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "scale must be > 0, but is 0");
  options.share = 1.5;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "share must be in [0, 1], but is 1.5");
  options.count = 0;
  EXPECT_FALSE(options.IsValid(&error));
  EXPECT_EQ(error, "count must be >= 1, but is 0");
}

TEST(OptionBounds, NanIsOutOfAllBounds) {
  Options options;
  options.share = std::numeric_limits<double>::quiet_NaN();
  std::string error;
  EXPECT_FALSE(options.IsValid(&error));
  options = Options();
  options.inner.scale = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(options.IsValid(&error));
}

}  // namespace
}  // namespace dgsfm
