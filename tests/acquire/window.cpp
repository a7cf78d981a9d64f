// SPDX-License-Identifier: MIT
#include "acquire/intake/window.hpp"

#include <functional>

#include "../catch.hpp"
#include "../fixtures/record.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 10s, .length = 1s};
constexpr tdc::HistogramSettings tdc_settings{.bin_width_ps = 100, .first_bin_ps = 0, .bins = 50};
constexpr SensorSet everything = SensorSet::from_bits(7);
const SensorClocks no_clocks;  // arrival times are used because there are no clock fits

Windows make_windows(SensorSet configured = everything) {
  Windows windows(grid, tdc_settings, no_clocks, configured);
  windows.announce(radar_of(4));
  windows.announce(camera_of(2, 1));
  return windows;
}

Tag start_at(std::int64_t ps) { return {.channel = 1, .time_ps = ps}; }
Tag click_at(std::int64_t ps) { return {.channel = 2, .time_ps = ps}; }

void feed(Windows& windows, HostTime received, const std::vector<Tag>& tags,
          std::uint64_t lost_blocks = 0) {
  windows.add(TagBlock{.received = received, .tags = tags, .lost_blocks = lost_blocks});
}

RadarFrame radar_frame(HostTime received, std::uint32_t number, std::vector<float> power) {
  RadarFrame f;
  f.received = received, f.frame_number = number, f.power = std::move(power);
  return f;
}

DepthFrame depth_frame(HostTime received, std::uint32_t index, std::vector<std::uint16_t> mm,
                       std::uint32_t width = 2) {
  DepthFrame f;
  f.received = received, f.frame_number = index, f.width = width, f.height = 1;
  f.depth_mm = std::move(mm);
  return f;
}

const record::SensorSync& sync(const record::FusedRecord& r, Sensor s) { return r.sync[s]; }

// Closes a slot and returns the verdict of its SPD data.
std::string spd_verdict(Windows& windows, std::int64_t slot) {
  return verdict(windows.close({slot, false}), Sensor::spd);
}

std::uint64_t parts(const TagCounts& c) {
  return c.starts + c.in_range + c.out_of_range + c.without_start + c.other;
}

}  // namespace

TEST_CASE("a record with data from all three sensors is complete") {
  Windows windows = make_windows();
  feed(windows, 10s, {start_at(0), click_at(150), click_at(250)});
  feed(windows, 10s + 900ms, {start_at(10'000), click_at(10'199), click_at(99'999)});
  windows.add(radar_frame(10s + 400ms, 1, {0, 256, 512, 1000}));
  windows.add(depth_frame(10s + 100ms, 1, {1, 2}));
  windows.add(depth_frame(10s + 550ms, 2, {3, 4}));
  windows.add(depth_frame(10s + 900ms, 3, {5, 6}));
  const auto r = windows.close({0, false});

  CHECK(r.index == 0);
  CHECK(r.slot_start == 10s);
  CHECK(r.slot_end == 11s);
  CHECK(r.valid == SensorSet::from_bits(7));
  std::vector<std::uint32_t> expected(50, 0);
  // Two clicks, 150 ps and 199 ps after a start, fall into the bin from 100 to 200 ps.
  expected[1] = 2;
  expected[2] = 1;
  CHECK(counts(r) == expected);
  CHECK(r.spd_counts.tags == 6);
  CHECK(r.spd_counts.out_of_range == 1);
  CHECK(sync(r, Sensor::spd).used == 3);
  CHECK(sync(r, Sensor::spd).span_s == 0.9);
  CHECK(sync(r, Sensor::spd).offset_s == Approx(-0.05));
  CHECK(power(r) == std::vector<float>{0, 256, 512, 1000});  // a single frame is copied exactly
  CHECK(sync(r, Sensor::radar).offset_s == Approx(-0.1));
  // The record contains the frame nearest to 10.5 s, the centre of the slot.
  CHECK(depth_mm(r) == std::vector<std::uint16_t>{3, 4});
  CHECK(sync(r, Sensor::depth).offset_s == Approx(0.05));
  for (const auto& s : r.sync) CHECK(s.verdict.text() == "ok");
}

TEST_CASE("the counts of a record account for click delay, dead time and damaged tags") {
  auto settings = tdc_settings;
  settings.click_delay_ps = 500;
  settings.dead_time_ps = 100;
  Windows windows(grid, settings, no_clocks, {Sensor::spd});
  Tag unknown = start_at(2);
  unknown.type = static_cast<TagType>(9);
  // If the click delay of 500 ps were not added, the first click would precede its start tag.
  feed(windows, 10s, {click_at(650), start_at(1'000), click_at(1'020), click_at(1'119), unknown});
  feed(windows, 10s + 900ms, {start_at(5'000), start_at(4'000), click_at(5'100)});
  const auto r = windows.close({0, false});
  CHECK(counts(r).at(1) == 1);       // 650 ps + 500 ps delay - 1000 ps start = 150 ps
  CHECK(counts(r).at(5) == 1);       // 1020 ps + 500 ps delay - 1000 ps start = 520 ps
  CHECK(r.spd_counts.removed == 1);  // the click at 1119 ps is removed because it follows the click
                                     // at 1020 ps by less than 100 ps
  CHECK(r.spd_counts.bad_tags == 1);
  // The tags are in order because they have been sorted by the filter.
  CHECK(r.spd_counts.backwards == 0);
  CHECK(r.spd_counts.tags == 8);
  CHECK(parts(r.spd_counts) == r.spd_counts.tags);
}

TEST_CASE("slot boundaries are exact, and a start pulse remains valid across a boundary") {
  Windows windows = make_windows({Sensor::spd});
  feed(windows, 10s, {start_at(0)});
  feed(windows, 11s - 1ns, {start_at(1'000)});
  feed(windows, 11s, {click_at(1'050)});
  feed(windows, 11s + 900ms, {start_at(2'000)});
  CHECK(windows.close({0, false}).spd_counts.tags == 2);
  const auto second = windows.close({1, false});
  CHECK(second.spd_counts.in_range == 1);
  CHECK(counts(second).at(0) == 1);
}

TEST_CASE("a click after a gap in the tags is not paired with a start before the gap") {
  Windows windows = make_windows({Sensor::spd});
  feed(windows, 10s, {start_at(0)});
  feed(windows, 10s + 600ms, {click_at(50)}, 1);
  const auto r = windows.close({0, false});
  CHECK(r.spd_counts.without_start == 1);
  CHECK(r.spd_counts.in_range == 0);
}

TEST_CASE("a record contains the sum of the counts of two tag blocks") {
  auto settings = tdc_settings;
  settings.dead_time_ps = 100;
  Windows windows(grid, settings, no_clocks, {Sensor::spd});
  const auto marker = [](TagType type, std::uint16_t missed = 0) {
    return Tag{.type = type, .missed_events = missed, .channel = 2, .time_ps = 9'000};
  };
  const auto part = [&](HostTime received, std::uint16_t missed) {
    Tag unknown = start_at(9'000);
    unknown.reserved = 1;
    feed(windows, received,
         {click_at(0), start_at(1'000), click_at(1'020), click_at(1'050), click_at(8'000),
          start_at(9'000), unknown, marker(TagType::missed_events, missed), marker(TagType::error),
          marker(TagType::overflow_begin), marker(TagType::overflow_end)});
  };
  part(10s, 20);
  part(11s, 500);
  part(10s + 900ms, 3);  // data of slot 0 that arrive after data of slot 1
  const record::FusedRecord r = windows.close({0, false});
  const TagCounts& c = r.spd_counts;
  CHECK(c.tags == 22);
  CHECK(c.starts == 4);
  CHECK(c.in_range == 2);
  CHECK(c.out_of_range == 2);
  CHECK(c.removed == 2);
  CHECK(c.bad_tags == 2);
  CHECK(c.missed == 23);
  CHECK(c.overflows == 2);
  CHECK(c.errors == 2);
  CHECK(sync(r, Sensor::spd).lost == 23);
  CHECK(parts(c) == c.tags);
  CHECK(windows.close({1, false}).spd_counts.missed == 500);
}

TEST_CASE(
    "the range profile of a record is the mean power over frames and subframes that have one") {
  Windows windows = make_windows({Sensor::radar});
  windows.add(radar_frame(10s, 0, {}));
  double sum = 0, count = 0;
  for (std::uint32_t number = 1; number <= 5; ++number)
    for (std::uint32_t k = 0; k < 4; ++k) {
      const auto power = static_cast<float>(3000 + 40 * k + 17 * number * (k + 1));
      RadarFrame frame = radar_frame(10s + number * 50ms + k * 12ms, number, {power, 0, 0, 0});
      frame.time_cpu_cycles = number * 10'000'000 + k * 2'400'000;
      frame.subframe = k, frame.subframes = 4;
      windows.add(frame);
      windows.add(frame);
      sum += double{power}, ++count;
    }
  const auto r = windows.close({0, false});
  REQUIRE(r.has(Sensor::radar));
  CHECK(sync(r, Sensor::radar).used == 20);
  CHECK(sync(r, Sensor::radar).span_s == Approx(0.236));
  CHECK(sync(r, Sensor::radar).lost == 0);
  CHECK(power(r)[0] == Approx(sum / count).epsilon(1e-6));
}

TEST_CASE("a record contains the statistics and temperature of the last radar frame in its slot") {
  Windows windows = make_windows();
  windows.announce(radar_of(4));
  RadarFrame frame = radar_frame(10s, 1, {1, 2, 3, 4});
  frame.stats = RadarStats{0, 7, 0, 0, 0, 0};
  windows.add(frame);
  frame.frame_number = 2;
  frame.stats->transmit_us = 8;
  frame.temperature = RadarTemperature{0, 5, {44}};
  windows.add(frame);
  windows.add(radar_frame(10s + 1ms, 3, {1, 2, 3, 4}));
  const record::FusedRecord r = windows.close({0, false});
  REQUIRE(r.radar_stats);
  CHECK(r.radar_stats->transmit_us == 8);
  REQUIRE(r.radar_temperature);
  CHECK(r.radar_temperature->celsius[0] == 44);
  CHECK_FALSE(windows.close({1, false}).radar_stats);
}

TEST_CASE("a sensor without usable data is invalid, and the record contains the reason") {
  Windows windows = make_windows();
  std::string spd = "no tags", radar = "no frames", depth = "no frames";
  SECTION("a sensor that sends no data is invalid") {}
  SECTION("a detector without start pulses from the laser is invalid") {
    feed(windows, 10s, {click_at(0)});
    spd = "no start tags: channel 1";
  }
  SECTION("a detector with clicks only during overflows is invalid") {
    for (const HostTime at : {HostTime(10s), HostTime(10s + 600ms)})
      feed(windows, at,
           {start_at(0),
            {.type = TagType::overflow_begin, .time_ps = 1},
            start_at(2),
            click_at(3),
            {.type = TagType::overflow_end, .time_ps = 4}});
    spd = "in overflow: 2 overflows contain all clicks of the slot";
  }
  SECTION("a detector with tags over less than half of the slot is invalid") {
    feed(windows, 10s, {start_at(0)});
    feed(windows, 10s + 499ms, {start_at(1)});
    spd = "covers only part: tags for 49 % of the slot";
    feed(windows, 11s, {start_at(2)});
    feed(windows, 11s + 500ms, {start_at(3)});
  }
  SECTION("a sensor that sends frames of the wrong size is invalid") {
    windows.add(radar_frame(10s, 1, {1, 2, 3}));
    windows.add(depth_frame(10s, 1, {1, 2, 3}, 3));
    radar = "other axis: frames of 3 bins";
    depth = "other axis: frames of 3 x 1";
  }
  SECTION("a radar that sends frames without a range profile is invalid") {
    windows.add(radar_frame(10s, 1, {}));
    radar = "no range profile";
  }
  SECTION("a radar that reconnects with a different axis is invalid") {
    CHECK_FALSE(windows.announce(radar_of(4, 0.25)));
    windows.add(radar_frame(10s, 1, {1, 2, 3, 4}));
    radar = "other axis: differs from the one at the start of the run";
    CHECK(windows.announce(radar_of(4)));
  }
  const auto r = windows.close({0, false});
  CHECK(r.valid == SensorSet::from_bits(0));
  CHECK((counts(r).empty() && power(r).empty() && depth_mm(r).empty()));
  CHECK(verdict(r, Sensor::spd) == spd);
  CHECK(verdict(r, Sensor::radar) == radar);
  CHECK(verdict(r, Sensor::depth) == depth);
  // Only the section that expects "tags cover ..." sends enough tags to make slot 1 valid.
  CHECK(windows.close({1, false}).has(Sensor::spd) == spd.starts_with("covers only part"));
}

TEST_CASE("frames of a device that states neither a number nor a time are used") {
  Windows windows = make_windows();
  for (int k = 0; k < 20; ++k) windows.add(radar_frame(10s, 0, {1, 2, 3, 4}));
  CHECK(windows.close({0, false}).sync[Sensor::radar].used == 13);
}

TEST_CASE("a click is not paired with a start if tags outside open slots came between them") {
  Windows windows = make_windows({Sensor::spd});
  windows.close({0, false});
  feed(windows, 11s, {start_at(0)});
  feed(windows, 10s, {start_at(1)});
  feed(windows, 11s + 900ms, {click_at(2)});
  CHECK(windows.close({1, false}).spd_counts.without_start == 1);
}

TEST_CASE("a slot after a stall is complete if its tags span 90 % of its length") {
  SensorClocks clocks;
  std::vector<Tag> tag(1);
  const auto at = [&](HostTime time, const std::function<void(const TagBlock&)>& use) {
    tag[0] = start_at(1000 * time.count());
    use(TagBlock{.received = time, .tags = tag});
  };
  for (HostTime t = 0s; t < 10s; t += 50ms) at(t, [&](auto& block) { clocks.observe(block); });
  REQUIRE(clocks[Sensor::spd].sound());
  const auto [span, verdict] = GENERATE(table<HostTime, const char*>(
      {{499ms, "the program stood still"}, {890ms, "the program stood still"}, {900ms, "ok"}}));
  Windows windows(grid, tdc_settings, clocks, {Sensor::spd});
  for (const HostTime t : {HostTime(10s), 10s + span})
    at(t, [&](auto& block) { windows.add(block); });
  CHECK(sync(windows.close({0, true}), Sensor::spd).verdict.text() == verdict);
}

namespace {

DeviceInfo board_info(double width_ps = 92.5) {
  return device_of(Sensor::spd, {{"spd", "counts", "ps", 3, 13343, width_ps, 1}});
}

// Returns a histogram with an exposure time of 200 ms.
HistogramFrame histogram(HostTime received, std::vector<std::uint32_t> counts,
                         std::uint64_t lost = 0) {
  return {.received = received,
          .exposure_us = 200'000,
          .pulses = 1000,
          .counts = std::move(counts),
          .lost_before = lost};
}

}  // namespace

TEST_CASE(
    "a record contains the sum of all histograms with a mid-exposure time in the slot of the "
    "record") {
  Windows windows = make_windows();
  REQUIRE(windows.announce(board_info()));
  CHECK(same_axis(windows.axes().front(), board_info().axes[0]));
  // The middle of the exposure is at 9.95 s, before slot 0.
  windows.add(histogram(10s + 50ms, {100, 0, 0}));
  windows.add(histogram(10s + 150ms, {1, 2, 3}));
  windows.add(histogram(10s + 700ms, {10, 20, 4'000'000'000}, 2));
  // The middle of the exposure is at 10.95 s, in slot 0.
  windows.add(histogram(11s + 50ms, {5, 5, 4'000'000'000}));
  // The middle of the exposure is at 11.05 s, in slot 1.
  windows.add(histogram(11s + 150ms, {7, 7, 7}));
  const auto r = windows.close({0, false});
  CHECK(r.has(Sensor::spd));
  CHECK(counts(r) == std::vector<std::uint32_t>{16, 27, UINT32_MAX});
  CHECK(r.spd_counts.starts == 3000);
  CHECK(r.spd_counts.in_range == 8'000'000'046);
  CHECK(parts(r.spd_counts) == r.spd_counts.tags);
  CHECK(sync(r, Sensor::spd).lost == 2);
  CHECK(sync(r, Sensor::spd).span_s == Approx(1.1));
  CHECK(windows.unassigned().early[Sensor::spd] == 1100);
  CHECK(spd_verdict(windows, 1) == "covers only part: histograms for 20 % of the slot");
  CHECK(spd_verdict(windows, 2) == "no histograms");
}

TEST_CASE("histograms are reported as late only in the slot in which they arrived late") {
  Windows windows = make_windows();
  REQUIRE(windows.announce(board_info()));
  CHECK(spd_verdict(windows, 0) == "no histograms");
  windows.add(histogram(10s + 700ms, {1, 2, 3}));
  CHECK(spd_verdict(windows, 1) == "no histograms: histograms arrived after their slot was closed");
  CHECK(spd_verdict(windows, 2) == "no histograms");
  CHECK(windows.unassigned().late[Sensor::spd] == 1006);
}

TEST_CASE("histograms are not used after a counting board reconnects with different bins") {
  Windows windows = make_windows();
  REQUIRE(windows.announce(board_info()));
  CHECK_FALSE(windows.announce(board_info(100)));
  windows.add(histogram(10s + 500ms, {1, 2, 3}));
  CHECK(spd_verdict(windows, 0) == "other axis: differs from the one at the start of the run");
  // If only some histograms of a slot are refused, they are counted as lost.
  for (const auto& [end, width_ps] :
       {std::pair{11s + 200ms, 92.5}, {11s + 400ms, 100.0}, {11s + 900ms, 92.5}}) {
    windows.announce(board_info(width_ps));
    windows.add(histogram(end, {1, 1, 1}));
  }
  windows.announce(board_info(100));
  const auto mixed = windows.close({1, false});
  CHECK(mixed.has(Sensor::spd));
  CHECK(counts(mixed) == std::vector<std::uint32_t>{2, 2, 2});
  CHECK(sync(mixed, Sensor::spd).lost == 1);
}

TEST_CASE("histograms are not used after a detector reconnects with different zones") {
  Windows windows = make_windows();
  DeviceInfo info = board_info();
  info.axes[0].zones = {{0, 0, 0.2, 0}, {0.2, 0, 0.2, 0}};
  REQUIRE(windows.announce(info));
  CHECK(windows.axes()[0].zones == info.axes[0].zones);
  for (const auto end : {10s + 300ms, 10s + 900ms}) windows.add(histogram(end, {1, 2, 3, 4, 5, 6}));
  CHECK(counts(windows.close({0, false})) == std::vector<std::uint32_t>{2, 4, 6, 8, 10, 12});
  CHECK_FALSE(windows.announce(board_info()));
  CHECK(windows.announce(info));
}
