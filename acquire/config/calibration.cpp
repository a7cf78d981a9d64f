// SPDX-License-Identifier: MIT
#include "acquire/config/calibration.hpp"

#include <algorithm>
#include <array>

#include "acquire/measurement/radar_array.hpp"
#include "drivers/radar/sdk.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {
namespace {

constexpr char baseline_key[] = "radar.baseline_m";
constexpr char baseline_text[] = "value of radar.baseline_m during the measurement";

constexpr Sensor ranging[] = {Sensor::spd, Sensor::radar};

void bind(Settings& s, const std::string& section, record::CalibrationEntry& e) {
  constexpr double max_m = 1000;
  s.add(section + ".date_utc", e.date_utc, "time of the measurement");
  s.add(section + ".method", e.method, "estimator");
  s.add(section + ".distance_m", e.distance_m, 0, max_m, "true distance of the reflector");
  s.add(section + ".offset_m", e.offset_m, -max_m, max_m, "measured minus true range");
  s.add(section + ".standard_error_m", e.standard_error_m, 0, max_m,
        "standard error of the offset");
  s.add(section + ".model", e.model, "model of the device");
  s.add(section + ".serial", e.serial, "serial number of the device");
}

// Lists of numbers, each stored as one string, because a setting can hold only a single value.
struct AntennaTexts {
  std::string gain, phase_rad, standard_error;
};

void bind(Settings& s, AntennaGains& a, AntennaTexts& t) {
  s.add("antennas.date_utc", a.date_utc, "time of the measurement");
  s.add("antennas.distance_m", a.distance_m, 0, 1000, "true distance of the reflector");
  s.add("antennas.sine", a.sine, -1, 1, "sine of the reflector's direction, positive to the right");
  s.add("antennas.gain", t.gain, "gain of each antenna of the heat map, relative to antenna 0");
  s.add("antennas.phase_rad", t.phase_rad,
        "phase of each antenna's samples, relative to antenna 0");
  s.add("antennas.standard_error", t.standard_error,
        "standard error of phase (rad) and relative gain");
}

// Keys and values of the section [response], in the format of a run's metadata.
using Texts = std::vector<std::pair<std::string, std::string>>;

void bind(Settings& s, Texts& response) {
  for (auto& [key, text] : response)
    s.add("response." + key, text, "number +- standard error, as in the metadata of a run");
}

void bind_spd_axis(Settings& s, Axis& spd) {
  s.add("axes.bin_width_ps", spd.step, 0, 1e9, "bin width of the histogram");
  s.add("axes.first_bin_ps", spd.start, -1e12, 1e12, "start of bin 0 of the histogram");
  s.add("axes.bins", spd.count, 0, 1 << 24, "number of bins of the histogram");
}

void bind_radar_axis(Settings& s, Axis& radar) {
  s.add("axes.radar_step_m", radar.step, 0, 1000, "distance between points of the profile");
  s.add("axes.radar_bins", radar.count, 0, 1 << 24, "number of points of the profile");
}

void bind(Settings& s, std::string& line, std::int64_t& lines) {
  s.add("firmware.line", line,
        "mean of the compRangeBiasAndRxChanPhase lines that the radar reported");
  s.add("firmware.lines", lines, 0, 1'000'000'000, "number of lines averaged in firmware.line");
}

std::string text_of(const std::vector<double>& values) {
  std::string out;
  for (const double v : values) out += format("%s%.6g", out.empty() ? "" : " ", v);
  return out;
}

// Parses 1 to 12 numbers, each between `minimum` and `maximum`. Returns an empty list if the string
// is invalid.
std::vector<double> values_of(const std::string& text, double minimum, double maximum) {
  const std::vector<double> out = numbers_in(text);
  const bool valid = out.size() <= record::max_antennas && std::ranges::all_of(out, [&](double v) {
                       return v >= minimum && v <= maximum;
                     });
  return valid ? out : std::vector<double>{};
}

void take_antennas(const std::string& path, const AntennaTexts& texts, AntennaGains& out) {
  out.gain = values_of(texts.gain, 1e-3, 1e3);
  out.phase_rad = values_of(texts.phase_rad, -100, 100);
  out.standard_error = values_of(texts.standard_error, 0, 100);
  if (out.gain.empty() || out.gain.size() != out.phase_rad.size() ||
      out.gain.size() != out.standard_error.size())
    throw Error(ExitCode::config,
                path +
                    ": antennas.gain, antennas.phase_rad and antennas.standard_error: expected "
                    "lists of equal length, one number for each of 1 to 12 antennas");
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
  out.baseline_m = find(Sensor::radar) ? baseline_m : older.baseline_m;
  out.firmware = firmware ? firmware : older.firmware;
  out.antennas = antennas.empty() ? older.antennas : antennas;
  const record::Response &pulse = response.irf_fwhm_ps.value > 0 ? response : older.response,
                         &echo = response.radar.known() ? response : older.response;
  out.response = {pulse.irf_fwhm_ps, pulse.irf_tail_ps,        pulse.irf_tail_share,
                  echo.radar,        echo.taps_standard_error, echo.radar_noise_exponent};
  out.axes = {axes.spd.count > 0 ? axes.spd : older.axes.spd,
              axes.radar.count > 0 ? axes.radar : older.axes.radar};
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
  bind(settings, line, firmware.lines);
  Calibration out;
  settings.add(baseline_key, out.baseline_m, 0, max_baseline_m, baseline_text);
  AntennaTexts texts;
  bind(settings, out.antennas, texts);
  bind_spd_axis(settings, out.axes.spd);
  bind_radar_axis(settings, out.axes.radar);
  Texts stated;
  for (const char* key : record::response_keys) stated.emplace_back(key, "");
  bind(settings, stated);
  settings.read_file(path);
  std::erase_if(stated, [](const auto& pair) { return pair.second.empty(); });
  out.response = record::response_of(stated);
  if (!record::is_response(stated))
    throw Error(ExitCode::config, path +
                                      ": section response: expected the numbers that `calibrate` "
                                      "writes (radar_taps: 3 to 64 numbers with a peak of 1)");
  if (settings.given("antennas.gain") || settings.given("antennas.phase_rad"))
    take_antennas(path, texts, out.antennas);
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (settings.given(name_of(ranging[i]) + std::string(".offset_m")))
      out.entries.push_back(entries[i]);
  if (out.entries.empty())
    throw Error(ExitCode::config,
                path + ": contains no offset; expected spd.offset_m or radar.offset_m");
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
  double baseline_m = calibration.baseline_m;
  if (baseline_m > 0) settings.add(baseline_key, baseline_m, 0, max_baseline_m, baseline_text);
  std::string line;
  std::int64_t lines = 0;
  if (const auto& f = calibration.firmware) {
    line = radar::to_line(*f);
    lines = f->lines;
    bind(settings, line, lines);
  }
  AntennaGains antennas = calibration.antennas;
  AntennaTexts texts{text_of(antennas.gain), text_of(antennas.phase_rad),
                     text_of(antennas.standard_error)};
  if (!antennas.empty()) bind(settings, antennas, texts);
  CalibratedAxes axes = calibration.axes;
  if (axes.spd.count > 0) bind_spd_axis(settings, axes.spd);
  if (axes.radar.count > 0) bind_radar_axis(settings, axes.radar);
  Texts response = calibration.response.meta();
  for (auto& [key, text] : response)
    settings.add("response." + key, text, "number +- standard error");
  write_atomically(path, settings.resolved(true));
}

}  // namespace echofuse::acquire
