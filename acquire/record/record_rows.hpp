// SPDX-License-Identifier: MIT
// A fused record as rows of the tables in schema.hpp: record itself, and what stands beside it.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/record.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

class RecordRows {
 public:
  // Both must outlive this; the tables are there.
  RecordRows(sqlite3* db, const std::string& path);
  // Within a transaction of the caller. Throws Error(failed) for a valid sensor whose data do not
  // fit its axis.
  void insert(const FusedRecord& r, const std::vector<Axis>& axes);
  void reset() { record_.reset(); }  // releases the statement after a failure

 private:
  void insert_spd_status(const FusedRecord& r);
  void insert_radar_status(const FusedRecord& r);
  void insert_clocks(const FusedRecord& r);
  void insert_slot(const FusedRecord& r);
  void insert_signal(const FusedRecord& r);

  sqlite3* db_;
  const std::string& path_;
  Statement record_;
};

}  // namespace echofuse::record
