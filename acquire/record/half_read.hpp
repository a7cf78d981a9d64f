// SPDX-License-Identifier: MIT
// A record's row, and from it the record, in two steps: all but the depth picture, and that, which
// takes most of the time and may be done on another thread.
#pragma once
#include <string>
#include <vector>

#include "acquire/record/record.hpp"
#include "acquire/record/sqlite.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

// What of a run's axes decodes its records, looked up once per pass.
struct Shapes {
  std::size_t spd = 0, radar = 0;
  std::uint32_t width = 0, height = 0;
  std::size_t array = 0, antennas = 0;

  explicit Shapes(const std::vector<Axis>& axes);
  // So many records that they are worth a thread's start, of at most 16 M pixels in all.
  std::size_t records_at_once() const;
};

// What the tables of a file have beside its records; older files lack it.
struct Extras {
  bool signal, array, speckle, lag;  // lag: of the speckle, over_150_ms
};
// The records from index ? on, in order, as HalfRead takes them.
std::string record_query(const Extras& has);

struct HalfRead {
  FusedRecord record;
  std::string fault;  // what is wrong with it, or nothing
  Bytes png;

  void read(Statement& row, const Shapes& shapes, SensorSet sensors);
  void decode_depth(const Shapes& shapes);  // of a record without a fault
};

}  // namespace echofuse::record
