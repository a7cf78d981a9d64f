// SPDX-License-Identifier: MIT
#include "acquire/record/insert.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_tables.hpp"

namespace echofuse::record {

namespace {

constexpr int timeout_ms = 30'000;  // the recording process commits in milliseconds

}  // namespace

void mark(const std::string& path, const std::string& level, const std::string& text) {
  if (RunReader(path).info().status != "open")
    throw Error(ExitCode::failed,
                path + ": nobody is recording this run; only a live one is marked");
  sqlite3* db = nullptr;
  if (sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK)
    sqlite_fail(db, path, "cannot open for writing");
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> closing(db, sqlite3_close);
  harden(db);
  sqlite3_busy_timeout(db, timeout_ms);
  sqlite3_wal_autocheckpoint(db, 0);  // that is for the recording process
  Inserts(db, path)
      .into("event")
      .set("utc", iso8601(SystemClock().utc()))
      .set("level", level)
      .set("source", "mark")
      .set("text", text)
      .run();
}

}  // namespace echofuse::record
