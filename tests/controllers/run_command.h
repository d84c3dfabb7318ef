#pragma once

#include "controllers/commands.h"

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

}  // namespace dgsfm
