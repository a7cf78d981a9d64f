// SPDX-License-Identifier: MIT
#include "acquire/record/recover.hpp"

#include <unistd.h>

#include <filesystem>

#include "acquire/record/run_guard.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/side_files.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {
namespace {

void fold_back(const std::string& path) {
  if (!RunReader(path).check().empty()) return;
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  const std::string crashed = std::string("UPDATE run SET status = 'crashed', ") + without_wal_key +
                              " WHERE status = 'open'";
  execute(db, path, crashed.c_str(), "cannot mark as crashed");
  execute(db, path, "PRAGMA journal_mode=DELETE", "cannot merge its WAL");
}

}  // namespace

void recover(const std::string& name) {
  const std::string path = real_path(name);
  // If the path were a FIFO, SQLite would block until another process opens it.
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) return;
  if (::access(path.c_str(), W_OK) != 0 || WriterLock::someone_writes(path) || is_closed(path))
    return;
  try {
    if (RunReader(path).info().status == crashed_without_wal) return;
    fold_back(path);
  } catch (const Error&) {  // the file is in use or not a run; the next reader reports the reason
  }
}

}  // namespace echofuse::record
