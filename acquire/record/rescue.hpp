// SPDX-License-Identifier: MIT
// Copies a run after its file was removed, replaced or damaged during the recording. The open
// connection can still read the committed data.
#pragma once
#include <sqlite3.h>

#include <cstdint>
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::record {

struct Rescue {
  bool whole = false;  // true if the copy contains all committed records
  // Message with the path and the state of the copy, or with the reason why the copy is missing.
  std::string text;
};

// Copies the run to NAME.rescued.sqlite next to `path` (NAME.rescued-2.sqlite if it exists, and so
// on). If the folder of `path` is missing, the copy is in the current folder. `status` is the
// status to be stored in the copy, and `records` the number of committed records. Never throws.
Rescue rescue(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended,
              std::int64_t records);

// Sets the status and the end time of the run. Throws Error.
void put_end(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended);

// Runs SQLite's quick check on the database file. Returns the first error; empty if the file is
// undamaged.
std::string damage(sqlite3* db, const std::string& path);

std::int64_t count_records(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
