#include "colmap_ext/database/sqlite.h"

#include "tests/testing/colmap_database.h"
#include "tests/testing/test_dir.h"

#include <filesystem>
#include <fstream>
#include <limits>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using Mode = SqliteConnection::Mode;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr std::chrono::milliseconds kShortTimeout{50};

std::string WriteFile(const std::string& name, const std::string& content) {
  const std::string path = CreateTestDir() + "/" + name;
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

std::set<std::string> FilesOf(const std::string& dir) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(dir)) {
    names.insert(entry.path().filename().string());
  }
  return names;
}

// Gives up the rights of the superuser, to whom every file is writable.
class AsOrdinaryUser {
 public:
  AsOrdinaryUser() : was_root_(geteuid() == 0) {
    if (was_root_) is_ordinary_ = seteuid(65534) == 0;
  }
  ~AsOrdinaryUser() {
    if (was_root_ && seteuid(0) != 0) std::abort();
  }
  bool IsOrdinary() const { return is_ordinary_; }

 private:
  bool was_root_;
  bool is_ordinary_ = true;
};

TEST(SqliteConnection, NamesWhatIsWrongWithTheFile) {
  const std::string dir = CreateTestDir();
  EXPECT_THAT([&] { SqliteConnection(dir + "/none.db", Mode::READ_WRITE); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("none.db"), HasSubstr("no such"))));
  EXPECT_FALSE(fs::exists(dir + "/none.db"));
  EXPECT_THAT([&] { SqliteConnection(dir, Mode::READ_ONLY); },
              ThrowsMessage<std::runtime_error>(HasSubstr("folder")));
  const std::string text = WriteFile("text.db", std::string(5000, 'x'));
  EXPECT_THAT([&] { SqliteConnection(text, Mode::READ_ONLY); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(text), HasSubstr("not an SQLite database"))));
}

TEST(SqliteConnection, ReportsTruncatedFile) {
  const std::string path = CreateTestDir() + "/truncated.db";
  {
    SqliteConnection connection(path, Mode::CREATE);
    connection.Execute(
        "CREATE TABLE t(data BLOB);"
        "INSERT INTO t VALUES(randomblob(100000))");
  }
  fs::resize_file(path, fs::file_size(path) / 2);
  EXPECT_THAT(
      [&] {
        SqliteConnection connection(path, Mode::READ_ONLY);
        SqliteStatement statement(connection, "SELECT data FROM t");
        while (statement.Step()) {
        }
      },
      ThrowsMessage<std::runtime_error>(
          AllOf(HasSubstr(path), HasSubstr("truncated"))));
}

TEST(SqliteConnection, GivesUpOnLockedDatabaseAfterTimeout) {
  const std::string path = CreateTestDir() + "/locked.db";
  SqliteConnection writer(path, Mode::CREATE);
  writer.Execute("CREATE TABLE t(x); BEGIN EXCLUSIVE");
  for (const Mode mode : {Mode::READ_ONLY, Mode::READ_WRITE}) {
    EXPECT_THAT([&] { SqliteConnection(path, mode, kShortTimeout); },
                ThrowsMessage<std::runtime_error>(AllOf(
                    HasSubstr(path), HasSubstr("locked by another process"))));
  }
  writer.Execute("COMMIT");
  EXPECT_NO_THROW(SqliteConnection(path, Mode::READ_ONLY, kShortTimeout));
}

TEST(SqliteConnection, ReadingLeavesWalDatabaseAndFolderAsTheyWere) {
  const std::string dir = CreateTestDir();
  const std::string path = dir + "/wal.db";
  {
    SqliteConnection writer(path, Mode::CREATE);
    writer.Execute(
        "PRAGMA journal_mode = WAL; PRAGMA user_version = 7;"
        "CREATE TABLE t(x)");
  }
  ASSERT_EQ(FilesOf(dir), std::set<std::string>{"wal.db"});
  const auto time = fs::last_write_time(path);
  {
    SqliteConnection reader(path, Mode::READ_ONLY);
    EXPECT_TRUE(reader.HasTable("t"));
    EXPECT_THAT([&] { reader.Execute("INSERT INTO t VALUES(1)"); },
                ThrowsMessage<std::runtime_error>(HasSubstr("not writable")));
    SqliteStatement version(reader, "PRAGMA user_version");
    ASSERT_TRUE(version.Step());
    EXPECT_EQ(version.Int(0), 7);
  }
  EXPECT_EQ(FilesOf(dir), std::set<std::string>{"wal.db"});
  EXPECT_EQ(fs::last_write_time(path), time);
}

TEST(SqliteConnection, ReadsWalDatabaseWithoutWriteAccess) {
  const std::string dir = CreateTestDir();
  // The name has characters that need escaping in a URI.
  const std::string path = dir + "/50%41 a?b#c.db";
  {
    SqliteConnection writer(path, Mode::CREATE);
    writer.Execute(
        "PRAGMA journal_mode = WAL; CREATE TABLE t(x); INSERT INTO t "
        "VALUES(5)");
  }
  // Not writable: the file alone (SQLite would litter the folder), then the
  // folder as well.
  fs::permissions(path, fs::perms(0444));
  for (const fs::perms folder : {fs::perms(0777), fs::perms(0555)}) {
    fs::permissions(dir, folder);
    {
      const AsOrdinaryUser user;
      if (!user.IsOrdinary() || access(path.c_str(), R_OK) != 0) {
        GTEST_SKIP() << "cannot drop the superuser's rights here";
      }
      SqliteConnection reader(path, Mode::READ_ONLY);
      SqliteStatement select(reader, "SELECT x FROM t");
      ASSERT_TRUE(select.Step());
      EXPECT_EQ(select.Int(0), 5);
    }
    EXPECT_EQ(FilesOf(dir).size(), 1);
  }
  fs::permissions(dir, fs::perms(0755));
}

TEST(SqliteConnection, RefusesToWriteToProtectedFile) {
  const std::string path = CreateTestDir() + "/a.db";
  SqliteConnection(path, Mode::CREATE).Execute("CREATE TABLE t(x)");
  fs::permissions(path, fs::perms(0444));
  const AsOrdinaryUser user;
  if (!user.IsOrdinary()) GTEST_SKIP() << "cannot drop the superuser's rights";
  EXPECT_THAT([&] { SqliteConnection(path, Mode::READ_WRITE); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(path), HasSubstr("not writable"))));
}

TEST(SqliteConnection, EnforcesForeignKeys) {
  SqliteConnection connection(CreateTestDir() + "/a.db", Mode::CREATE);
  connection.Execute(
      "CREATE TABLE parent(id INTEGER PRIMARY KEY);"
      "CREATE TABLE child(id INTEGER REFERENCES parent(id))");
  EXPECT_THAT([&] { connection.Execute("INSERT INTO child VALUES(3)"); },
              ThrowsMessage<std::runtime_error>(AllOf(
                  HasSubstr("FOREIGN KEY"), HasSubstr("INSERT INTO child"))));
}

TEST(SqliteStatement, ReturnsWhatWasBound) {
  SqliteConnection connection(CreateTestDir() + "/a.db", Mode::CREATE);
  connection.Execute("CREATE TABLE t(i, d, s, b, e, n)");
  const std::vector<float> values = {
      1.5f, -2.0f, std::numeric_limits<float>::min()};
  SqliteStatement(connection, "INSERT INTO t VALUES(?, ?, ?, ?, ?, NULL)")
      .Bind(std::numeric_limits<int64_t>::min(),
            0.1,
            "Straße 'x'",
            values,
            std::vector<float>())
      .Run();
  SqliteStatement select(connection, "SELECT * FROM t");
  ASSERT_TRUE(select.Step());
  EXPECT_EQ(select.Int(0), std::numeric_limits<int64_t>::min());
  EXPECT_EQ(select.Double(1), 0.1);
  EXPECT_EQ(select.Text(2), "Straße 'x'");
  EXPECT_EQ(select.Blob<float>(3), values);
  EXPECT_FALSE(select.IsNull(4));
  EXPECT_TRUE(select.Blob<float>(4).empty());
  EXPECT_TRUE(select.IsNull(5));
  EXPECT_TRUE(select.Blob<float>(5).empty());
  EXPECT_FALSE(select.Step());
}

TEST(SqliteStatement, RefusesValuesOfAnotherType) {
  SqliteConnection connection(CreateTestDir() + "/a.db", Mode::CREATE);
  SqliteStatement select(connection, "SELECT 'a' AS name, x'0102' AS data");
  ASSERT_TRUE(select.Step());
  EXPECT_THAT([&] { select.Int(0); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("column name"), HasSubstr("integer"))));
  EXPECT_THAT([&] { select.Double(1); },
              ThrowsMessage<std::runtime_error>(HasSubstr("number")));
  EXPECT_THAT([&] { select.Text(1); },
              ThrowsMessage<std::runtime_error>(HasSubstr("text")));
  EXPECT_THAT([&] { select.Blob<float>(1); },
              ThrowsMessage<std::runtime_error>(HasSubstr("4 bytes")));
  EXPECT_THAT([&] { SqliteStatement(connection, "SELECT * FROM none"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("no such table")));
}

TEST(SqliteTransaction, UndoesWhatWasNotCommitted) {
  using Kind = SqliteTransaction::Kind;
  SqliteConnection connection(CreateTestDir() + "/a.db", Mode::CREATE);
  connection.Execute("CREATE TABLE t(x)");
  {
    SqliteTransaction outer(connection, Kind::WRITE);
    connection.Execute("INSERT INTO t VALUES(1)");
    {
      SqliteTransaction inner(connection, Kind::WRITE);
      connection.Execute("INSERT INTO t VALUES(2)");
    }
    {
      SqliteTransaction inner(connection, Kind::WRITE);
      connection.Execute("INSERT INTO t VALUES(3)");
      inner.Commit();
    }
    outer.Commit();
  }
  {
    SqliteTransaction transaction(connection, Kind::WRITE);
    connection.Execute("INSERT INTO t VALUES(4)");
  }
  EXPECT_FALSE(connection.InTransaction());
  SqliteStatement sum(connection, "SELECT sum(x) FROM t");
  ASSERT_TRUE(sum.Step());
  EXPECT_EQ(sum.Int(0), 1 + 3);
}

}  // namespace
}  // namespace dgsfm
