// SPDX-License-Identifier: MIT
// Tests how antenna arrays are converted from radar heat maps to records, and how the commands info
// and doctor report them.

#include "acquire/commands/commands.hpp"
#include "acquire/intake/window.hpp"
#include "acquire/record/columns.hpp"
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

TEST_CASE("a record contains the mean antenna array of the usable frames in its slot, up to 8 m") {
  // Each row contains the numbers of the frames in slot 0, of the frame without a whole heat map,
  // and of the frame of another size, and the expected groups of consecutive frames.
  using Numbers = std::vector<std::uint32_t>;
  const auto [sent, without_map, other_size, groups] =
      GENERATE(table<Numbers, std::uint32_t, std::uint32_t, std::vector<Numbers>>(
          {{{1, 2, 3}, 0, 0, {{1, 2, 3}}},
           {{4, 5, 7, 8, 8}, 0, 0, {{4, 5}, {7, 8}}},  // a second frame has the number 8
           {{4, 5, 6, 7, 8}, 6, 0, {{4, 5}, {7, 8}}},
           {{1, 2}, 0, 1, {{2}}},
           {{1}, 1, 0, {}}}));
  CAPTURE(sent);
  Windows windows = make_windows();
  for (const std::uint32_t n : sent) {
    RadarFrame frame = frame_of(n);
    if (n == without_map) frame.array.resize(frame.array.size() / 2);
    if (n == other_size) frame.power.resize(3);
    windows.add(frame);
  }
  for (const std::uint32_t n : {101u, 102u}) windows.add(frame_of(n));
  const auto r = windows.close({0, false}), next = windows.close({1, false});
  CHECK(r.has(Sensor::radar));
  CHECK(antenna_data(r) == expected(groups));
  std::size_t frames = 0;
  for (const Numbers& group : groups) frames += group.size();
  CHECK(r.array_frames == frames);
  CHECK(antenna_data(next) == expected({{101, 102}}));
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
  const std::complex<float> mean = record::bin_of(antenna_data(records[0]), antennas, 0).mean(1);
  CHECK(std::abs(mean - std::complex<float>(499 - 6, 7 + 2)) < 1e-3F);
  CHECK(windows.axes().front().count == kept_bins);
  CHECK(record::record_bytes(windows.axes()) == kept_bins * (4 + 2 * 82) + 4 * sent_bins);
  CHECK(has(describe_run(path, false),
            "array     8 antennas, 32 bins to 7.75 m, in 2 records of 2 frames and 5376 bytes"));
  CHECK(has(describe_run(path, true), "\"phase_rad\": -0.25"));
}

TEST_CASE("the doctor command counts radar heat maps and reports missing ones") {
  Config config;
  config.radar.cli = "serial:/a";
  config.radar.cfg_name = "azimuth.cfg";
  config.radar.cfg_text = read_config_text(source_dir + "/config/radar/xwr68xx_azimuth_50cm.cfg");
  const radar::RadarProfile profile = parse_profile(config.radar);
  RadarFrame frame = frame_of(1);
  frame.received = doctor_middle;
  frame.power.resize(64, 900);
  for (const bool has_map : {true, false}) {
    if (!has_map) frame.array.clear();
    const Capture capture =
        captured(config, device_of(Sensor::radar, {radar_axis(profile), array_axis(profile)}),
                 [&](Capture& out) {
                   for (int k = 0; k < 40; ++k) ++frame.frame_number, out.on_radar(frame);
                 });
    check_finding(radar_finding(capture, config), has_map ? Grade::ok : Grade::problem,
                  has_map ? "heat map of 8 antennas in 40 frames" : "radar.board");
    CHECK(estimate_record_bytes(capture, config) == 4 * 64 + kept_bins * (4 + 2 * 82));
  }
}
