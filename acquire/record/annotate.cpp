// SPDX-License-Identifier: MIT
#include "acquire/record/rows.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_guard.hpp"

namespace echofuse::record {

namespace {

constexpr int timeout_ms = 30'000;  // the recording process commits in milliseconds

[[noreturn]] void refuse_closed(const std::string& path) {
  throw Error(ExitCode::failed,
              path + ": nobody is recording this run; only a live one gets another label");
}

void put(const std::string& path, const std::string& level, const std::string& text,
         const std::string& who) {
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  sqlite3_busy_timeout(db, timeout_ms);
  sqlite3_wal_autocheckpoint(db, 0);  // that is for the recording process
  execute(db, path, "BEGIN IMMEDIATE", "cannot write");
  // Refuses a label for a closed run, because labels are read when the run closes.
  if (level == "label" && !Statement(db, path, "SELECT 1 FROM run WHERE status = 'open'").step())
    refuse_closed(path);
  insert(db, path, Event{iso8601(system_clock.utc()), level, who, text});
  execute(db, path, "COMMIT", "cannot write");
}

}  // namespace

void put_note(const std::string& path, const std::string& text, const std::string& who) {
  static_cast<void>(RunReader(path));  // throws unless PATH is a run file
  put(path, "note", text, who);
}

void put_label(const std::string& path, const std::string& label, const std::string& who) {
  if (RunReader(path).info().status != "open") refuse_closed(path);
  put(path, "label", label, who);
}

}  // namespace echofuse::record
