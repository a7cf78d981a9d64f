// SPDX-License-Identifier: MIT
// A copy of a run whose file was removed, replaced or damaged while it was written: the open
// connection still reaches what was committed.
#pragma once
#include <sqlite3.h>

#include <cstdint>
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::record {

struct Rescue {
  bool whole = false;  // every committed record is in the copy
  std::string text;    // message: path and state of the rescue, or why there is none
};

// Makes NAME.rescued.sqlite (-2, -3 ... if there is one) beside `path`, or in the current folder if
// that folder is gone, with this status; `records` were committed. Never throws.
Rescue rescue(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended,
              std::int64_t records);

// The run's status and its end. Throws Error.
void put_end(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended);

// Result of SQLite's quick check of the database as it is on disk; empty if sound.
std::string damage(sqlite3* db, const std::string& path);

std::int64_t count_records(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
