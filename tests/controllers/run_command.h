#pragma once

#include "controllers/commands/commands.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace dgsfm {

struct CommandResult {
  int code = 0;
  std::string out;
  std::string err;
};

// Runs a command of this process as RunCommand does.
inline CommandResult RunForTest(int (*run)(int, char**),
                                std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "colmap");
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  CommandResult result;
  result.code = RunCommand(
      {"command", "", run}, static_cast<int>(argv.size()), argv.data());
  result.out = testing::internal::GetCapturedStdout();
  result.err = testing::internal::GetCapturedStderr();
  return result;
}

// The database of a synthetic scene of observations in `dir`.
inline std::string SynthesizeDatabase(const std::string& dir,
                                      const std::vector<std::string>& options) {
  std::vector<std::string> arguments = {
      "--output_path", dir + "/scene", "--database_only", "1"};
  arguments.insert(arguments.end(), options.begin(), options.end());
  EXPECT_EQ(RunForTest(&RunDepthSceneSynthesizer, arguments).code, 0);
  return dir + "/scene/database.db";
}

}  // namespace dgsfm
