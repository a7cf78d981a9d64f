// SPDX-License-Identifier: MIT
// What is asked of a file before anything in it is believed: line 1 of the threat model
// (acquire/README.md).
#pragma once
#include <cstdint>
#include <string>

struct sqlite3;

namespace echofuse::record {

// What one statement may do. A crafted file can be walked through for ever, and a value be of any
// length: pages may point at each other and at themselves.
struct Budget {
  std::int64_t all = 0, left = 0;  // in steps of instructions_a_step
  std::int64_t bytes = 0;          // of the texts and blobs that it gives
  int longest_value = 0;           // bytes

  static constexpr int instructions_a_step = 10'000;
  // For a run of this size. SQLite needs less than an instruction for each byte of a whole run.
  static Budget of_file(std::uint64_t bytes);
};

// Before the first statement: nothing in the file runs by itself.
void harden(sqlite3* db);
// A statement that spends the steps ends with SQLITE_INTERRUPT. The budget outlives the database.
void limit(sqlite3* db, Budget& budget);

// Throws Error(failed) unless the file holds only tables of a run (schema.hpp), with columns of
// theirs, as SQLite itself tells: no views, triggers, indices of its own, virtual tables, computed
// columns. CHECKs are never asked (harden).
void check_tables(sqlite3* db, const std::string& path);

}  // namespace echofuse::record
