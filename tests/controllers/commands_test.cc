#include "controllers/commands.h"

#include <new>
#include <stdexcept>

#include <gtest/gtest.h>

namespace dgsfm {
namespace {

TEST(RunCommand, PassesResultAndTranslatesExceptions) {
  const auto run = [](int (*function)(int, char**)) {
    testing::internal::CaptureStderr();
    const int code = RunCommand({"name", "Summary.", function}, 0, nullptr);
    return std::make_pair(code, testing::internal::GetCapturedStderr());
  };
  using Result = std::pair<int, std::string>;
  EXPECT_EQ(run([](int, char**) { return 2; }), Result(2, ""));
  EXPECT_EQ(run([](int, char**) -> int { throw std::runtime_error("bad x"); }),
            Result(1, "ERROR: bad x\n"));
  EXPECT_EQ(run([](int, char**) -> int { throw std::bad_alloc(); }),
            Result(1, "ERROR: out of memory\n"));
}

}  // namespace
}  // namespace dgsfm
