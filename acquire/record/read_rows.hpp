// SPDX-License-Identifier: MIT
// Parts of rows that more than one question asks for.
#pragma once
#include <utility>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "acquire/record/sqlite.hpp"

namespace echofuse::record {

// The next columns: offset_s, span_s, used, lost and verdict of each sensor.
inline void read_sync(Statement& row, PerSensor<SensorSync>& sync) {
  for (SensorSync& y : sync) {
    y.offset_s = row.real();
    y.span_s = row.real();
    y.used = static_cast<std::uint64_t>(row.integer());
    y.lost = static_cast<std::uint64_t>(row.integer());
    y.verdict = row.text();
  }
}

// All rows, of utc, level, source and text.
inline std::vector<Event> read_events(Statement& rows) {
  std::vector<Event> out;
  while (rows.step()) {
    Event e;
    for (std::string* text : {&e.utc, &e.level, &e.source, &e.text}) *text = rows.text();
    out.push_back(std::move(e));
  }
  return out;
}

}  // namespace echofuse::record
