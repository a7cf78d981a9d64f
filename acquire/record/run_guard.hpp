// SPDX-License-Identifier: MIT
// Checks a file before any of its content is trusted: line 1 of the threat model
// (acquire/RUN_FILE.md).
#pragma once
#include <cstdint>
#include <string>

struct sqlite3;

namespace echofuse::record {

inline constexpr int application_id = 0x4543464d;  // "ECFM" in ASCII
inline constexpr int format_version = 4;

// Limits for each SQL statement, because a crafted file may contain endless loops of pages and
// values of any length.
struct Budget {
  // Total and remaining budget, in units of 10,000 SQLite instructions.
  std::int64_t all = 0, left = 0;
  std::int64_t bytes = 0;  // maximum total size of the strings and blobs that are read
  int longest_value = 0;   // maximum size of a row or value, bytes

  static constexpr int instructions_a_step = 10'000;
  // Returns the budget for a run file with a size of `bytes`. SQLite needs less than one
  // instruction per byte to read a whole run.
  static Budget of_file(std::uint64_t bytes);
};

// Disables everything in the file that SQLite could execute, such as views and triggers. Must be
// called before the first statement.
void harden(sqlite3* db);
// Applies the budget: a statement that exceeds it fails with SQLITE_INTERRUPT. `budget` must
// outlive the database connection.
void limit(sqlite3* db, Budget& budget);

// Returns SQLITE_OK if SQLite can read the schema of the file.
int probe(sqlite3* db);
// Throws Error(failed) unless the file is a run file with the supported format version
// (`format_version`).
void check_identity(sqlite3* db, const std::string& path);
// Throws Error(failed) unless the file contains exactly the tables of a run, as defined in
// rows.hpp. Views, triggers, additional indices, virtual tables and computed columns are rejected.
void check_tables(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
