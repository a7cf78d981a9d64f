// SPDX-License-Identifier: MIT
#include "acquire/config/calibration.hpp"

#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

Calibration whole_calibration(double offset_m) {
  Calibration c;
  for (const Sensor s : {Sensor::spd, Sensor::radar})
    c.entries.push_back({s, "2026-11-21T10:00:00Z", "some method", 1.5, offset_m, 2e-4, "M", "7"});
  c.firmware = FirmwareBias{offset_m, {1, 0, -0.5, 0.25}, 7};
  c.antennas = {"2026-11-22T10:00:00Z", 1, 0.447214, {1, 0.0015, 912.345}, {-99, offset_m, 99},
                {0, 0.00123, 99}};
  c.axes = {spd_axis(336, 13343, offset_m), range_axis("power_with_noise", 64, 0, 0.234375)};
  c.response.irf_fwhm_ps = {203.5, 1.5}, c.response.radar = {0.05, {1, 0.75, offset_m}};
  c.baseline_m = offset_m;
  return c;
}

// Returns the values for which Calibration and its parts have no operator==.
std::vector<double> numbers(const Calibration& c) {
  const FirmwareBias firmware = c.firmware.value_or(FirmwareBias{});
  std::vector<double> out{c.baseline_m, c.antennas.distance_m, c.antennas.sine,
                          firmware.range_bias_m, static_cast<double>(firmware.lines)};
  for (const auto& list :
       {c.antennas.gain, c.antennas.phase_rad, c.antennas.standard_error, firmware.re_im})
    out.insert(out.end(), list.begin(), list.end());
  for (const Axis& axis : {c.axes.spd, c.axes.radar})
    out.insert(out.end(), {static_cast<double>(axis.count), axis.start, axis.step});
  return out;
}

void check_same(const Calibration& a, const Calibration& b) {
  CHECK(a.entries == b.entries);
  CHECK(a.response == b.response);
  CHECK(a.antennas.date_utc == b.antennas.date_utc);
  CHECK(numbers(a) == numbers(b));
}

}  // namespace

TEST_CASE("a calibration file is read back with the values that were written") {
  const Folder folder;
  const std::string path = folder / "c.toml";
  const Calibration whole = whole_calibration(0.0375);
  Calibration part;
  part.entries = {whole.entries[1]};
  for (const Calibration& c : {whole, part}) {
    write_calibration(path, c);
    check_same(read_calibration(path), c);
  }
  CHECK(error_of([&] { write_calibration(folder / "no/c.toml", {}); }).first == ExitCode::disk);
}

TEST_CASE("a new calibration keeps the stored values of sensors that were not measured") {
  const Calibration stored = whole_calibration(0.1), fresh = whole_calibration(0.3);
  check_same(Calibration{}.over(stored), stored);
  check_same(fresh.over(stored), fresh);
  check_same(fresh.over({}), fresh);
  Calibration radar;
  radar.entries = {fresh.entries[1]}, radar.baseline_m = 0.2;
  const Calibration both = radar.over(stored);
  CHECK(both.entries == std::vector{stored.entries[0], fresh.entries[1]});
  CHECK(both.baseline_m == 0.2);
}

TEST_CASE("the line and column of each error in a calibration file are reported") {
  const Folder folder;
  const std::string path = folder / "c.toml", spd = "[spd]\noffset_m = 0.1\n",
                    firmware = spd + "[firmware]\nline = \"",
                    no_line = ": firmware.line is not a compRange",
                    zeros = "phase_rad = \"0 0\"\nstandard_error = \"0 0\"\n",
                    lists = ": antennas.gain, antennas.phase_rad and antennas.standard_error: ";
  for (const auto& [text, words] : std::vector<std::pair<std::string, std::string>>{
           {"", ": contains no offset; expected spd.offset_m or radar.offset_m"},
           {"[spd]\noffset_m = 5000\n", ":2:1: spd.offset_m = 5000 is not valid"},
           {"[spd]\noffset_cm = 5\n", ":2:1: unknown key"},
           {spd + "distance_m = -0.5\n", ":3:1: spd.distance_m = -0.5 is not valid"},
           {spd + "standard_error_m = -0.5\n", ":3:1: spd.standard_error_m = -0.5 is not"},
           {spd + "[antennas]\ndistance_m = -0.5\n", ":4:1: antennas.distance_m = -0.5 is not"},
           {spd + "[antennas]\nsine = 1.5\n", ":4:1: antennas.sine = 1.5 is not valid"},
           {spd + "[response]\nradar_cell_m = \"0.5\"\nradar_taps = \"2 1\"\n",
            ": section response: expected the numbers"},
           {firmware + "sensorStart 0\"\n", no_line},
           {firmware + "compRangeBiasAndRxChanPhase\"\n", no_line},
           {firmware + "compRangeBiasAndRxChanPhase 0.05 1.0\"\n", no_line},
           {firmware + "compRangeBiasAndRxChanPhase 0.05 1.0 x\"\n", no_line},
           {spd + "[antennas]\ngain = \"1 1\"\n", lists},
           {spd + "[antennas]\ngain = \"1 x\"\n" + zeros, lists},
           {spd + "[antennas]\ngain = \"1 0\"\n" + zeros, lists},
           {spd + "[antennas]\ngain = \"1 nan\"\n" + zeros, lists},
           {spd + "[antennas]\ngain = \"1 1 1\"\n" + zeros, lists}}) {
    write_file(path, text);
    check_error(ExitCode::config, path + words, [&, at = path] { read_calibration(at); });
  }
}
