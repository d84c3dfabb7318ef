#include "estimators/optimization/column_order.h"

#include <algorithm>
#include <numeric>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

constexpr int kNumCameras = 50;
constexpr int kSize = 3;

// A chain of cameras in which a point is seen by neighbours. Each camera has
// two columns of its own, and all share the first.
class ColumnOrderOfChain : public testing::Test {
 protected:
  ColumnOrderOfChain() {
    index_.num_cameras = kNumCameras;
    index_.num_points = kNumCameras - 1;
    for (int i = 0; i + 1 < kNumCameras; ++i) {
      index_.cameras.insert(index_.cameras.end(), {i, i + 1});
      index_.points.insert(index_.points.end(), {i, i});
    }
    for (int i = 0; i < kNumCameras; ++i) {
      columns_.insert(columns_.end(), {1 + 2 * i, 0, 2 + 2 * i});
    }
  }

  ColumnOrder Order() const {
    return OrderColumns(ObservationBlocks(index_, PointRanges(index_)),
                        columns_,
                        kSize,
                        kNumColumns);
  }

  static constexpr int kNumColumns = 1 + 2 * kNumCameras;
  ObservationIndex index_;
  std::vector<int> columns_;
};

TEST_F(ColumnOrderOfChain, HasEachColumnOnce) {
  std::vector<int> columns = Order().columns;
  std::sort(columns.begin(), columns.end());
  std::vector<int> expected(kNumColumns);
  std::iota(expected.begin(), expected.end(), 0);
  EXPECT_EQ(columns, expected);
}

TEST_F(ColumnOrderOfChain, KeepsColumnsOfACameraTogether) {
  const std::vector<int> columns = Order().columns;
  for (size_t i = 0; i + 1 < columns.size(); ++i) {
    // Odd columns are the first of a camera.
    if (columns[i] % 2 == 1) {
      EXPECT_EQ(columns[i + 1], columns[i] + 1);
    }
  }
}

TEST_F(ColumnOrderOfChain, FactorIsThatOfAChain) {
  const ColumnOrder order = Order();
  // A camera is coupled to itself, the next and the shared column: about three
  // blocks of two by two columns. Cholesky orders chains without fill.
  EXPECT_NEAR(order.num_factor_entries, 3 * 4 * kNumCameras, 20);
  // Squares of the three blocks of a column, times the columns of a block.
  EXPECT_NEAR(order.num_operations, 9 * 8 * kNumCameras, 200);
}

TEST_F(ColumnOrderOfChain, ConstantCamerasHaveNoColumns) {
  std::fill(columns_.begin(), columns_.begin() + kSize, -1);
  // Its columns, now of no camera, are still ordered.
  EXPECT_EQ(Order().columns.size(), size_t(kNumColumns));
}

}  // namespace
}  // namespace dgsfm
