// SQLite for the readers and writers of COLMAP databases: three owning handles
// and nothing else. All errors are std::runtime_error with the path, what went
// wrong, SQLite's message and the statement. Not thread-safe.

#pragma once

#include <chrono>
#include <cstdint>
#include <cstring>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
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

// Another text once a writer has changed the file: its size, SQLite's count of
// changes, and what waits beside it to be written.
std::string ChangeStamp(const std::string& path);

// An open database file with foreign keys enforced. Opening never changes the
// journal mode, user_version or any other setting kept in the file.
class SqliteConnection {
 public:
  enum class Mode {
    READ_ONLY,   // the file must exist; writing fails
    UNCHANGING,  // as READ_ONLY, of a file that nobody writes meanwhile: needs
                 // no lock and no file beside it, for any number of readers
    READ_WRITE,  // the file must exist and be writable
    CREATE,      // as READ_WRITE, makes the file where it is missing
    CREATE_ALONE,  // as CREATE, of a file that no other process opens: without
                   // locks, which not all network file systems have
  };

  // A database in WAL mode without write access to it or its folder is read
  // as a file that nobody changes, unless a writer left changes beside it.
  // With such changes UNCHANGING is refused.
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
  void Open(const std::string& file, int flags, const char* vfs = nullptr);
  void Close();

  std::string path_;
  std::chrono::milliseconds busy_timeout_;
  sqlite3* handle_ = nullptr;
};

// A prepared statement. Columns count from 0, as in SQLite. The connection must
// outlive it.
class SqliteStatement {
 public:
  SqliteStatement(const SqliteConnection& connection, const std::string& sql);
  // Binds the values as well.
  template <typename... Values>
  SqliteStatement(const SqliteConnection& connection,
                  const std::string& sql,
                  const Values&... values)
      : SqliteStatement(connection, sql) {
    Bind(values...);
  }
  ~SqliteStatement();
  SqliteStatement(const SqliteStatement&) = delete;
  SqliteStatement& operator=(const SqliteStatement&) = delete;

  // Binds the first parameters of the statement: integers, booleans and
  // enumerations (unsigned 64-bit numbers as the signed ones of the same bits),
  // floating point numbers, texts, and vectors as blobs: their elements as they
  // lie in memory, without any an empty blob.
  template <typename... Values>
  SqliteStatement& Bind(const Values&... values) {
    int parameter = 0;
    (BindValue(++parameter, values), ...);
    return *this;
  }

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
  // The first columns, integers cut to their type.
  template <typename... Types>
  std::tuple<Types...> Columns() const {
    std::tuple<Types...> row;
    int column = 0;
    std::apply(
        [&](Types&... values) { ((values = Column<Types>(column++)), ...); },
        row);
    return row;
  }
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
  void BindInt(int parameter, int64_t value);
  void BindDouble(int parameter, double value);
  void BindText(int parameter, std::string_view value);
  void BindBytes(int parameter, const void* data, size_t num_bytes);

  template <typename T>
  void BindValue(int parameter, const T& value) {
    if constexpr (std::is_integral_v<T> || std::is_enum_v<T>) {
      BindInt(parameter, static_cast<int64_t>(value));
    } else if constexpr (std::is_floating_point_v<T>) {
      BindDouble(parameter, value);
    } else if constexpr (std::is_convertible_v<T, std::string_view>) {
      BindText(parameter, value);
    } else {
      BindBytes(parameter, value.data(), value.size() * sizeof(*value.data()));
    }
  }

  template <typename T>
  T Column(int column) const {
    if constexpr (std::is_integral_v<T> || std::is_enum_v<T>) {
      return static_cast<T>(Int(column));
    } else if constexpr (std::is_floating_point_v<T>) {
      return Double(column);
    } else if constexpr (std::is_same_v<T, std::string>) {
      return Text(column);
    } else {
      return Blob<typename T::value_type>(column);
    }
  }

  size_t BlobBytes(int column, size_t element_size) const;
  [[noreturn]] void FailColumn(int column, const char* expected) const;

  const SqliteConnection& connection_;
  sqlite3_stmt* handle_ = nullptr;
};

// Rows of a query whose first column, the key, is sorted and unique.
template <typename Key, typename Value>
std::map<Key, Value> SelectMap(const SqliteConnection& connection,
                               const std::string& sql) {
  std::map<Key, Value> values;
  SqliteStatement select(connection, sql);
  while (select.Step()) {
    const auto [key, value] = select.Columns<Key, Value>();
    values.emplace_hint(values.end(), key, value);
  }
  return values;
}

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
