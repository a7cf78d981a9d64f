// SPDX-License-Identifier: MIT
// Parts of rows that more than one question asks for.
#pragma once
#include <chrono>
#include <string>
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

// A slot ends a year at least before the last time that UtcTime holds, in 2262: what is within a
// year of it can be computed.
inline constexpr UtcTime last_slot_end = UtcTime::max() - std::chrono::years(1);

// The next columns: slot_start_ns, slot_end_ns and slot_utc_ns. Returns what is wrong with them, or
// nothing: sums and differences of what is not wrong do not overflow.
inline std::string read_slot(Statement& row, HostTime& start, HostTime& end, UtcTime& utc) {
  constexpr std::chrono::nanoseconds zero{0};
  for (std::chrono::nanoseconds* t : {&start, &end, &utc}) *t = HostTime(row.integer());
  const bool sound = start >= zero && end >= start && utc >= zero && utc <= last_slot_end &&
                     end - start <= last_slot_end - utc;
  if (sound) return {};
  return "its slot is from " + std::to_string(start.count()) + " to " +
         std::to_string(end.count()) + " ns, at " + std::to_string(utc.count()) +
         " ns of UTC; expected an end after the start, and the years 1970 to 2261";
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
