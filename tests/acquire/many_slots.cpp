// SPDX-License-Identifier: MIT
// Tests 100 000 slots on a virtual clock. Each device has its own clock, disconnects and
// reconnects. Some samples are delayed or lost. Every sample must be accounted for, and its slot
// must match its true time.
#include <cmath>
#include <numeric>

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "acquire/intake/window.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 1000s, .length = 100ms};
constexpr std::int64_t slots = 100'000;

// Simulates a device that takes a sample every `period_s` or slightly later. The device clock
// drifts and restarts whenever the device is reconnected.
class Device {
 public:
  Device(double period_s, double tick_s, std::uint64_t seed)
      : period_s_(period_s), tick_s_(tick_s), rng_(make_rng(seed, 9)) {
    plug_in();
  }

  HostTime taken() const { return at(taken_s_); }
  HostTime received() const { return received_; }
  std::uint64_t ticks() const {
    return static_cast<std::uint64_t>(
        std::llround((offset_s_ + (taken_s_ - plugged_s_) * (1 + drift_)) / tick_s_));
  }
  bool reconnected() const { return taken_s_ == plugged_s_ && taken_s_ > 0; }
  bool settled() const { return taken_s_ - plugged_s_ > 30; }

  // Advances to the next sample that arrives. Returns the number of samples lost before that
  // sample.
  std::uint32_t next() {
    std::uint32_t lost = 0;
    do {
      taken_s_ += period_s_ * (1 + 0.2 * uniform_(rng_));
      if (rng_() % 20'000 == 0) {
        taken_s_ += 20 * uniform_(rng_);
        plug_in();
        return 0;
      }
    } while (rng_() % 200 == 0 && ++lost);
    const double delay_s = 0.05 * uniform_(rng_) + (rng_() % 500 == 0 ? uniform_(rng_) : 0);
    received_ = std::max(received_, at(taken_s_ + delay_s));
    return lost;
  }

 private:
  static HostTime at(double s) { return grid.first - 40s + from_seconds(s); }
  void plug_in() {
    plugged_s_ = taken_s_;
    offset_s_ = uniform_(rng_) - 0.5 + 1;
    drift_ = 400e-6 * (uniform_(rng_) - 0.5);
    received_ = std::max(received_, taken());
  }

  double period_s_, tick_s_;
  Rng rng_;
  std::uniform_real_distribution<double> uniform_{0, 1};
  double taken_s_ = 0, plugged_s_ = 0, offset_s_ = 0, drift_ = 0;
  HostTime received_{};
};

struct Laboratory {
  Device devices[3] = {{0.02, 1e-12, 1}, {0.05, 5e-9, 2}, {0.06, 1e-6, 3}};
  SensorClocks clocks;
  Windows windows{grid, {.first_bin_ps = 0, .bins = 1}, clocks, SensorSet::from_bits(7)};
  Scheduler scheduler{grid, slots};
  std::vector<record::FusedRecord> records;
  struct Shot {
    HostTime taken;
    bool settled;
  };
  std::vector<Shot> shots;  // camera frames in the order of their frame numbers
  PerSensor<std::uint64_t> sent{}, lost{}, reconnections{}, settled{};
  HostTime worst_error{};
  std::uint32_t number = 0;

  void run() {
    windows.announce(radar_of());
    windows.announce(camera_of(2, 1));
    HostTime tick = grid.first;
    std::array<std::uint32_t, 3> lost_before{};
    while (!scheduler.done()) {
      std::size_t next = 0;
      for (std::size_t i = 1; i < 3; ++i)
        if (devices[i].received() < devices[next].received()) next = i;
      for (; tick <= devices[next].received() && !scheduler.done(); tick += 20ms)
        for (const DueSlot& due : scheduler.tick(tick)) close(due);
      deliver(next, lost_before[next]);
      lost_before[next] = devices[next].next();
    }
    windows.finish();
  }

  void close(const DueSlot& due) {
    records.push_back(windows.close(due));
    REQUIRE_FALSE(due.stalled);
  }

  void deliver(std::size_t i, std::uint32_t lost_before) {
    const Device& device = devices[i];
    const auto sensor = static_cast<Sensor>(i);
    if (device.reconnected()) ++reconnections[sensor];
    i == 0   ? put_tags(device, lost_before)
    : i == 1 ? put_radar(device, lost_before)
             : put_depth(device, lost_before);
    const HostTime error =
        abs(clocks[sensor].taken(device.ticks(), device.received()) - device.taken());
    if (device.settled() && clocks[sensor].sound()) {
      ++settled[sensor];
      worst_error = std::max(worst_error, error);
    }
    // Samples lost before the run do not count. A block has four tags.
    if (device.taken() >= grid.first + 1s)
      lost[sensor] += lost_before * (sensor == Sensor::spd ? 4 : 1);
  }

  // Sends a block of four tags taken during the last 20 ms.
  void put_tags(const Device& device, std::uint32_t lost_before) {
    std::vector<Tag> tags(4);
    for (std::size_t i = 0; i < 4; ++i)
      tags[i] = {.channel = 1 + static_cast<int>(i % 2),
                 .time_ps = static_cast<std::int64_t>(device.ticks()) -
                            static_cast<std::int64_t>(3 - i) * 5'000'000'000};
    const TagBlock block{.received = device.received(), .tags = tags, .lost_blocks = lost_before};
    clocks.observe(block);
    windows.add(block);
    sent[Sensor::spd] += 4;
  }
  void put_radar(const Device& device, std::uint32_t lost_before) {
    RadarFrame frame;
    frame.received = device.received();
    frame.frame_number = ++number;
    frame.time_cpu_cycles = static_cast<std::uint32_t>(device.ticks());
    frame.lost_before = lost_before;
    frame.power = {100};
    clocks.observe(frame);
    windows.add(frame);
    ++sent[Sensor::radar];
  }
  void put_depth(const Device& device, std::uint32_t lost_before) {
    DepthFrame frame;
    frame.received = device.received();
    frame.frame_number = static_cast<std::uint32_t>(shots.size());
    frame.device_time_us = device.ticks();
    frame.lost_before = lost_before;
    frame.width = 2;
    frame.height = 1;
    frame.depth_mm = {static_cast<std::uint16_t>(frame.frame_number),
                      static_cast<std::uint16_t>(frame.frame_number >> 16)};
    shots.push_back({device.taken(), device.settled()});
    clocks.observe(frame);
    windows.add(std::move(frame));
    ++sent[Sensor::depth];
  }
};

}  // namespace

TEST_CASE("a run of 100 000 slots has no drift, no missing record and no sample in a wrong slot") {
  Laboratory lab;
  lab.run();
  REQUIRE(lab.records.size() == slots);
  std::uint64_t tags = 0, radar = 0, misplaced = 0, depth = 0;
  PerSensor<std::uint64_t> lost{}, valid{};
  for (std::int64_t k = 0; k < slots; ++k) {
    const auto& r = lab.records[static_cast<std::size_t>(k)];
    REQUIRE((r.index == k && r.slot_start == grid.first + k * grid.length &&
             r.slot_end == r.slot_start + grid.length));
    const auto& c = r.spd_counts;
    REQUIRE(c.starts + c.in_range + c.out_of_range + c.without_start + c.other == c.tags);
    tags += c.tags;
    radar += r.sync[Sensor::radar].used;
    for (const Sensor s : all_sensors) {
      lost[s] += r.sync[s].lost;
      valid[s] += r.has(s);
    }
    if (!r.has(Sensor::depth)) continue;
    const auto shot = lab.shots.at(depth_mm(r)[0] + 65536u * depth_mm(r)[1]);
    if (!shot.settled) continue;
    ++depth;
    misplaced += shot.taken < r.slot_start - 5ms || shot.taken > r.slot_end + 5ms;
  }
  const UnassignedSamples& unassigned = lab.windows.unassigned();
  CHECK(tags + unassigned.early[Sensor::spd] + unassigned.late[Sensor::spd] +
            unassigned.outside[Sensor::spd] ==
        lab.sent[Sensor::spd]);
  CHECK(radar + unassigned.early[Sensor::radar] + unassigned.late[Sensor::radar] +
            unassigned.outside[Sensor::radar] ==
        lab.sent[Sensor::radar]);
  for (const Sensor s : all_sensors) {
    CHECK(unassigned.duplicate[s] + unassigned.out_of_order[s] == 0);
    CHECK(lab.reconnections[s] > 5);
    CHECK(lab.settled[s] > lab.sent[s] / 10);
    CHECK(std::abs(static_cast<double>(lost[s]) - static_cast<double>(lab.lost[s])) <= 8);
    CHECK(lost[s] > 500);
    CHECK(valid[s] > slots * 8 / 10);
  }
  INFO("worst error " << 1e3 * seconds(lab.worst_error) << " ms, " << misplaced << " of " << depth
                      << " depth frames misplaced, late " << unassigned.late[Sensor::spd]
                      << " tags, " << unassigned.late[Sensor::radar] << " + "
                      << unassigned.late[Sensor::depth] << " frames of " << lab.sent[Sensor::spd]
                      << ", " << lab.sent[Sensor::radar] << " + " << lab.sent[Sensor::depth]);
  CHECK(lab.worst_error < 5ms);
  CHECK(misplaced == 0);
  CHECK(depth > slots * 8 / 10);
  CHECK(unassigned.late[Sensor::spd] < lab.sent[Sensor::spd] / 50);
}

TEST_CASE("each tag is counted exactly once despite damaged time stamps and stalls") {
  SensorClocks clocks;
  Windows windows(grid, {.first_bin_ps = 0, .bins = 4}, clocks, {Sensor::spd});
  Scheduler scheduler(grid, 2000);
  Rng rng = make_rng(11, 0);
  std::uint64_t sent = 0, counted = 0, stalled = 0;
  std::int64_t closed = 0;
  HostTime now = grid.first - 5s;
  while (!scheduler.done()) {
    now += std::chrono::milliseconds(rng() % 500 == 0 ? rng() % 3000 : rng() % 40);
    const std::int64_t time = (now - grid.first).count() * 1000;
    std::vector<Tag> tags(rng() % 300);
    for (std::size_t i = 0; i < tags.size(); ++i) {
      Tag& tag = tags[i];
      tag.channel = static_cast<std::int32_t>(rng() % 3);
      tag.time_ps = time - 40'000'000 * static_cast<std::int64_t>(tags.size() - i);
      if (rng() % 50 == 0) tag.time_ps = static_cast<std::int64_t>(rng());
      if (rng() % 50 == 0)
        tag.time_ps += (static_cast<std::int64_t>(rng() % 2000) - 1500) * 1'000'000'000;
      if (rng() % 50 == 0) tag.type = static_cast<TagType>(rng() % 7);
    }
    const TagBlock block{.received = now, .tags = tags};
    clocks.observe(block);
    windows.add(block);
    sent += tags.size();
    for (const DueSlot& due : scheduler.tick(now)) {
      const record::FusedRecord r = windows.close(due);
      const TagCounts& c = r.spd_counts;
      REQUIRE(c.starts + c.in_range + c.out_of_range + c.without_start + c.other == c.tags);
      counted += c.tags;
      stalled += due.stalled;
      REQUIRE(r.index == closed++);
      REQUIRE(std::abs(r.sync[Sensor::spd].offset_s) <= 0.05);
      if (r.has(Sensor::spd))
        REQUIRE(std::accumulate(counts(r).begin(), counts(r).end(), 0u) == r.spd_counts.in_range);
    }
  }
  std::uint64_t late = 0;
  for (const auto& [slot, number] : windows.take_late()) late += number[Sensor::spd];
  windows.finish();
  CHECK(clocks[Sensor::spd].state(now));
  CHECK(counted > sent / 2);
  CHECK(stalled > 10);
  const UnassignedSamples& unassigned = windows.unassigned();
  CHECK(late > 0);
  CHECK(late == unassigned.late[Sensor::spd]);
  CHECK(unassigned.early[Sensor::spd] > 0);
  CHECK(unassigned.outside[Sensor::spd] > 0);
  CHECK(counted + unassigned.early[Sensor::spd] + unassigned.late[Sensor::spd] +
            unassigned.outside[Sensor::spd] ==
        sent);
}
