// SPDX-License-Identifier: MIT
// Checks a file before any of its content is trusted: line 1 of the threat model
// (acquire/README.md).
#pragma once
#include <cstdint>
#include <string>

struct sqlite3;

namespace echofuse::record {

// Limits per statement. Pages of a crafted file may form endless loops, and values may have any
// length.
struct Budget {
  std::int64_t all = 0, left = 0;  // in units of instructions_a_step
  std::int64_t bytes = 0;          // total of texts and blobs
  int longest_value = 0;           // bytes

  static constexpr int instructions_a_step = 10'000;
  // Budget for a run of `bytes`. Reading a whole run takes SQLite less than one instruction per
  // byte.
  static Budget of_file(std::uint64_t bytes);
};

// Call before the first statement. Disables everything in the file that could be executed.
void harden(sqlite3* db);
// A statement that exceeds the budget ends with SQLITE_INTERRUPT. The budget must outlive the
// database.
void limit(sqlite3* db, Budget& budget);

// Returns SQLITE_OK if SQLite can read the names of the file's tables.
int probe(sqlite3* db);
// Throws Error(failed) unless it is a run file of this format.
void check_identity(sqlite3* db, const std::string& path);
// Throws Error(failed) unless the file contains exactly the tables of a run (rows.hpp) as we define
// them: no views, triggers, additional indices, virtual tables or computed columns.
void check_tables(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
