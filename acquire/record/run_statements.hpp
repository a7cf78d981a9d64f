// SPDX-License-Identifier: MIT
// What a RunWriter has prepared.
#pragma once
#include "acquire/record/insert.hpp"
#include "acquire/record/run_file.hpp"

namespace echofuse::record {

struct RunWriter::Statements {
  Statements(sqlite3* db, const std::string& path)
      : rows(db, path), begin(db, path, "BEGIN IMMEDIATE"), commit(db, path, "COMMIT") {}
  Inserts rows;
  Statement begin, commit;
};

}  // namespace echofuse::record
