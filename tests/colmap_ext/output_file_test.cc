#include "colmap_ext/output_file.h"

#include "colmap_ext/formats/picture_file.h"
#include "tests/testing/expect_error.h"
#include "tests/testing/file_size_limit.h"
#include "tests/testing/test_dir.h"

#include <filesystem>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

size_t NumEntries(const std::string& folder) {
  return std::distance(fs::directory_iterator(folder),
                       fs::directory_iterator());
}

TEST(OutputFile, IsThereWholeOrAsItWas) {
  const std::string dir = CreateTestDir();
  const std::string path = dir + "/a.txt";
  WriteFile(path, "old");
  {
    OutputFile file(path);
    file.Write("new");
    EXPECT_EQ(FileContent(path), "old");
  }
  EXPECT_EQ(FileContent(path), "old");
  EXPECT_EQ(NumEntries(dir), 1);
  {
    const FileSizeLimit limit(1000);
    ExpectError([&] { WriteFile(path, std::string(2000, 'x')); }, path);
  }
  EXPECT_EQ(FileContent(path), "old");
  EXPECT_EQ(NumEntries(dir), 1);
  WriteFile(path, std::string(3 << 20, 'y'));
  EXPECT_EQ(FileContent(path), std::string(3 << 20, 'y'));
  EXPECT_EQ(NumEntries(dir), 1);
}

TEST(OutputFile, NamesWhatCannotBeWritten) {
  const std::string dir = CreateTestDir();
  ExpectError([&] { WriteFile(dir + "/missing/a", "x"); }, dir + "/missing/a");
  ExpectError([&] { WriteFile(dir, "x"); }, dir);
  ExpectError([] { WriteFile("/dev/full", "x"); }, "/dev/full");
  WriteFile("/dev/null", "x");
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
}

TEST(OutputFile, WritesToTheStandardOutput) {
  const bool is_link = fs::is_symlink("/dev/stdout");
  testing::internal::CaptureStdout();
  WriteFile("/dev/stdout", "a");
  WriteFile("/dev/stdout", "b");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "ab");
  EXPECT_EQ(fs::is_symlink("/dev/stdout"), is_link);
}

TEST(OutputFile, ReplacesLinks) {
  const std::string dir = CreateTestDir();
  WriteFile(dir + "/target", "kept");
  fs::create_symlink("target", dir + "/link");
  WriteFile(dir + "/link", "new");
  EXPECT_EQ(FileContent(dir + "/target"), "kept");
  EXPECT_EQ(FileContent(dir + "/link"), "new");
  EXPECT_FALSE(fs::is_symlink(dir + "/link"));
}

TEST(OutputFile, ReplacesWhatAKilledRunLeft) {
  const std::string dir = CreateTestDir();
  // A process that is killed leaves its file.
  const pid_t child = fork();
  if (child == 0) {
    const OutputFile file(dir + "/a");
    _exit(0);
  }
  ASSERT_EQ(waitpid(child, nullptr, 0), child);
  EXPECT_EQ(NumEntries(dir), 1);
  WriteFile(dir + "/a", "new");
  EXPECT_EQ(NumEntries(dir), 1);
}

TEST(ReplaceFolder, ExchangesFoldersAndLinks) {
  const std::string dir = CreateTestDir();
  for (const char* name : {"old", "new", "aside"}) {
    fs::create_directory(dir + "/" + name);
    WriteFile(dir + "/" + name + "/file", name);
  }
  ReplaceFolder(dir + "/new", dir + "/old");
  EXPECT_EQ(FileContent(dir + "/old/file"), "new");
  EXPECT_EQ(FileContent(dir + "/new/file"), "old");
  ReplaceFolder(dir + "/new", dir + "/first");
  EXPECT_EQ(FileContent(dir + "/first/file"), "old");
  fs::create_directory_symlink("aside", dir + "/link");
  ReplaceFolder(dir + "/first", dir + "/link");
  EXPECT_FALSE(fs::is_symlink(dir + "/link"));
  EXPECT_EQ(FileContent(dir + "/aside/file"), "aside");
}

TEST(PathInside, RefusesNamesThatLeadOut) {
  EXPECT_EQ(PathInside("folder", "sub/a..b.jpg"), "folder/sub/a..b.jpg");
  for (const char* name : {"", "/etc/passwd", "..", "../a", "a/../../b"}) {
    ExpectError([&] { PathInside("folder", name); }, name);
  }
}

TEST(WritePicture, WritesTheFormatOfTheExtension) {
  const std::string dir = CreateTestDir();
  colmap::Bitmap bitmap;
  bitmap.Allocate(16, 16, /*as_rgb=*/true);
  bitmap.Fill(colmap::BitmapColor<uint8_t>(1, 2, 3));
  for (const char* name : {"/a.png", "/a.jpg", "/a"}) {
    WritePicture(dir + name, bitmap);
    EXPECT_TRUE(colmap::Bitmap().Read(dir + name)) << name;
  }
  EXPECT_EQ(FileContent(dir + "/a").substr(1, 3), "PNG");
  ExpectError([&] { WritePicture("/dev/full", bitmap); }, "/dev/full");
}

}  // namespace
}  // namespace dgsfm
