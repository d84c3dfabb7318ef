// SQLite for the readers and writers of COLMAP databases: three owning handles
// and nothing else. All errors are std::runtime_error with the path, what went
// wrong, SQLite's message and the statement. Not thread-safe.

#pragma once

#include <chrono>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <sqlite3.h>

namespace dgsfm {

// How long to wait for a lock of another connection before giving up.
constexpr std::chrono::milliseconds kDefaultBusyTimeout{5000};

// An error of a database file; the message begins with the path.
class DatabaseError : public std::runtime_error {
 public:
  explicit DatabaseError(const std::string& path)
      : std::runtime_error(path), message_(path + ": ") {}
  template <typename T>
  DatabaseError& operator<<(const T& value) {
    std::ostringstream text;
    text << value;
    message_ += text.str();
    return *this;
  }
  const char* what() const noexcept override { return message_.c_str(); }

 private:
  std::string message_;
};

// An open database file with foreign keys enforced. Opening never changes the
// journal mode, user_version or any other setting kept in the file.
class SqliteConnection {
 public:
  enum class Mode {
    READ_ONLY,   // the file must exist; writing fails
    READ_WRITE,  // the file must exist and be writable
    CREATE,      // as READ_WRITE, makes the file where it is missing
  };

  // A database in WAL mode without write access to it or its folder is read
  // as a file that nobody changes, unless a writer left changes beside it.
  SqliteConnection(
      const std::string& path,
      Mode mode,
      std::chrono::milliseconds busy_timeout = kDefaultBusyTimeout);
  ~SqliteConnection();
  SqliteConnection(const SqliteConnection&) = delete;
  SqliteConnection& operator=(const SqliteConnection&) = delete;

  const std::string& Path() const { return path_; }
  sqlite3* Handle() const { return handle_; }

  // Runs statements that return no rows, separated by semicolons.
  void Execute(const std::string& sql) const;

  bool HasTable(const std::string& name) const;
  bool InTransaction() const { return sqlite3_get_autocommit(handle_) == 0; }

  // To be thrown: throw connection.Error() << "no image " << image_id;
  DatabaseError Error() const { return DatabaseError(path_); }
  // Throws the connection's last error.
  [[noreturn]] void Fail(int result_code, const std::string& sql) const;

 private:
  void Open(const std::string& file, int flags);
  void Close();

  std::string path_;
  std::chrono::milliseconds busy_timeout_;
  sqlite3* handle_ = nullptr;
};

// A prepared statement. Parameters count from 1, columns from 0, as in SQLite.
// The connection must outlive it.
class SqliteStatement {
 public:
  SqliteStatement(const SqliteConnection& connection, const std::string& sql);
  ~SqliteStatement();
  SqliteStatement(const SqliteStatement&) = delete;
  SqliteStatement& operator=(const SqliteStatement&) = delete;

  SqliteStatement& BindInt(int parameter, int64_t value);
  SqliteStatement& BindDouble(int parameter, double value);
  SqliteStatement& BindText(int parameter, const std::string& value);
  // The values are copied as they lie in memory; empty gives an empty blob.
  template <typename T>
  SqliteStatement& BindBlob(int parameter, const std::vector<T>& values) {
    return BindBytes(parameter, values.data(), values.size() * sizeof(T));
  }
  SqliteStatement& BindBytes(int parameter, const void* data, size_t num_bytes);

  // Advances to the next row; false behind the last one.
  bool Step();
  // Makes the statement ready to run again; bound values stay.
  void Reset();
  // Steps to the end and resets.
  void Run();

  // Values of the current row. Throw if the value has another type, naming
  // the column: COLMAP databases written by scripts do contain such values.
  int64_t Int(int column) const;
  double Double(int column) const;
  std::string Text(int column) const;
  bool IsNull(int column) const;
  // NULL is an empty blob. Throws if the size is no multiple of sizeof(T).
  template <typename T>
  std::vector<T> Blob(int column) const {
    const size_t num_bytes = BlobBytes(column, sizeof(T));
    std::vector<T> values(num_bytes / sizeof(T));
    if (num_bytes > 0) {
      std::memcpy(
          values.data(), sqlite3_column_blob(handle_, column), num_bytes);
    }
    return values;
  }

 private:
  void Check(int result_code) const;
  size_t BlobBytes(int column, size_t element_size) const;
  [[noreturn]] void FailColumn(int column, const char* expected) const;

  const SqliteConnection& connection_;
  sqlite3_stmt* handle_ = nullptr;
};

// All or nothing: what runs until Commit() is undone by the destructor if
// Commit() was not reached. Transactions nest.
class SqliteTransaction {
 public:
  enum class Kind { READ, WRITE };  // READ: one snapshot for several queries

  SqliteTransaction(const SqliteConnection& connection, Kind kind);
  ~SqliteTransaction();
  SqliteTransaction(const SqliteTransaction&) = delete;
  SqliteTransaction& operator=(const SqliteTransaction&) = delete;

  void Commit();

 private:
  const SqliteConnection& connection_;
  bool nested_;
  bool open_ = true;
};

}  // namespace dgsfm
