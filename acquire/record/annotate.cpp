// SPDX-License-Identifier: MIT
#include "acquire/record/insert.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_tables.hpp"

namespace echofuse::record {

namespace {

constexpr int timeout_ms = 30'000;  // the recording process commits in milliseconds

void put(const std::string& path, const char* level, const std::string& text,
         const std::string& who) {
  const DatabaseHandle file = open_database(path, "cannot open for writing");
  sqlite3* const db = file.get();
  harden(db);
  sqlite3_busy_timeout(db, timeout_ms);
  sqlite3_wal_autocheckpoint(db, 0);  // that is for the recording process
  Inserts(db, path)
      .into("event")
      .set("utc", iso8601(system_clock.utc()))
      .set("level", level)
      .set("source", who)
      .set("text", text)
      .run();
}

}  // namespace

void put_note(const std::string& path, const std::string& text, const std::string& who) {
  static_cast<void>(RunReader(path));  // it is a run file
  put(path, "note", text, who);
}

void put_label(const std::string& path, const std::string& label, const std::string& who) {
  if (RunReader(path).info().status != "open")
    throw Error(ExitCode::failed,
                path + ": nobody is recording this run; only a live one gets another label");
  put(path, "label", label, who);
}

}  // namespace echofuse::record
