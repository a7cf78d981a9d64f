// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <memory>

#include "acquire/record/run_file.hpp"
#include "acquire/record/run_tables.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {

std::int64_t recover(const std::string& path) {
  std::int64_t records = 0;
  bool crashed = false;
  {
    const RunReader run(path);
    if (const std::string fault = run.check(); !fault.empty())
      throw Error(ExitCode::failed, printable(path) + ": damaged: " + printable(fault, 200));
    records = run.count();
    const std::string status = run.info().status;
    crashed = status == "crashed";
    if (status == "open" || (!crashed && ::access((path + "-wal").c_str(), F_OK) != 0))
      return records;
  }
  const WriterLock lock(path);
  if (!lock.held())
    throw Error(ExitCode::failed, printable(path) + ": is being written; stop the run first");
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  if (crashed) execute(db, path, "UPDATE run SET status = 'crashed'", "cannot mark as crashed");
  execute(db, path, "PRAGMA journal_mode=DELETE", "cannot fold its WAL back");
  return records;
}

}  // namespace echofuse::record
