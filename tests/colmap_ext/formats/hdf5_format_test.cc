#include "colmap_ext/formats/hdf5_format.h"

#include "tests/testing/test_dir.h"

#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/types.h>

namespace dgsfm::internal {
namespace {

using testing::AnyOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

// A file by h5py: groups a.jpg and sub/b.jpg; empty without h5py.
std::string WriteFile() {
  const std::string dir = CreateTestDir();
  std::ofstream(dir + "/write.py") << R"(
import sys
import h5py
import numpy as np
with h5py.File(sys.argv[1], 'w') as file:
    a = file.create_group('a.jpg')
    a['depth'] = np.array([[0.5, 2, np.inf], [65504, 6e-8, -1]], np.float16)
    a['mask'] = np.array([True, False])
    a['name'] = 'no numbers'
    file['sub/b.jpg/depth'] = np.array([1.5, 1e30], '>f4')
)";
  const std::string path = dir + "/depth.h5";
  const std::string command =
      DGSFM_PYTHON " " + dir + "/write.py " + path + " 2>/dev/null";
  return std::system(command.c_str()) == 0 ? path : "";
}

// Children of this thread.
std::vector<pid_t> Children() {
  std::ifstream file("/proc/thread-self/children");
  std::vector<pid_t> children;
  for (pid_t child = 0; file >> child;) children.push_back(child);
  return children;
}

TEST(Hdf5File, ReadsGroupsAndArrays) {
  const std::string path = WriteFile();
  if (path.empty()) GTEST_SKIP() << "no Python with h5py";
  const Hdf5File file(path);
  EXPECT_THAT(file.FindGroups("depth"), ElementsAre("a.jpg", "sub/b.jpg"));
  EXPECT_THAT(file.FindGroups("mask"), ElementsAre("a.jpg"));
  const auto depth = file.Read("a.jpg", "depth");
  ASSERT_TRUE(depth.has_value());
  EXPECT_THAT(depth->shape, ElementsAre(2, 3));
  EXPECT_EQ(depth->values[0], 0.5);
  EXPECT_EQ(depth->values[2], std::numeric_limits<float>::infinity());
  EXPECT_EQ(depth->values[3], 65504);
  EXPECT_NEAR(depth->values[4], 6e-8, 1e-9);  // to the nearest 2^-24
  EXPECT_EQ(depth->values[5], -1);
  EXPECT_THAT(file.Read("a.jpg", "mask")->values, ElementsAre(1, 0));
  EXPECT_THAT(file.Read("sub/b.jpg", "depth")->values, ElementsAre(1.5, 1e30f));
  EXPECT_FALSE(file.Read("a.jpg", "missing").has_value());
  EXPECT_FALSE(file.Read("missing", "depth").has_value());
  EXPECT_THAT([&] { file.Read("a.jpg", "name"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("no numbers")));
  // It goes on after an error.
  EXPECT_TRUE(file.Read("a.jpg", "depth").has_value());
}

TEST(Hdf5File, ReadsNoOtherFile) {
  const std::string path = WriteFile();
  if (path.empty()) GTEST_SKIP() << "no Python with h5py";
  const std::string dir = std::filesystem::path(path).parent_path();
  std::ofstream(dir + "/lead_out.py") << R"(
import sys
import h5py
with h5py.File(sys.argv[1], 'a') as file:
    layout = h5py.VirtualLayout(shape=(2,), dtype='f4')
    layout[:] = h5py.VirtualSource('other.h5', 'depth', shape=(2,))
    file.create_group('virtual').create_virtual_dataset('depth', layout)
    file.create_group('link')['depth'] = h5py.ExternalLink('other.h5', 'depth')
    file.create_group('external').create_dataset(
        'depth', (2,), 'f4', external=[('other.raw', 0, 8)])
with h5py.File(sys.argv[2], 'w') as file:
    file['depth'] = [1., 2.]
)";
  std::ofstream(dir + "/other.raw") << "12345678";
  ASSERT_EQ(std::system((DGSFM_PYTHON " " + dir + "/lead_out.py " + path + " " +
                         dir + "/other.h5")
                            .c_str()),
            0);
  const Hdf5File file(path);
  for (const char* group : {"virtual", "link", "external"}) {
    EXPECT_THAT([&] { file.Read(group, "depth"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("another file")))
        << group;
  }
}

TEST(Hdf5File, SurvivesACrashOfTheReadingProcess) {
  const std::string path = WriteFile();
  if (path.empty()) GTEST_SKIP() << "no Python with h5py";
  {
    const Hdf5File file(path);
    const std::vector<pid_t> children = Children();
    ASSERT_EQ(children.size(), 1);
    ASSERT_EQ(kill(children.front(), SIGSEGV), 0);
    EXPECT_THAT([&] { file.Read("a.jpg", "depth"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("crashes")));
    EXPECT_THROW(file.FindGroups(""), std::runtime_error);
  }
  EXPECT_TRUE(Children().empty());
}

// The list of free pieces in a group's heap of names goes in a circle.
TEST(Hdf5File, EndsWhereLibhdf5GoesInCircles) {
  const std::string path = WriteFile();
  if (path.empty()) GTEST_SKIP() << "no Python with h5py";
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  // Signature, version and size of the data, then where in them the list begins
  // and where they are. A piece begins with the place of the next one and its
  // own size.
  const size_t heap = bytes.find("HEAP");
  ASSERT_NE(heap, std::string::npos);
  const auto number = [&bytes](size_t pos) {
    uint64_t value = 0;
    std::memcpy(&value, bytes.data() + pos, sizeof(value));
    return value;
  };
  const uint64_t begin = number(heap + 16);
  const uint64_t piece[] = {begin, 16};
  file.seekp(number(heap + 24) + begin);
  file.write(reinterpret_cast<const char*>(piece), sizeof(piece));
  file.close();
  // The kernel counts whole seconds. Later versions of libhdf5 see the circle.
  EXPECT_THAT([&] { Hdf5File(path, /*max_seconds=*/0).FindGroups("depth"); },
              ThrowsMessage<std::runtime_error>(
                  AnyOf(HasSubstr("comes to no end"), HasSubstr("damaged"))));
  EXPECT_TRUE(Children().empty());
}

// On these libhdf5 1.10 reads beyond its buffers, unnoticed as a rule.
TEST(Hdf5File, SurvivesWhatTheFuzzerFound) {
  size_t num_files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(
           DGSFM_SOURCE_DIR "/tests/fuzz/findings")) {
    if (entry.path().extension() != ".h5") continue;
    ++num_files;
    try {
      const Hdf5File file(entry.path());
      for (const std::string& group : file.FindGroups("")) {
        file.Read(group, "depth");
      }
    } catch (const std::runtime_error&) {
    }
  }
  EXPECT_EQ(num_files, 3);
  EXPECT_TRUE(Children().empty());
}

}  // namespace
}  // namespace dgsfm::internal
