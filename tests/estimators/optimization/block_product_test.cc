#include "estimators/optimization/block_product.h"

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

template <int kSize, int kRank>
void ExpectProducts() {
  using Factor = Eigen::Matrix<double, kSize, kRank>;
  using Block = Eigen::Matrix<double, kSize, kSize>;
  const Factor left = Factor::Random();
  const Factor right = Factor::Random();
  const Block start = Block::Random();
  Block block = start;
  // Rounding of a few additions of numbers below one.
  constexpr double kTolerance = 1e-15;
  BlockProduct<1, kSize, kRank>::Add(left, right, &block);
  EXPECT_LE((block - start - left * right.transpose()).cwiseAbs().maxCoeff(),
            kTolerance);
  block = start;
  BlockProduct<-1, kSize, kRank>::Add(left, right, &block);
  EXPECT_LE((block - start + left * right.transpose()).cwiseAbs().maxCoeff(),
            kTolerance);
}

TEST(BlockProduct, EqualsEigensOfAnySize) {
  ExpectProducts<3, 3>();
  ExpectProducts<8, 2>();
  ExpectProducts<10, 2>();
  ExpectProducts<14, 2>();
  ExpectProducts<18, 2>();
}

}  // namespace
}  // namespace dgsfm
