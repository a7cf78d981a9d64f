// SPDX-License-Identifier: MIT
// Common parts of the tests in this folder: temporary folder, program calls and sample records.
#pragma once
#include <sqlite3.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "../catch.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/util/exit_code.hpp"

namespace testing {

namespace fs = std::filesystem;

using echofuse::test::contents;
using echofuse::test::Folder;
using echofuse::test::has;
using echofuse::test::Outcome;
using echofuse::test::shell;

inline void write_file(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

inline void sql(const std::string& path, const std::string& statement) {
  sqlite3* db = nullptr;
  REQUIRE(sqlite3_open(path.c_str(), &db) == SQLITE_OK);
  REQUIRE(sqlite3_exec(db, statement.c_str(), nullptr, nullptr, nullptr) == SQLITE_OK);
  sqlite3_close(db);
}

inline Outcome acquire(const std::string& arguments) {
  return shell(echofuse::test::bin_dir + "/echofuse-acquire " + arguments);
}

// Returns the exit code and the message of the Error thrown by `body`. Returns ok if `body` does
// not throw an Error.
template <class Body>
std::pair<echofuse::ExitCode, std::string> error_of(Body body) {
  try {
    body();
  } catch (const echofuse::Error& e) {
    return {e.code(), e.what()};
  }
  return {echofuse::ExitCode::ok, ""};
}

// Returns axes for 8 SPD bins, 4 radar bins and 3 x 2 depth pixels.
inline std::vector<echofuse::Axis> small_axes() {
  return {{"spd", "counts", "ps", 8, 13343, 100, 1},
          {"radar", "log2_q8", "m", 4, 0, 0.5, 12},
          {"depth_x", "tangent", "1", 3, -0.2, 0.2, 1},
          {"depth_y", "tangent", "1", 2, 0.1, -0.2, 1}};
}

// Returns a record in which all three sensors are valid and every value depends on `index`.
inline echofuse::record::FusedRecord small_record(std::int64_t index) {
  using echofuse::HostTime;
  const auto i = static_cast<std::uint32_t>(index);
  echofuse::record::FusedRecord r;
  r.index = index;
  r.slot_start = HostTime(1000 * index);
  r.slot_end = HostTime(1000 * (index + 1));
  r.slot_utc = HostTime(1'700'000'000'000'000'000 + 1000 * index);
  r.valid = echofuse::SensorSet::from_bits(7);
  r.label = index % 2 ? "letter:A" : "person";
  for (std::uint32_t b = 0; b < 8; ++b) r.spd.push_back(i * 100 + b);
  for (std::uint32_t b = 0; b < 4; ++b) r.radar.push_back(static_cast<float>(i + b) + 0.25f);
  for (std::uint32_t p = 0; p < 6; ++p) r.depth_mm.push_back(static_cast<std::uint16_t>(i * 6 + p));
  r.spd_counts = {.tags = 1000 + i,
                  .starts = 900,
                  .in_range = 60 + i,
                  .out_of_range = 20,
                  .without_start = 15,
                  .other = 5};
  for (const echofuse::Sensor sensor : echofuse::all_sensors) {
    const auto s = static_cast<std::size_t>(sensor);
    r.sync[sensor] = {0.125 * static_cast<double>(s), 0.5, 60 + i + s, s, "ok"};
  }
  return r;
}

// Checks that all columns and arrays of the two records are equal. Defined in run_rows.cpp.
void check_same(const echofuse::record::FusedRecord& read,
                const echofuse::record::FusedRecord& wrote);

inline void write_run(const std::string& path, std::int64_t records,
                      const std::string& status = "complete") {
  echofuse::record::RunInfo info;
  info.window_s = 0.2;
  info.notes = "a test";
  info.config_resolved = "window_s = 0.2\n";
  echofuse::record::RunWriter run(path, info);
  for (const auto& axis : small_axes()) run.put_axis(axis);
  for (std::int64_t i = 0; i < records; ++i) run.append(small_record(i));
  run.close(status);
}

}  // namespace testing
