#include "colmap_ext/database/sqlite.h"

#include <filesystem>
#include <fstream>
#include <sstream>

#include <fcntl.h>
#include <unistd.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              "blobs of COLMAP databases are little-endian");

// What a result code means to somebody who only gave us a file name.
std::string Explain(int result_code, std::chrono::milliseconds busy_timeout) {
  switch (result_code & 0xff) {
    case SQLITE_BUSY:
    case SQLITE_LOCKED: {
      std::ostringstream text;
      text << "locked by another process (waited "
           << busy_timeout.count() / 1000.0 << " s); close it and try again";
      return text.str();
    }
    case SQLITE_NOTADB:
      return "not an SQLite database";
    case SQLITE_CORRUPT:
      return "damaged or truncated database";
    case SQLITE_READONLY:
      return "database not writable";
    case SQLITE_CANTOPEN:
      return "cannot open database or the files SQLite needs beside it";
    case SQLITE_FULL:
      return "disk full";
    case SQLITE_IOERR:
      return result_code == SQLITE_IOERR_SHORT_READ
                 ? "damaged or truncated database"
                 : "input/output error";
    default:
      return "database error";
  }
}

// URI of a file for sqlite3_open_v2, which reserves ?, # and %.
std::string FileUri(const std::string& path, const std::string& query) {
  std::string uri = "file:";
  for (const char c : fs::absolute(path).string()) {
    if (c == '%' || c == '?' || c == '#') {
      constexpr char kHexDigits[] = "0123456789abcdef";
      uri += '%';
      uri += kHexDigits[(c >> 4) & 15];
      uri += kHexDigits[c & 15];
    } else {
      uri += c;
    }
  }
  return uri + "?" + query;
}

// Whether the file is in WAL mode, in which reading needs files beside it.
bool IsInWalMode(const std::string& path) {
  char header[20] = {};
  std::ifstream(path, std::ios::binary).read(header, sizeof(header));
  return header[18] == 2 && header[19] == 2;
}

uintmax_t FileSize(const std::string& path) {
  std::error_code error;
  const uintmax_t size = fs::file_size(path, error);
  return error ? 0 : size;
}

// Whether a writer left changes that are not yet in the file itself.
bool HasPendingChanges(const std::string& path) {
  return FileSize(path + "-wal") > 0;
}

// Whether a writer is at work, or left changes to be written or undone.
bool IsBeingWritten(const std::string& path) {
  // SQLite clears or removes the header of a journal that is done with.
  char first = 0;
  std::ifstream(path + "-journal", std::ios::binary).read(&first, 1);
  return HasPendingChanges(path) || first != 0;
}

bool IsWritable(const fs::path& path) {
  return faccessat(AT_FDCWD, path.c_str(), W_OK, AT_EACCESS) == 0;
}

}  // namespace

std::string ChangeStamp(const std::string& path) {
  char header[28] = {};
  std::ifstream(path, std::ios::binary).read(header, sizeof(header));
  std::ostringstream stamp;
  stamp << FileSize(path) << " " << FileSize(path + "-wal") << " "
        << FileSize(path + "-journal");
  // SQLite's file change counter.
  for (int i = 24; i < 28; ++i) stamp << " " << int(header[i]);
  return stamp.str();
}

SqliteConnection::SqliteConnection(const std::string& path,
                                   Mode mode,
                                   std::chrono::milliseconds busy_timeout)
    : path_(path), busy_timeout_(busy_timeout) {
  if (fs::is_directory(path)) {
    throw Error() << "is a folder, not a database";
  }
  const bool creates = mode == Mode::CREATE || mode == Mode::CREATE_ALONE;
  if (!creates && !fs::exists(path)) {
    throw Error() << "no such database file";
  }
  try {
    const bool is_writable =
        IsWritable(path) && IsWritable(fs::absolute(path).parent_path());
    if (mode == Mode::UNCHANGING && IsBeingWritten(path)) {
      throw Error() << "is being written, or a writer that was broken off left "
                       "changes beside it; close all programs that use it and "
                       "open it once for writing (sqlite3 FILE 'VACUUM')";
    }
    if (mode == Mode::UNCHANGING ||
        (mode == Mode::READ_ONLY && !is_writable && IsInWalMode(path) &&
         !HasPendingChanges(path))) {
      Open(FileUri(path, "immutable=1"),
           SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
    } else {
      // Readers open for writing as well where they may: only then SQLite can
      // recover after a crashed writer and tidy up its -wal and -shm files.
      Open(path,
           SQLITE_OPEN_READWRITE | (creates ? SQLITE_OPEN_CREATE : 0),
           mode == Mode::CREATE_ALONE ? "unix-none" : nullptr);
    }
    // SQLite opens lazily: the first query shows whether the file is usable.
    Execute("SELECT 1 FROM sqlite_master LIMIT 1");
    if (mode == Mode::READ_ONLY || mode == Mode::UNCHANGING) {
      Execute("PRAGMA query_only = ON");
    } else if (sqlite3_db_readonly(handle_, "main") == 1) {
      throw Error() << "database not writable";
    }
    Execute("PRAGMA foreign_keys = ON");
  } catch (...) {
    Close();
    throw;
  }
}

SqliteConnection::~SqliteConnection() { Close(); }

void SqliteConnection::Open(const std::string& file,
                            int flags,
                            const char* vfs) {
  const int result_code =
      sqlite3_open_v2(file.c_str(), &handle_, flags | SQLITE_OPEN_NOMUTEX, vfs);
  if (result_code != SQLITE_OK) Fail(result_code, "");
  sqlite3_extended_result_codes(handle_, 1);
  sqlite3_busy_timeout(handle_, static_cast<int>(busy_timeout_.count()));
}

void SqliteConnection::Close() {
  sqlite3_close_v2(handle_);
  handle_ = nullptr;
}

void SqliteConnection::Execute(const std::string& sql) const {
  const int result_code =
      sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
  if (result_code != SQLITE_OK) Fail(result_code, sql);
}

bool SqliteConnection::HasTable(const std::string& name) const {
  SqliteStatement statement(
      *this,
      "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?",
      name);
  return statement.Step();
}

void SqliteConnection::Fail(int result_code, const std::string& sql) const {
  const std::string statement = sql.empty() ? "" : "; statement: " + sql;
  throw Error() << Explain(result_code, busy_timeout_)
                << " (SQLite: " << sqlite3_errmsg(handle_) << statement << ")";
}

SqliteStatement::SqliteStatement(const SqliteConnection& connection,
                                 const std::string& sql)
    : connection_(connection) {
  const int result_code = sqlite3_prepare_v2(
      connection.Handle(), sql.c_str(), -1, &handle_, nullptr);
  if (result_code != SQLITE_OK) connection.Fail(result_code, sql);
}

SqliteStatement::~SqliteStatement() { sqlite3_finalize(handle_); }

void SqliteStatement::BindInt(int parameter, int64_t value) {
  Check(sqlite3_bind_int64(handle_, parameter, value));
}

void SqliteStatement::BindDouble(int parameter, double value) {
  Check(sqlite3_bind_double(handle_, parameter, value));
}

void SqliteStatement::BindText(int parameter, std::string_view value) {
  Check(sqlite3_bind_text64(handle_,
                            parameter,
                            value.data(),
                            value.size(),
                            SQLITE_TRANSIENT,
                            SQLITE_UTF8));
}

void SqliteStatement::BindBytes(int parameter,
                                const void* data,
                                size_t num_bytes) {
  // A null pointer would bind NULL.
  Check(sqlite3_bind_blob64(handle_,
                            parameter,
                            num_bytes == 0 ? "" : data,
                            num_bytes,
                            SQLITE_TRANSIENT));
}

bool SqliteStatement::Step() {
  const int result_code = sqlite3_step(handle_);
  if (result_code == SQLITE_ROW) return true;
  if (result_code == SQLITE_DONE) return false;
  connection_.Fail(result_code, sqlite3_sql(handle_));
}

void SqliteStatement::Reset() {
  // Returns the error of the last step, which Step() has reported.
  sqlite3_reset(handle_);
}

void SqliteStatement::Run() {
  while (Step()) {
  }
  Reset();
}

int64_t SqliteStatement::Int(int column) const {
  if (sqlite3_column_type(handle_, column) != SQLITE_INTEGER) {
    FailColumn(column, "an integer");
  }
  return sqlite3_column_int64(handle_, column);
}

double SqliteStatement::Double(int column) const {
  const int type = sqlite3_column_type(handle_, column);
  if (type != SQLITE_FLOAT && type != SQLITE_INTEGER) {
    FailColumn(column, "a number");
  }
  return sqlite3_column_double(handle_, column);
}

std::string SqliteStatement::Text(int column) const {
  if (sqlite3_column_type(handle_, column) != SQLITE_TEXT) {
    FailColumn(column, "text");
  }
  const auto* text =
      reinterpret_cast<const char*>(sqlite3_column_text(handle_, column));
  return {text, static_cast<size_t>(sqlite3_column_bytes(handle_, column))};
}

bool SqliteStatement::IsNull(int column) const {
  return sqlite3_column_type(handle_, column) == SQLITE_NULL;
}

size_t SqliteStatement::BlobBytes(int column, size_t element_size) const {
  if (IsNull(column)) return 0;
  if (sqlite3_column_type(handle_, column) != SQLITE_BLOB) {
    FailColumn(column, "a blob");
  }
  const size_t num_bytes = sqlite3_column_bytes(handle_, column);
  if (num_bytes % element_size != 0) {
    FailColumn(
        column,
        ("a multiple of " + std::to_string(element_size) + " bytes").c_str());
  }
  return num_bytes;
}

void SqliteStatement::Check(int result_code) const {
  if (result_code != SQLITE_OK) {
    connection_.Fail(result_code, sqlite3_sql(handle_));
  }
}

void SqliteStatement::FailColumn(int column, const char* expected) const {
  throw connection_.Error() << "column " << sqlite3_column_name(handle_, column)
                            << " holds something other than " << expected
                            << " (statement: " << sqlite3_sql(handle_) << ")";
}

SqliteTransaction::SqliteTransaction(const SqliteConnection& connection,
                                     Kind kind)
    : connection_(connection), nested_(connection.InTransaction()) {
  // A writer takes its lock at once: two readers that both want to write
  // would otherwise wait for each other.
  connection.Execute(nested_               ? "SAVEPOINT dgsfm"
                     : kind == Kind::WRITE ? "BEGIN IMMEDIATE"
                                           : "BEGIN");
}

SqliteTransaction::~SqliteTransaction() {
  // Nothing is left to undo where SQLite itself has rolled back (disk full).
  if (!open_ || !connection_.InTransaction()) return;
  sqlite3_exec(connection_.Handle(),
               nested_ ? "ROLLBACK TO dgsfm; RELEASE dgsfm" : "ROLLBACK",
               nullptr,
               nullptr,
               nullptr);
}

void SqliteTransaction::Commit() {
  connection_.Execute(nested_ ? "RELEASE dgsfm" : "COMMIT");
  open_ = false;
}

}  // namespace dgsfm
