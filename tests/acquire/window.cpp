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

void feed(Windows& windows, HostTime at, const std::vector<Tag>& tags, std::uint64_t lost = 0) {
  windows.add(TagBlock{.received = at, .tags = tags, .lost_blocks = lost});
}

RadarFrame radar_frame(HostTime received, std::uint32_t number, std::vector<float> power) {
  RadarFrame f;
  f.received = received, f.frame_number = number, f.power = std::move(power);
  return f;
}

const record::SensorSync& sync(const record::FusedRecord& r, Sensor s) { return r.sync[s]; }

// Closes a slot and returns the verdict of its SPD data.
std::string spd_verdict(Windows& windows, std::int64_t slot) {
  return verdict(windows.close({slot, false}), Sensor::spd);
}

// Returns all counts, so that different counts are printed.
std::vector<std::uint64_t> all(const TagCounts& c) {
  return {c.tags,      c.starts,  c.in_range,   c.out_of_range, c.without_start,
          c.other,     c.missed,  c.errors,     c.overflows,    c.bad_tags,
          c.backwards, c.removed, c.lost_blocks};
}

}  // namespace

TEST_CASE("a click is paired with a start in the previous slot, but not before a gap in the tags") {
  Windows windows = make_windows({Sensor::spd});
  feed(windows, 10s, {start_at(0)});
  feed(windows, 10s + 600ms, {click_at(50)}, 1);
  CHECK(all(windows.close({0, false}).spd_counts) ==
        all({.tags = 2, .starts = 1, .without_start = 1, .lost_blocks = 1}));
  feed(windows, 11s, {start_at(0)});
  feed(windows, 10s, {start_at(1)});
  feed(windows, 11s + 900ms, {click_at(2)});
  CHECK(windows.close({1, false}).spd_counts.without_start == 1);
  feed(windows, 12s, {start_at(3)});
  feed(windows, 13s - 1ns, {start_at(1'000)});
  feed(windows, 13s, {click_at(1'050)});
  CHECK(windows.close({2, false}).spd_counts.tags == 2);
  CHECK(windows.close({3, false}).spd_counts.in_range == 1);
}

TEST_CASE("the counts of a record are the sums of its tag blocks, with click delay and dead time") {
  auto settings = tdc_settings;
  settings.click_delay_ps = 500;
  settings.dead_time_ps = 100;
  Windows windows(grid, settings, no_clocks, {Sensor::spd});
  const auto marker = [](TagType type, std::uint16_t missed = 0) {
    return Tag{.type = type, .missed_events = missed, .channel = 2, .time_ps = 9'000};
  };
  const auto part = [&](HostTime received, std::uint16_t missed) {
    Tag unknown = start_at(9'000), reserved = unknown;
    unknown.type = static_cast<TagType>(9), reserved.reserved = 1;
    // If the click delay of 500 ps were not added, the click at 650 ps would precede its start. The
    // click at 749 ps follows it by less than the dead time.
    feed(windows, received,
         {click_at(400), click_at(650), start_at(1'000), click_at(749), click_at(8'000),
          start_at(9'000), start_at(8'900), unknown, reserved,
          marker(TagType::missed_events, missed), marker(TagType::error),
          marker(TagType::overflow_begin), marker(TagType::overflow_end)});
  };
  part(10s, 20);
  part(11s, 1);
  part(10s + 900ms, 3);  // data of slot 0 that arrive after data of slot 1
  const record::FusedRecord r = windows.close({0, false});
  CHECK(counts(r).at(1) == 2);  // 650 ps + 500 ps delay - 1000 ps start = 150 ps
  // Tags in a block are sorted by the filter, but the second block of the slot starts earlier than
  // the first block ends.
  CHECK(all(r.spd_counts) == all({.tags = 26,
                                  .starts = 6,
                                  .in_range = 2,
                                  .out_of_range = 2,
                                  .without_start = 2,
                                  .other = 14,
                                  .missed = 23,
                                  .overflows = 2,
                                  .errors = 2,
                                  .bad_tags = 4,
                                  .backwards = 1,
                                  .removed = 2}));
  CHECK(sync(r, Sensor::spd).lost == 23);
  // One missed event, but one overflow and one error, of which each loses a tag or more.
  CHECK(sync(windows.close({1, false}), Sensor::spd).lost == 2);
}

TEST_CASE("the range profile of a record is the mean power over its frames and subframes") {
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
  RadarFrame frame = radar_frame(10s, 1, {1, 2, 3, 4});
  frame.stats = RadarStats{0, 7, 0, 0, 0, 0};
  windows.add(frame);
  frame.frame_number = 2;
  frame.stats->transmit_us = 8;
  frame.temperature = RadarTemperature{0, 5, {44}};
  windows.add(frame);
  windows.add(radar_frame(10s + 1ms, 3, {1, 2, 3, 4}));
  const record::FusedRecord r = windows.close({0, false});
  CHECK(r.radar_stats.value().transmit_us == 8);
  CHECK(r.radar_temperature.value().celsius[0] == 44);
  CHECK_FALSE(windows.close({1, false}).radar_stats);
}

TEST_CASE("a sensor without usable data is invalid, and the record contains the reason") {
  const Tag begin{.type = TagType::overflow_begin, .time_ps = 1},
      end{.type = TagType::overflow_end, .time_ps = 4};
  // Each row sends data in slot 0. The verdicts are "no tags" and "no frames" if they are empty.
  struct Row {
    std::function<void(Windows&)> send;
    std::string spd, radar, depth;
  };
  const Row rows[] = {
      {[](Windows&) {}, "", "", ""},
      {[](Windows& w) { feed(w, 10s, {click_at(0)}); }, "no start tags: channel 1", "", ""},
      {[&](Windows& w) {
         for (const HostTime at : {HostTime(10s), HostTime(10s + 600ms)})
           feed(w, at, {start_at(0), begin, start_at(2), click_at(3), end});
       },
       "in overflow: 2 overflows contain all clicks of the slot", "", ""},
      {[](Windows& w) { feed(w, 10s, {start_at(0)}), feed(w, 10s + 499ms, {start_at(1)}); },
       "covers only part: tags for 49 % of the slot", "", ""},
      {[](Windows& w) {
         w.add(radar_frame(10s, 1, {1, 2, 3}));
         DepthFrame wide{.width = 3, .height = 1, .depth_mm = {1, 2, 3}};
         wide.received = 10s;
         w.add(wide);
       },
       "", "other axis: frames of 3 bins", "other axis: frames of 3 x 1"},
      {[](Windows& w) { w.add(radar_frame(10s, 1, {})); }, "", "no range profile", ""},
      {[](Windows& w) {
         CHECK_FALSE(w.announce(radar_of(4, 0.25)));
         w.add(radar_frame(10s, 1, {1, 2, 3, 4}));
         CHECK(w.announce(radar_of(4)));
       },
       "", "other axis: differs from the one at the start of the run", ""}};
  for (const auto& [send, spd, radar, depth] : rows) {
    Windows windows = make_windows();
    send(windows);
    // Tags over half of the next slot are enough.
    feed(windows, 11s, {start_at(2)});
    feed(windows, 11s + 500ms, {start_at(3)});
    const auto r = windows.close({0, false});
    CHECK(r.valid == SensorSet());
    CHECK((counts(r).empty() && power(r).empty() && depth_mm(r).empty()));
    CHECK(verdict(r, Sensor::spd) == (spd.empty() ? "no tags" : spd));
    CHECK(verdict(r, Sensor::radar) == (radar.empty() ? "no frames" : radar));
    CHECK(verdict(r, Sensor::depth) == (depth.empty() ? "no frames" : depth));
    CHECK(windows.close({1, false}).valid == SensorSet{Sensor::spd});
  }
}

TEST_CASE("frames of a device that states neither a number nor a time are used") {
  Windows windows = make_windows();
  for (int k = 0; k < 20; ++k) windows.add(radar_frame(10s, 0, {1, 2, 3, 4}));
  CHECK(windows.close({0, false}).sync[Sensor::radar].used == 13);
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
HistogramFrame histogram(HostTime end, std::vector<std::uint32_t> counts, std::uint64_t lost = 0) {
  return {.received = end,
          .exposure_us = 200'000,
          .pulses = 1000,
          .counts = std::move(counts),
          .lost_before = lost};
}

}  // namespace

TEST_CASE("a record contains the sum of the histograms with mid-exposure in its slot") {
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
  CHECK(counts(r) == std::vector<std::uint32_t>{16, 27, UINT32_MAX});
  CHECK(all(r.spd_counts) ==
        all({.tags = 8'000'003'046, .starts = 3000, .in_range = 8'000'000'046}));
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
  CHECK(counts(mixed) == std::vector<std::uint32_t>{2, 2, 2});
  CHECK(sync(mixed, Sensor::spd).lost == 1);
}

TEST_CASE("histograms of a detector with zones are summed, and other zones are other axes") {
  Windows windows = make_windows();
  DeviceInfo info = board_info();
  info.axes[0].zones = {{0, 0, 0.2, 0}, {0.2, 0, 0.2, 0}};
  REQUIRE(windows.announce(info));
  for (const auto end : {10s + 300ms, 10s + 900ms}) windows.add(histogram(end, {1, 2, 3, 4, 5, 6}));
  CHECK(counts(windows.close({0, false})) == std::vector<std::uint32_t>{2, 4, 6, 8, 10, 12});
  CHECK_FALSE(windows.announce(board_info()));
}
