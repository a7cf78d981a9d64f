// SPDX-License-Identifier: MIT
// A run in some forty numbers that tell its laboratory: what the sensors measured against what the
// depth maps say that they should have seen.
#pragma once
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "acquire/record/record.hpp"
#include "sim/fit/surface.hpp"
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// The same names in the same order for every run with letters, or without. The radar's unit does
// not enter.
using Statistics = std::vector<std::pair<std::string, double>>;

// Records with nobody in them: means of the counts and powers, median of the maps; empty without.
struct EmptyRoom {
  std::vector<double> spd, radar;
  std::vector<std::uint16_t> depth_mm;
  std::int64_t records = 0;
  bool open() const;  // the map shows nothing: sensors see nothing that is to be taken off
};
EmptyRoom empty_room(const std::vector<record::FusedRecord>& records);

// One person, with or without a letter, seen by all three sensors.
bool shows_one_person(const record::FusedRecord& record);

// Of the records with one person, with or without a letter, whose three sensors are valid;
// `nominal` has their axes, the stated baseline and the stated resolution. Histogram: least squares
// of plate and body as their patches send light back, and the response that turns the patches'
// ranges into the mean histogram. Profile: least squares of plate, body, shift and width of the
// response. Throws Error(failed) with fewer than ten such records.
Statistics statistics_of(const std::vector<record::FusedRecord>& records, const EmptyRoom& empty,
                         const Conditions& nominal);

}  // namespace echofuse::sim
