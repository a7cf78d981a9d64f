// SPDX-License-Identifier: MIT
#include "acquire/config/calibration.hpp"

#include "drivers/radar/sdk.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

TEST_CASE("a calibration file is read back with the values that were written") {
  const Folder folder;
  const std::string path = folder / "c.toml";
  Calibration c;
  c.entries = {{Sensor::radar, "2026-11-21T10:00:00Z", "some method", 1.5, -0.0375, 2e-4}};
  c.firmware = FirmwareBias{0.0123456, {1, 0, -0.5, 0.25}, 7};
  c.axes = {spd_axis(336, 13343, 100), range_axis("power_with_noise", 64, 0, 0.234375)};
  c.response.irf_fwhm_ps = {203.5, 1.5}, c.response.radar = {0.05, {1, 0.75, 0.25}};
  write_calibration(path, c);
  const Calibration back = read_calibration(path);
  CHECK(back.response == c.response);
  CHECK(back.axes.spd.count == 336);
  CHECK(back.axes.spd.start == 13343);
  CHECK(back.axes.spd.step == 100);
  CHECK(back.axes.radar.count == 64);
  CHECK(back.axes.radar.step == 0.234375);
  CHECK(back.entries == c.entries);
  REQUIRE(back.firmware);
  CHECK(back.firmware->range_bias_m == 0.0123456);
  CHECK(back.firmware->re_im == std::vector<double>{1, 0, -0.5, 0.25});
  CHECK(back.firmware->lines == 7);
}

TEST_CASE("a new calibration keeps the stored values of sensors that were not measured") {
  Calibration stored, fresh;
  stored.entries = {{Sensor::spd, "old", "m", 1, 0.1, 1e-4},
                    {Sensor::radar, "old", "m", 1, 0.2, 1e-4}};
  stored.firmware = FirmwareBias{0.01, {1, 0}, 3};
  CHECK(fresh.over(stored).entries == stored.entries);
  fresh.entries = {{Sensor::radar, "new", "m", 1, 0.3, 1e-4}};
  const Calibration both = fresh.over(stored);
  CHECK(both.entries == std::vector{stored.entries[0], fresh.entries[0]});
  REQUIRE(both.firmware);
  CHECK(both.firmware->lines == 3);
  CHECK(fresh.over({}).entries == fresh.entries);
  fresh.firmware = FirmwareBias{0.02, {1, 0}, 4};
  CHECK(fresh.over(stored).firmware->lines == 4);
}

TEST_CASE("the line and column of each error in a calibration file are reported") {
  const Folder folder;
  const std::string path = folder / "c.toml";
  const auto refusal = [&](const std::string& text) {
    write_file(path, text);
    return error_of([&] { read_calibration(path); }).second;
  };
  CHECK(has(refusal(""), path + ": contains no offset; expected spd.offset_m or radar.offset_m"));
  CHECK(has(refusal("[spd]\noffset_m = 5000\n"), path + ":2:1: spd.offset_m = 5000 is not valid"));
  CHECK(has(refusal("[spd]\noffset_cm = 5\n"), path + ":2:1: unknown key"));
  CHECK(has(
      refusal("[spd]\noffset_m = 0.1\n[response]\nradar_cell_m = \"0.5\"\nradar_taps = \"2 1\"\n"),
      "section response: expected the numbers"));
  CHECK(has(refusal("[spd]\noffset_m = 0.1\n[firmware]\nline = \"x\"\n"), "firmware.line is not"));
  CHECK(error_of([&] { write_calibration(folder / "no/c.toml", {}); }).first == ExitCode::disk);
}

TEST_CASE(
    "the firmware's calibration line is parsed into a range bias and complex channel factors") {
  const auto bias =
      radar::parse_firmware_bias("compRangeBiasAndRxChanPhase 0.0512345 1.0 0.0 -0.5 0.25");
  REQUIRE(bias);
  CHECK(bias->range_bias_m == 0.0512345);
  CHECK(bias->re_im == std::vector<double>{1, 0, -0.5, 0.25});
  CHECK_FALSE(radar::parse_firmware_bias("compRangeBiasAndRxChanPhase 0.05 1.0"));
  CHECK_FALSE(radar::parse_firmware_bias("compRangeBiasAndRxChanPhase"));
  CHECK_FALSE(radar::parse_firmware_bias("compRangeBiasAndRxChanPhase 0.05 1.0 x"));
  CHECK_FALSE(radar::parse_firmware_bias("sensorStart 0"));
}
