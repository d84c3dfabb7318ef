#include "colmap_ext/progress.h"

#include <algorithm>
#include <thread>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

// Test output is captured in a file, so these see the plain lines.
TEST(Progress, PrintsTenLinesFromManyThreads) {
  testing::internal::CaptureStderr();
  {
    Progress progress("Work", 400, 400, /*line_interval_s=*/0);
    std::vector<std::thread> threads;
    for (int i = 0; i < 4; ++i) {
      threads.emplace_back([&progress] {
        for (int j = 0; j < 100; ++j) progress.Step();
      });
    }
    for (std::thread& thread : threads) thread.join();
  }
  const std::string text = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 10) << text;
  EXPECT_NE(text.find("Work: 400/400"), std::string::npos) << text;
}

TEST(Progress, FewAndNoItemsAreFine) {
  testing::internal::CaptureStderr();
  {
    Progress none("None", 0, 0, /*line_interval_s=*/0);
    none.Step();
    Progress three("Three", 3, 3, /*line_interval_s=*/0);
    for (int i = 0; i < 5; ++i) three.Step();
  }
  const std::string text = testing::internal::GetCapturedStderr();
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 3) << text;
}

TEST(Progress, ShortWorkPrintsNothing) {
  testing::internal::CaptureStderr();
  {
    Progress progress("Work", 100);
    for (int i = 0; i < 100; ++i) progress.Step();
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(IterationProgress, EstimatesTheStepsThatAreLeft) {
  std::vector<std::pair<size_t, size_t>> shown;
  const ProgressScope scope(
      [&](const std::string&, size_t num_done, size_t total) {
        shown.emplace_back(num_done, total);
      });
  IterationProgress progress(
      "Work", /*tolerance=*/1.1e-5, /*max_num_steps=*/20);
  progress.Step(1e-1);
  progress.Step(1e-2);
  progress.Step();
  progress.Step(1e-3);
  progress.Step(9e-6);
  // A tenth of the decrease each time: three steps after the second.
  EXPECT_EQ(shown,
            (std::vector<std::pair<size_t, size_t>>{
                {1, 20}, {2, 5}, {3, 20}, {4, 6}, {5, 6}}));
  IterationProgress silent("", 1e-5, 20);
  silent.Step(1);
  EXPECT_EQ(shown.size(), 5);
}

TEST(Progress, GoesToTheListenerOfItsThread) {
  std::vector<size_t> done;
  testing::internal::CaptureStderr();
  {
    const ProgressScope scope(
        [&](const std::string& label, size_t num_done, size_t total) {
          EXPECT_EQ(label, "Work");
          EXPECT_EQ(total, 3);
          done.push_back(num_done);
        });
    Progress progress("Work", 3);
    std::thread([&progress] { progress.Step(); }).join();
    progress.Step();
    progress.Step();
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(done, (std::vector<size_t>{1, 2, 3}));
}

}  // namespace
}  // namespace dgsfm
