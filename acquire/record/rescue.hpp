// SPDX-License-Identifier: MIT
// Copy of a run with a file that was removed, replaced or damaged while being written. The open
// connection can still read the committed data.
#pragma once
#include <sqlite3.h>

#include <cstdint>
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::record {

struct Rescue {
  bool whole = false;  // the copy has all committed records
  std::string text;    // message: path and state of the copy, or the reason for its absence
};

// Creates NAME.rescued.sqlite (-2, -3 ... if it exists) next to `path`, or in the current folder if
// that folder is missing, with this status. `records`: number of committed records. Never throws.
Rescue rescue(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended,
              std::int64_t records);

// Sets the run's status and end. Throws Error.
void put_end(sqlite3* db, const std::string& path, const std::string& status, UtcTime ended);

// Returns the result of SQLite's quick check of the database on disk; empty if sound.
std::string damage(sqlite3* db, const std::string& path);

std::int64_t count_records(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
