// SPDX-License-Identifier: MIT
#include "acquire/calibration.hpp"

#include <array>

#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/settings.hpp"
#include "drivers/radar/firmware_bias.hpp"

namespace echofuse::acquire {
namespace {

constexpr Sensor ranging[] = {Sensor::spd, Sensor::radar};

void bind(Settings& s, const std::string& section, record::CalibrationEntry& e) {
  constexpr double most_m = 1000;
  s.add(section + ".date_utc", e.date_utc, "when it was measured");
  s.add(section + ".method", e.method, "estimator");
  s.add(section + ".distance_m", e.distance_m, 0, most_m, "true distance of the reflector");
  s.add(section + ".offset_m", e.offset_m, -most_m, most_m, "measured minus true range");
  s.add(section + ".standard_error_m", e.standard_error_m, 0, most_m, "of the offset");
}

}  // namespace

const record::CalibrationEntry* Calibration::find(Sensor sensor) const {
  for (const auto& e : entries)
    if (e.sensor == sensor) return &e;
  return nullptr;
}

Calibration Calibration::over(const Calibration& older) const {
  Calibration out;
  for (const Sensor sensor : ranging)
    if (const auto* e = find(sensor) ? find(sensor) : older.find(sensor)) out.entries.push_back(*e);
  out.firmware = firmware ? firmware : older.firmware;
  return out;
}

Calibration read_calibration(const std::string& path) {
  std::array<record::CalibrationEntry, 2> entries;
  FirmwareBias firmware;
  std::string line;
  Settings settings;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    entries[i].sensor = ranging[i];
    bind(settings, name_of(ranging[i]), entries[i]);
  }
  settings.add("firmware.line", line, "mean of the radar's own compRangeBiasAndRxChanPhase lines");
  settings.add("firmware.lines", firmware.lines, 0, 1'000'000'000, "how many came");
  settings.read_file(path);
  Calibration out;
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (settings.given(name_of(ranging[i]) + std::string(".offset_m")))
      out.entries.push_back(entries[i]);
  if (out.entries.empty())
    throw Error(ExitCode::config, path + ": no offset; expected spd.offset_m or radar.offset_m");
  if (line.empty()) return out;
  out.firmware = radar::parse_firmware_bias(line);
  if (!out.firmware)
    throw Error(ExitCode::config,
                path + ": firmware.line is not a compRangeBiasAndRxChanPhase command");
  out.firmware->lines = firmware.lines;
  return out;
}

void write_calibration(const std::string& path, const Calibration& calibration) {
  auto entries = calibration.entries;
  Settings settings;
  for (auto& e : entries) bind(settings, name_of(e.sensor), e);
  std::string line;
  std::int64_t lines = 0;
  if (const auto& f = calibration.firmware) {
    line = radar::to_line(*f);
    lines = f->lines;
    settings.add("firmware.line", line,
                 "mean of the radar's own compRangeBiasAndRxChanPhase lines");
    settings.add("firmware.lines", lines, 0, 1'000'000'000, "how many came");
  }
  write_atomically(path, settings.resolved(true));
}

}  // namespace echofuse::acquire
