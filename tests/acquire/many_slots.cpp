// SPDX-License-Identifier: MIT
// Tests 100 000 slots on a virtual clock. Each device has its own clock, disconnects and
// reconnects. Some samples are delayed or lost. Every sample must be accounted for, and its slot
// must match its true time.

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "acquire/intake/window.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 1000s, .length = 100ms};

}  // namespace

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
