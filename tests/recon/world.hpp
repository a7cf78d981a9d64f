// SPDX-License-Identifier: MIT
// A small scene for tests: a plate at (x, z), an SPD at the origin, and a radar to the left of the
// SPD. There are few bins and the plates are coarse, so that training takes a fraction of a second.
#pragma once
#include <sqlite3.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "../catch.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/random.hpp"
#include "recon/data/dataset.hpp"

namespace echofuse::testing {

using test::contents;
using test::Folder;
using test::Outcome;

// Calls `body`. Returns the message of the Error thrown by `body`, or "no error" if it does not
// throw.
inline std::string error_of(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

inline Axis spd_axis() { return {"spd", "counts", "ps", 30, 16000, 400, 1}; }
inline Axis radar_axis(std::uint32_t bins = 24) {
  return {"radar", "power", "m", bins, 0, 0.25, 1};
}

inline record::FusedRecord plate_record(std::int64_t index, double x, double z, Rng& rng) {
  const auto bump = [](double at, double centre, double width) {
    return std::exp(-std::pow((at - centre) / width, 2));
  };
  record::FusedRecord r;
  r.index = index;
  r.label = index % 4 ? "letter:A" : "person";
  const double range = std::hypot(x, z), radar_range = std::hypot(x + 0.5, z);
  for (std::uint32_t i = 0; i < spd_axis().count; ++i) {
    const double at = spd_axis().at(i + 0.5) * 1e-12 * speed_of_light_m_s / 2;
    std::poisson_distribution<std::uint32_t> counts(1 + 2e4 * bump(at, range, 0.2));
    r.spd.push_back(counts(rng));
  }
  std::normal_distribution<float> noise(0, 0.002f);
  for (std::uint32_t i = 0; i < radar_axis().count; ++i)
    r.radar.push_back(static_cast<float>(bump(radar_axis().at(i), radar_range, 0.4)) + noise(rng));
  r.depth_mm.assign(64 * 64, 0);
  const Axis tangent = record::MapGrid{}.x();
  for (std::size_t row = 20; row < 44; ++row)
    for (std::size_t c = 0; c < 64; ++c)
      if (std::abs(tangent.at(static_cast<double>(c)) - x / z) < 0.09)
        r.depth_mm[row * 64 + c] = static_cast<std::uint16_t>(std::lround(z * 1000));
  for (const Sensor s : all_sensors) r.valid.insert(s), r.sync[s].verdict = "ok";
  return r;
}

// Adds the samples of a row of antennas at the position of the radar. In every frame, the left,
// middle and right parts of the plate each have a random phase.
inline void add_array(record::FusedRecord& r, double x, double z, const record::Antennas& antennas,
                      Rng& rng) {
  const Axis axis = record::array_axis(radar_axis(), antennas.size());
  record::ArrayStatistics sums(axis.count, antennas.size());
  std::uniform_real_distribution<float> phase(0, 2 * static_cast<float>(M_PI));
  std::normal_distribution<float> noise(0, 0.02f);
  for (int frame = 0; frame < 30; ++frame) {
    std::vector<std::complex<float>> samples;
    std::vector<std::complex<float>> echoes;
    for (int part = 0; part < 3; ++part) echoes.push_back(std::polar(0.58f, phase(rng)));
    for (std::uint32_t b = 0; b < axis.count; ++b)
      for (const record::Antenna& a : antennas) {
        std::complex<float> sum(noise(rng), noise(rng));
        for (int part = 0; part < 3; ++part) {
          const double at_x = x + 0.5 + (part - 1) * 0.06 * z, range_m = std::hypot(at_x, z);
          const double off = (axis.at(b) - std::hypot(x + 0.5, z)) / 0.4;
          sum += echoes[static_cast<std::size_t>(part)] *
                 std::polar(static_cast<float>(a.gain * std::exp(-off * off / 2)),
                            static_cast<float>(M_PI * a.x * at_x / range_m + a.phase_rad));
        }
        samples.push_back(sum);
      }
    sums.add(samples);
  }
  r.array_frames = sums.frames();
  r.array = sums.take();
}

using Change = std::function<void(record::FusedRecord&)>;

// Writes a run of `count` records. Each record shows a plate at a random position. `change` may
// modify each record before the record is written.
inline void write_run(const std::string& path, std::int64_t count, std::uint64_t seed = 1,
                      const Change& change = {}, const Axis& radar = radar_axis(),
                      const Axis& spd = spd_axis(),
                      const std::vector<record::CalibrationEntry>& calibration = {},
                      const record::Antennas& antennas = {}) {
  record::RunWriter run(path, {});
  for (const auto& entry : calibration) run.put_calibration(entry);
  for (const Axis& axis : {spd, radar, record::MapGrid{}.x(), record::MapGrid{}.y()})
    run.put_axis(axis);
  if (!antennas.empty()) {
    run.put_axis(record::array_axis(radar, antennas.size()));
    run.put_antennas(antennas);
  }
  Rng rng = make_rng(seed, 7), of_array = make_rng(seed, 8);
  std::uniform_real_distribution<double> x(-1, 1), z(3, 4);
  std::vector<record::FusedRecord> records;
  for (std::int64_t i = 0; i < count; ++i) {
    const double at = x(rng), at_z = z(rng);
    records.push_back(plate_record(i, at, at_z, rng));
    if (!antennas.empty()) add_array(records.back(), at, at_z, antennas, of_array);
    records.back().radar.resize(radar.count);
    records.back().spd.resize(spd.count);
    if (change) change(records.back());
  }
  run.append(records);
  run.close("complete");
}

// Returns the data of a run written by write_run().
inline recon::Dataset load_plates(std::int64_t count) {
  const Folder dir;
  write_run(dir / "plates", count);
  return recon::load({dir / "plates"});
}

inline bool all_finite(std::span<const float> values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

// Runs an SQL statement on an SQLite file. Returns the values of the first column, one per line.
inline std::string sql(const std::string& path, const std::string& statement) {
  sqlite3* db = nullptr;
  REQUIRE(sqlite3_open(path.c_str(), &db) == SQLITE_OK);
  sqlite3_busy_timeout(db, 5000);
  std::string out;
  const auto add = [](void* text, int, char** values, char**) {
    static_cast<std::string*>(text)->append(values[0] ? values[0] : "").append("\n");
    return 0;
  };
  CAPTURE(statement);
  REQUIRE(sqlite3_exec(db, statement.c_str(), add, &out, nullptr) == SQLITE_OK);
  sqlite3_close(db);
  return out;
}

inline Outcome recon_program(const std::string& arguments) {
  return test::shell(test::bin_dir + "/echofuse-recon " + arguments);
}

// Runs echofuse-recon and checks its exit code and error message. The message must be a single
// line, or at most three lines (including the usage) if the code is 2.
inline void refuses(const std::string& arguments, int code, const std::string& saying) {
  const Outcome o = recon_program(arguments);
  CAPTURE(arguments);
  CHECK(o.code == code);
  CHECK_THAT(o.text, Catch::Contains(saying));
  CHECK(std::count(o.text.begin(), o.text.end(), '\n') <= (code == 2 ? 3 : 1));
}

// Starts echofuse-recon without waiting for it to exit.
inline pid_t start_recon(std::vector<std::string> words) {
  words.insert(words.begin(), "echofuse-recon");
  std::vector<char*> arguments;
  for (auto& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    execv((echofuse::test::bin_dir + "/echofuse-recon").c_str(), arguments.data());
    _exit(127);
  }
  return child;
}

// Sends SIGINT to a program and returns its exit code.
inline int interrupted_code(pid_t child) {
  kill(child, SIGINT);
  int status = 0;
  waitpid(child, &status, 0);
  REQUIRE(WIFEXITED(status));
  return WEXITSTATUS(status);
}

}  // namespace echofuse::testing
