#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>

#include <gtest/gtest.h>

namespace dgsfm {

namespace fs = std::filesystem;

std::string CreateTestDir() {
  const testing::TestInfo* info =
      testing::UnitTest::GetInstance()->current_test_info();
  std::string name = std::string(info->test_suite_name()) + "." + info->name();
  for (char& c : name) {
    if (c == '/') c = '_';
  }
  // Two clones that run their tests at once must not share it.
  const size_t clone = std::hash<std::string>()(DGSFM_SOURCE_DIR);
  const fs::path dir = fs::path(testing::TempDir()) /
                       ("dgsfm_tests_" + std::to_string(clone)) / name;
  fs::remove_all(dir);
  fs::create_directories(dir);
  return dir.string();
}

std::string FileContent(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::optional<std::string> SharedDataSet(const std::string& name) {
  const fs::path path =
      fs::path(DGSFM_SOURCE_DIR) / ".." / "shared" / "data" / name;
  if (!fs::exists(path)) return std::nullopt;
  return fs::canonical(path).string();
}

}  // namespace dgsfm
