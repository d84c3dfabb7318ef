#include "colmap_ext/parallel.h"

#include "colmap_ext/cancellation.h"

#include <atomic>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(ParallelFor, CallsEachItemOnce) {
  for (const int num_threads : {-1, 1, 2, 7}) {
    std::vector<std::atomic<int>> calls(1000);
    ParallelFor(calls.size(), num_threads, [&](size_t i) { ++calls[i]; });
    for (const std::atomic<int>& count : calls) EXPECT_EQ(count, 1);
  }
}

TEST(ParallelFor, OneThreadKeepsTheOrder) {
  std::vector<size_t> order;
  ParallelFor(5, 1, [&](size_t i) { order.push_back(i); });
  EXPECT_EQ(order, (std::vector<size_t>{0, 1, 2, 3, 4}));
}

TEST(ParallelFor, NoItemsMeanNoCalls) {
  ParallelFor(0, 4, [](size_t) { FAIL(); });
}

TEST(ParallelFor, RethrowsAfterAllThreadsHaveStopped) {
  for (const int num_threads : {1, 3}) {
    std::atomic<int> num_running = 0;
    EXPECT_THROW(ParallelFor(100,
                             num_threads,
                             [&](size_t i) {
                               ++num_running;
                               if (i == 10) {
                                 --num_running;
                                 throw std::runtime_error("item 10");
                               }
                               --num_running;
                             }),
                 std::runtime_error);
    EXPECT_EQ(num_running, 0);
  }
}

TEST(ParallelFor, EndsWhenCancelled) {
  for (const int num_threads : {1, 3}) {
    CancellationFlag flag(false);
    const CancellationScope scope(&flag);
    std::atomic<int> num_calls = 0;
    EXPECT_THROW(ParallelFor(1000,
                             num_threads,
                             [&](size_t i) {
                               ++num_calls;
                               if (i == 10) flag = true;
                             }),
                 Cancelled);
    EXPECT_GT(num_calls, 10);
    EXPECT_LT(num_calls, 1000);
  }
}

TEST(ParallelFor, ThreadsTakeTheFlagOfTheirCaller) {
  CancellationFlag flag(false);
  const CancellationScope scope(&flag);
  ParallelFor(
      10, 3, [&](size_t) { EXPECT_EQ(CurrentCancellationFlag(), &flag); });
  std::thread([] { EXPECT_EQ(CurrentCancellationFlag(), nullptr); }).join();
}

TEST(CancellationScope, Nests) {
  CancellationFlag set(true);
  const CancellationScope outer(&set);
  EXPECT_THROW(ThrowIfCancelled(), Cancelled);
  {
    const CancellationScope inner(nullptr);
    ThrowIfCancelled();
  }
  EXPECT_THROW(ThrowIfCancelled(), Cancelled);
}

TEST(EffectiveNumThreads, IsPositive) {
  EXPECT_EQ(EffectiveNumThreads(3), 3);
  EXPECT_GE(EffectiveNumThreads(-1), 1);
}

}  // namespace
}  // namespace dgsfm
