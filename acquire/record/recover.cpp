// SPDX-License-Identifier: MIT
#include <unistd.h>

#include "acquire/record/run_file.hpp"
#include "acquire/record/run_guard.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {
namespace {

void fold_back(const std::string& path) {
  if (!RunReader(path).check().empty()) return;
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  execute(db, path, "UPDATE run SET status = 'crashed' WHERE status = 'open'",
          "cannot mark as crashed");
  execute(db, path, "PRAGMA journal_mode=DELETE", "cannot fold its WAL back");
}

}  // namespace

void recover(const std::string& path) {
  const auto may = [&](const std::string& name, int mode) {
    return ::access(name.c_str(), mode) == 0;
  };
  if (!may(path + "-wal", F_OK) || !may(path, W_OK) || WriterLock::someone_writes(path) ||
      is_closed(path))
    return;
  try {
    fold_back(path);
  } catch (const Error&) {  // another program reads it, or it is no run: reading it will tell
  }
}

}  // namespace echofuse::record
