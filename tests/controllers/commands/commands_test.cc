#include "controllers/commands/commands.h"

#include <cstdlib>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <sys/wait.h>

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

TEST(RunCommand, OptionsOutOfTheirBoundsAreWrongUsage) {
  std::vector<std::string> arguments = {"colmap",
                                        "--database_path=missing.db",
                                        "--output_path=missing",
                                        "--max_num_tracks=-1"};
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  testing::internal::CaptureStderr();
  EXPECT_EQ(RunCommand(*FindCommand("depth_global_mapper"),
                       static_cast<int>(argv.size()),
                       argv.data()),
            2);
  EXPECT_EQ(testing::internal::GetCapturedStderr(),
            "ERROR: max_num_tracks must be >= 0, but is -1\n"
            "See: colmap depth_global_mapper --help\n");
}

TEST(RunCommand, FullOrClosedStandardOutputIsAnError) {
  for (const std::string arguments : {"help", "model_renderer --help"}) {
    const std::string command =
        DGSFM_COLMAP_MAIN " " + arguments + " 2>/dev/null >";
    EXPECT_EQ(std::system((command + "/dev/null").c_str()), 0);
    EXPECT_EQ(WEXITSTATUS(std::system((command + "/dev/full").c_str())), 1);
    EXPECT_EQ(WEXITSTATUS(std::system((command + "&-").c_str())), 1);
  }
}

}  // namespace
}  // namespace dgsfm
