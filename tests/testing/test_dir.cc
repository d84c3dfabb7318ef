#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
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
  const fs::path dir = fs::path(testing::TempDir()) / "dgsfm_tests" / name;
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
