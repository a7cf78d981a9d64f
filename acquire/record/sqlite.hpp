// SPDX-License-Identifier: MIT
// Wrappers for SQLite calls. Errors become exceptions.
#pragma once
#include <sqlite3.h>
#include <unistd.h>

#include <concepts>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/util/caused_error.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {

// Returns the error for a database that contains more data than its file size allows.
inline Error damaged(const std::string& path) {
  return {ExitCode::failed,
          printable(path) + ": damaged: it contains more data than its file size allows"};
}

// Throws Error with the file name and the message of SQLite. Its code is ExitCode::disk for a full
// disk, a locked file or a failed write.
[[noreturn]] inline void sqlite_fail(sqlite3* db, const std::string& path, const char* doing) {
  const int code = sqlite3_errcode(db);
  if (code == SQLITE_INTERRUPT) throw damaged(path);
  const bool held = code == SQLITE_BUSY;
  const bool disk = held || code == SQLITE_FULL || code == SQLITE_IOERR ||
                    code == SQLITE_READONLY || code == SQLITE_CANTOPEN;
  const std::string place = printable(path) + ": " + doing + ": ";
  if (held)
    throw CausedError(Cause::in_use, place + "another program holds a write transaction",
                      ExitCode::disk);
  throw Error(disk ? ExitCode::disk : ExitCode::failed, place + printable(sqlite3_errmsg(db)));
}

inline std::vector<std::string> side_files(const std::string& path) {
  std::vector<std::string> out;
  for (const char* suffix : {"-wal", "-shm", "-journal"})
    if (::access((path + suffix).c_str(), F_OK) == 0) out.push_back(path + suffix);
  return out;
}

// Throws unless the database and its side files are regular files.
inline void require_regular_files(const std::string& path) {
  if (::access(path.c_str(), F_OK) == 0) require_regular(path, ExitCode::failed);
  for (const std::string& file : side_files(path)) require_regular(file, ExitCode::failed);
}

using DatabaseHandle = std::unique_ptr<sqlite3, int (*)(sqlite3*)>;

// Returns the file format version, which is in bytes 18 and 19 of the header. It is 1 for a closed
// run and 2 for a run with a WAL. Returns 0 if the two bytes differ from each other. Reads through
// SQLite's file descriptor, because closing another descriptor of the file would release SQLite's
// locks.
inline int journal_version(sqlite3* db) {
  sqlite3_file* file = nullptr;
  std::uint8_t versions[2] = {};
  sqlite3_file_control(db, "main", SQLITE_FCNTL_FILE_POINTER, static_cast<void*>(&file));
  if (file && file->pMethods) file->pMethods->xRead(file, versions, sizeof versions, 18);
  return versions[0] == versions[1] ? versions[0] : 0;
}

// Returns true for a closed run, for which side files are ignored. Returns false if the file cannot
// be opened.
inline bool is_closed(const std::string& path) {
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr);
  const DatabaseHandle file(db, sqlite3_close);
  return code == SQLITE_OK && journal_version(db) == 1;
}

// Returns a URI with which SQLite reads only the database file, without side files.
inline std::string immutable_uri(const std::string& path) {
  std::string uri = "file:";
  for (const char c : path)
    uri += c == '%' ? "%25" : c == '?' ? "%3f" : c == '#' ? "%23" : std::string(1, c);
  return uri + "?immutable=1";
}

// Opens an existing database for reading and writing. `flags` contains additional SQLITE_OPEN_*
// flags. Throws the same errors as sqlite_fail().
inline DatabaseHandle open_database(const std::string& path, const char* doing, int flags = 0) {
  require_regular_files(path);
  sqlite3* db = nullptr;
  const int code = sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE | flags, nullptr);
  DatabaseHandle out(db, sqlite3_close);
  if (code != SQLITE_OK) sqlite_fail(db, path, doing);
  return out;
}

// Prepared statement. Parameters are bound and columns are read in order, beginning with the first.
class Statement {
 public:
  // `max_bytes` is the maximum total size of the strings and blobs that are read. A statement that
  // exceeds this size throws Error.
  Statement(sqlite3* db, const std::string& path, const char* sql,
            std::int64_t max_bytes = std::numeric_limits<std::int64_t>::max())
      : db_(db), path_(path), bytes_left_(max_bytes) {
    if (sqlite3_prepare_v2(db, sql, -1, &handle_, nullptr) != SQLITE_OK)
      sqlite_fail(db, path, "unexpected table structure");
  }
  ~Statement() { sqlite3_finalize(handle_); }
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  void skip() { ++bound_; }  // leaves the next parameter NULL
  Statement& bind(std::int64_t v) { return check(sqlite3_bind_int64(handle_, ++bound_, v)); }
  template <std::integral T>
  Statement& bind(T v) {
    return bind(static_cast<std::int64_t>(v));
  }
  Statement& bind(double v) { return check(sqlite3_bind_double(handle_, ++bound_, v)); }
  Statement& bind(std::string_view v) {
    return check(sqlite3_bind_text(handle_, ++bound_, v.data(), static_cast<int>(v.size()),
                                   SQLITE_TRANSIENT));
  }
  // Binds an empty view as NULL (missing sensor). The bytes must remain valid until run().
  Statement& bind(ByteView v) {
    return check(v.empty() ? sqlite3_bind_null(handle_, ++bound_)
                           : sqlite3_bind_blob(handle_, ++bound_, v.data(),
                                               static_cast<int>(v.size()), SQLITE_STATIC));
  }
  // Advances to the next row. Returns false after the last row.
  bool step() {
    column_ = 0;
    const int code = sqlite3_step(handle_);
    if (code == SQLITE_ROW) return true;
    if (code == SQLITE_DONE) return false;
    sqlite_fail(db_, path_, "cannot read or write");
  }
  // Executes the whole statement, then resets all parameters to NULL.
  void run() {
    while (step()) {
    }
    restart();
  }
  // Ends the current execution and resets all parameters to NULL. `max_bytes`: see the
  // constructor.
  void restart(std::int64_t max_bytes = std::numeric_limits<std::int64_t>::max()) {
    sqlite3_reset(handle_);
    sqlite3_clear_bindings(handle_);
    bound_ = 0, bytes_left_ = max_bytes;
  }
  void skip_column() { ++column_; }
  void take(std::int64_t& value) { value = integer(); }
  void take(double& value) { value = real(); }
  void take(std::string& value) { value = text(); }
  void take(ByteView& value) { value = blob(); }
  bool next_is_null() { return sqlite3_column_type(handle_, column_) == SQLITE_NULL; }
  std::int64_t integer() { return sqlite3_column_int64(handle_, column_++); }
  double real() { return sqlite3_column_double(handle_, column_++); }
  std::string text() {
    const auto raw = blob();
    return {reinterpret_cast<const char*>(raw.data()), raw.size()};
  }
  ByteView blob() {
    const auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(handle_, column_));
    const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_, column_++));
    if ((bytes_left_ -= static_cast<std::int64_t>(size)) < 0) throw damaged(path_);
    return {data, data ? size : 0};
  }

 private:
  Statement& check(int code) {
    if (code != SQLITE_OK) sqlite_fail(db_, path_, "cannot bind a value");
    return *this;
  }
  sqlite3* db_;
  const std::string& path_;
  sqlite3_stmt* handle_ = nullptr;
  std::int64_t bytes_left_;
  int bound_ = 0, column_ = 0;
};

inline void execute(sqlite3* db, const std::string& path, const char* sql, const char* doing) {
  if (sqlite3_exec(db, sql, nullptr, nullptr, nullptr) != SQLITE_OK) sqlite_fail(db, path, doing);
}

}  // namespace echofuse::record
