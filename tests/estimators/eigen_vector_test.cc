// A header of COLMAP once specialised std::vector for these types where it was
// included: files with and without it then shared memory of two allocators.

#include <colmap/util/alignment.h>

#include <type_traits>
#include <vector>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace dgsfm {
namespace {

template <typename T>
bool IsPlainVector() {
  return std::is_same_v<typename std::vector<T>::allocator_type,
                        std::allocator<T>>;
}

TEST(EigenVector, HasOneDefinitionInEveryFile) {
  EXPECT_TRUE(IsPlainVector<Eigen::Quaterniond>());
  EXPECT_TRUE(IsPlainVector<Eigen::Vector2d>());
  EXPECT_TRUE(IsPlainVector<Eigen::Matrix4d>());
}

}  // namespace
}  // namespace dgsfm
