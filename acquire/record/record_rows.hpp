// SPDX-License-Identifier: MIT
// A fused record as rows of the tables in schema.hpp: record itself, and what stands beside it.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/insert.hpp"
#include "acquire/record/record.hpp"

namespace echofuse::record {

// Within a transaction of the caller; the tables are there. Throws Error(failed) for a valid sensor
// whose data do not fit its axis.
void insert_record(Inserts& rows, const std::string& path, const FusedRecord& r,
                   const std::vector<Axis>& axes);

}  // namespace echofuse::record
