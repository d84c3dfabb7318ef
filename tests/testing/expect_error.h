#pragma once

#include "tests/testing/test_dir.h"

#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dgsfm {

// Expects a std::runtime_error whose message has all these parts.
template <typename Function>
void ExpectError(const Function& function,
                 const std::vector<std::string>& parts) {
  try {
    function();
    ADD_FAILURE() << "accepted, expected: " << parts.front();
  } catch (const std::runtime_error& error) {
    for (const std::string& part : parts) {
      EXPECT_THAT(error.what(), testing::HasSubstr(part));
    }
  }
}

template <typename Function>
void ExpectError(const Function& function, const std::string& part) {
  ExpectError(function, std::vector<std::string>{part});
}

// The same, and that the file is as it was.
template <typename Function>
void ExpectErrorAndNoChange(const std::string& path,
                            const Function& function,
                            const std::vector<std::string>& parts) {
  const std::string before = FileContent(path);
  ExpectError(function, parts);
  EXPECT_EQ(FileContent(path), before);
}

}  // namespace dgsfm
