// SPDX-License-Identifier: MIT
// Tests how antenna arrays are converted from radar heat maps to records, and how the commands info
// and doctor report them.

#include "acquire/commands/commands.hpp"
#include "acquire/intake/window.hpp"
#include "acquire/record/columns.hpp"
#include "acquire/run/disk.hpp"
#include "captured.hpp"
#include "drivers/util/settings.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 10s, .length = 1s};
const SensorClocks no_clocks;
// 32 of the 40 bins of 0.25 m are kept, because only these are below 8 m.
constexpr std::size_t sent_bins = 40, kept_bins = 32, antennas = 8;

DeviceInfo radar_info() {
  DeviceInfo info = radar_of(sent_bins, 0.25);
  info.axes.push_back({"array", "covariance", "m", sent_bins, 0, 0.25, antennas});
  return info;
}

RadarFrame frame_of(std::uint32_t number) {
  RadarFrame frame;
  frame.received = 10s + number * 10ms, frame.frame_number = number;
  frame.power.assign(sent_bins, 1000);
  for (std::size_t i = 0; i < sent_bins * antennas; ++i) {
    frame.array.push_back(static_cast<std::int16_t>(7 * i % 100 + number));       // imaginary part
    frame.array.push_back(static_cast<std::int16_t>(500 - 3 * number - i % 41));  // real part
  }
  return frame;
}

Windows make_windows() {
  Windows windows(grid, {}, no_clocks, {Sensor::radar});
  REQUIRE(windows.announce(radar_info()));
  return windows;
}

// Returns the expected array samples of a record. Each group contains frames with consecutive
// numbers.
std::vector<float> expected(const std::vector<std::vector<std::uint32_t>>& groups) {
  record::ArrayStatistics sums(kept_bins, antennas);
  for (const auto& group : groups) {
    sums.skip();
    for (const std::uint32_t number : group) {
      const RadarFrame f = frame_of(number);
      std::vector<std::complex<float>> samples;
      for (std::size_t i = 0; i < kept_bins * antennas; ++i)
        samples.emplace_back(static_cast<float>(f.array[2 * i + 1]),
                             static_cast<float>(f.array[2 * i]));
      sums.add(samples);
    }
  }
  return sums.take();
}

}  // namespace

TEST_CASE("a record contains the mean antenna array of the frames in its slot, up to 8 m") {
  Windows windows = make_windows();
  for (const std::uint32_t n : {1u, 2u, 3u}) windows.add(frame_of(n));
  for (const std::uint32_t n : {101u, 102u}) windows.add(frame_of(n));
  const auto axes = windows.axes();
  REQUIRE(axes.front().name == "array");
  CHECK(axes.front().count == kept_bins);
  const auto r = windows.close({0, false});
  CHECK(r.array_frames == 3);
  CHECK(antenna_data(r) == expected({{1, 2, 3}}));
  CHECK(record::bin_of(antenna_data(r), antennas, 0).mean(1).imag() == Approx(7 + 2));
  CHECK(record::bin_of(antenna_data(r), antennas, 0).mean(1).real() == Approx(499 - 6));
  const auto next = windows.close({1, false});
  CHECK(next.array_frames == 2);
  CHECK(antenna_data(next) == expected({{101, 102}}));
}

TEST_CASE("array statistics do not pair radar frames across a missing frame or heat map") {
  Windows windows = make_windows();
  RadarFrame without = frame_of(6);
  SECTION("frames before and after a lost frame are not paired") {}
  SECTION("frames before and after a frame without a heat map are not paired") {
    without.array.clear();
    windows.add(without);
  }
  for (const std::uint32_t n : {4u, 5u, 7u, 8u}) windows.add(frame_of(n));
  windows.add(frame_of(8));  // a second frame with the number 8
  const auto r = windows.close({0, false});
  CHECK(r.array_frames == 4);
  CHECK(antenna_data(r) == expected({{4, 5}, {7, 8}}));
}

TEST_CASE("a record without usable frames or heat maps contains no antenna samples") {
  Windows windows = make_windows();
  RadarFrame bad = frame_of(1);
  bad.power.resize(3);
  windows.add(bad);
  windows.add(frame_of(2));
  auto r = windows.close({0, false});
  CHECK(r.sync[Sensor::radar].used == 1);
  CHECK(r.array_frames == 1);
  CHECK(antenna_data(r) == expected({{2}}));
  RadarFrame plain = frame_of(101);
  plain.array.clear();
  windows.add(plain);
  r = windows.close({1, false});
  CHECK(r.valid.contains(Sensor::radar));
  CHECK(antenna_data(r).empty());
  CHECK(r.array_frames == 0);
  Windows old(grid, {}, no_clocks, {Sensor::radar});
  old.announce(radar_of(sent_bins, 0.25));
  old.add(frame_of(1));
  CHECK(antenna_data(old.close({0, false})).empty());
}

TEST_CASE("the info command describes the antenna array") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  Windows windows = make_windows();
  std::vector<record::FusedRecord> records;
  record::Antennas places(antennas);
  for (std::size_t m = 0; m < antennas; ++m) places[m].x = static_cast<double>(m);
  places[1].gain = 1.5, places[1].phase_rad = -0.25;
  for (const std::uint32_t n : {1u, 2u, 3u, 301u}) windows.add(frame_of(n));
  for (std::int64_t k = 0; k < 4; ++k) records.push_back(windows.close({k, false}));
  a_small_run().only_axes(windows.axes()).antennas(places).holding(records).write(path);
  const double bytes = record::array_bytes(windows.axes().front());
  CHECK(bytes == kept_bins * (4 + 2 * 82));
  CHECK(record::record_bytes(windows.axes()) == bytes + 4 * sent_bins);
  CHECK(has(describe_run(path, false),
            "array     8 antennas, 32 bins to 7.75 m, in 2 records of 2 frames and 5376 bytes"));
  CHECK(has(describe_run(path, true), "\"phase_rad\": -0.25"));
  // Values in the file are rounded.
  const auto want = antenna_data(record::RunReader(path).read(0));
  CHECK(want[0] == Approx(antenna_data(records[0])[0]).margin(0.1));
}

TEST_CASE("the doctor command counts radar heat maps and reports missing ones") {
  Config config;
  config.radar.cli = "serial:/a";
  config.radar.cfg_name = "azimuth.cfg";
  config.radar.cfg_text = read_config_text(source_dir + "/config/radar/xwr68xx_azimuth_50cm.cfg");
  const radar::RadarProfile profile = parse_profile(config.radar);
  const DeviceInfo device =
      device_of(Sensor::radar, {radar::radar_axis(profile), radar::array_axis(profile)});
  RadarFrame frame = frame_of(1);
  frame.received = doctor_middle;
  frame.power.resize(64, 900);
  const auto rated = [&] {
    return captured(config, device, [&](Capture& capture) {
      for (int k = 0; k < 40; ++k) ++frame.frame_number, capture.on_radar(frame);
    });
  };
  SECTION("frames with heat maps are rated ok") {
    const Capture capture = rated();
    const Finding finding = radar_finding(capture, config);
    CHECK(finding.grade == Grade::ok);
    CHECK(has(finding.found, "heat map of 8 antennas in 40 frames"));
    CHECK(estimate_record_bytes(capture, config) == 4 * 64 + kept_bins * (4 + 2 * 82));
  }
  SECTION("frames without heat maps are rated as a problem") {
    frame.array.clear();
    const Finding finding = radar_finding(rated(), config);
    CHECK(finding.grade == Grade::problem);
    CHECK(has(finding.advice, "radar.board"));
  }
}
