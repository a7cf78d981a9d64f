// SPDX-License-Identifier: MIT
// Checks of a file before anything in it is believed: line 1 of the threat model
// (acquire/README.md).
#pragma once
#include <cstdint>
#include <string>

struct sqlite3;

namespace echofuse::record {

// Limits of one statement. Pages of a crafted file may point at each other without an end, and a
// value may have any length.
struct Budget {
  std::int64_t all = 0, left = 0;  // in steps of instructions_a_step
  std::int64_t bytes = 0;          // texts and blobs together
  int longest_value = 0;           // bytes

  static constexpr int instructions_a_step = 10'000;
  // Budget for a run of `bytes`. SQLite needs less than one instruction a byte of a whole run.
  static Budget of_file(std::uint64_t bytes);
};

// Call before the first statement: nothing in the file runs by itself.
void harden(sqlite3* db);
// A statement that spends the steps ends with SQLITE_INTERRUPT. The budget outlives the database.
void limit(sqlite3* db, Budget& budget);

// Returns SQLITE_OK if SQLite can read the names of the file's tables.
int look(sqlite3* db);
// Throws Error(failed) unless it is a run file of this format.
void check_identity(sqlite3* db, const std::string& path);
// Throws Error(failed) unless the file holds the tables of a run (rows.hpp), made by our words, and
// nothing else: no views, triggers, indices of its own, virtual tables, computed columns.
void check_tables(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
