// SPDX-License-Identifier: MIT
#include "acquire/intake/scheduler.hpp"

#include "../catch.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 100s, .length = 200ms};

using Indices = std::vector<std::int64_t>;

// Calls tick() every 50 ms from `now` to `until`. Returns the slots that became due.
Indices run(Scheduler& scheduler, HostTime& now, HostTime until) {
  Indices due;
  for (; now <= until; now += 50ms)
    for (const DueSlot& slot : scheduler.tick(now)) {
      CHECK_FALSE(slot.stalled);
      due.push_back(slot.index);
    }
  return due;
}

}  // namespace

TEST_CASE("slots up to 10 s begin at multiples of their length, longer ones immediately") {
  for (const auto& [now, length, first] :
       std::vector<std::array<HostTime, 3>>{{100s, 3s, 102s},
                                            {102s, 3s, 102s},
                                            {102s + 1ns, 3s, 105s},
                                            {101s, 10s, 110s},
                                            {101s, 11s, 101s},
                                            {987'654ms, 200ms, 987'800ms}})
    CHECK(first_slot(now, length) == first);
}

TEST_CASE("a slot contains its start time but not its end time") {
  Indices slots;
  for (const auto off : {-200ms - 1ns, -200ms + 0ns, -1ns + 0ns, 0ns, 200ms - 1ns, 200ms + 0ns})
    slots.push_back(grid.slot_of(100s + off));
  CHECK(slots == Indices{-2, -1, -1, 0, 0, 1});
}

TEST_CASE("slot times do not drift over a day") {
  HostTime now = grid.first;
  Scheduler scheduler(grid);
  for (std::int64_t expected = 0; expected < 24 * 3600 * 5; ++expected) {
    const HostTime deadline = scheduler.next_deadline();
    REQUIRE(deadline == grid.first + (expected + 1) * grid.length + grace);
    for (; now + 50ms < deadline; now += 50ms) REQUIRE(scheduler.tick(now + 50ms).empty());
    REQUIRE(scheduler.tick(deadline - 1ns).empty());
    now = deadline + expected % 41 * 1ms;
    REQUIRE(scheduler.tick(now) == std::vector<DueSlot>{{expected, false}});
  }
}

TEST_CASE("each slot is delivered once and in order, and is marked stalled after a long pause") {
  Rng rng = make_rng(2, 0);
  Scheduler scheduler(grid, 5000);
  struct Pause {
    HostTime from, until;
  };
  std::vector<Pause> long_pauses;
  std::vector<DueSlot> all;
  HostTime now = grid.first;
  while (!scheduler.done()) {
    const HostTime before = now;
    now += rng() % 40 == 0 ? std::chrono::milliseconds(rng() % 3000)
                           : std::chrono::milliseconds(rng() % 100);
    if (now - before > grid.length + 100ms) long_pauses.push_back({before, now});
    for (const auto& due : scheduler.tick(now)) {
      REQUIRE(grid.end(due.index) + grace <= now);
      all.push_back(due);
    }
  }
  REQUIRE(all.size() == 5000);
  REQUIRE(long_pauses.size() > 100);
  for (std::int64_t k = 0; k < std::ssize(all); ++k) {
    const HostTime start = grid.start(k);
    const bool stalled = std::ranges::any_of(
        long_pauses, [&](const Pause& p) { return p.from <= start && start < p.until; });
    REQUIRE(all[static_cast<std::size_t>(k)] == DueSlot{k, stalled});
  }
}

TEST_CASE("a slot stays open for another grace time if the program is paused when the slot ends") {
  Scheduler scheduler(grid);
  HostTime now = grid.first;
  CHECK(run(scheduler, now, grid.end(0) + 400ms).empty());
  const HostTime woken = grid.end(0) + 650ms;  // 50 ms after the end of the grace time of slot 0
  CHECK(scheduler.tick(woken).empty());
  CHECK(scheduler.tick(woken + 40ms).empty());
  CHECK(scheduler.next_deadline() == woken + grace);
  // A program that is always late must still close its slots eventually.
  CHECK(scheduler.tick(woken + 400ms).empty());
  CHECK_FALSE(scheduler.tick(woken + grace).empty());
  CHECK(scheduler.lateness(0, woken + grace) == woken - grid.end(0));
}

TEST_CASE("the scheduler ends a run after its slot count or after finish()") {
  Scheduler scheduler(grid, 10);
  HostTime now = grid.first;
  SECTION("the run ends when its slot count is reached") {
    CHECK(run(scheduler, now, 200s).size() == 10);
    CHECK(scheduler.done());
    CHECK(scheduler.tick(300s).empty());
  }
  SECTION("the run ends after finish() when the current slot is complete") {
    CHECK(run(scheduler, now, grid.start(3) + 50ms).empty());
    scheduler.finish(grid.start(3) + 80ms);
    CHECK_FALSE(scheduler.done());
    CHECK(run(scheduler, now, grid.end(3) + grace - 1ns) == Indices{0, 1, 2});
    CHECK(run(scheduler, now, grid.end(3) + grace) == Indices{3});
    CHECK(scheduler.done());
  }
  SECTION("the run ends immediately if finish() is called before the first slot") {
    scheduler.finish(99s);
    CHECK(scheduler.done());
  }
  SECTION("a second finish() does not extend the run") {
    scheduler.finish(grid.start(1));
    scheduler.finish(grid.start(5));
    CHECK(run(scheduler, now, 200s) == Indices{0, 1});
  }
}

TEST_CASE("slots are closed at recorded times, then at their deadlines") {
  Scheduler scheduler(grid, 4, {{grid.end(0), false}, {grid.end(5), true}, {grid.end(5), false}});
  CHECK(scheduler.next_deadline() == grid.end(0));
  CHECK(scheduler.tick(grid.end(0) - 1ns).empty());
  CHECK(scheduler.tick(grid.end(0)) == std::vector<DueSlot>{{0, false}});
  CHECK(scheduler.tick(grid.end(5) - 1ns).empty());
  CHECK(scheduler.tick(grid.end(5)) == std::vector<DueSlot>{{1, true}, {2, false}});
  CHECK(scheduler.next_deadline() >= grid.end(3) + grace);
  CHECK(scheduler.tick(grid.end(9)).empty());
  CHECK(scheduler.tick(grid.end(9) + grace) == std::vector<DueSlot>{{3, true}});
  CHECK(scheduler.done());
}

TEST_CASE("slots missed during a pause wait while the disk is busy, but current slots do not") {
  Backlog backlog;
  const auto next = [&](bool busy) {
    const auto slot = backlog.next(busy);
    return slot ? slot->index : -1;
  };
  backlog.put({{0, false}});
  CHECK(next(true) == 0);
  std::vector<DueSlot> pause;
  for (std::int64_t k = 1; k <= 1000; ++k) pause.push_back({k, true});
  backlog.put(pause);
  CHECK(next(false) == 1);
  CHECK(next(true) == -1);
  std::int64_t k = 1001;
  for (; k < 1000 + Backlog::max_behind; ++k) {
    backlog.put({{k, false}});
    CHECK(next(true) == -1);
  }
  // Once `max_behind` slots have become due after the pause, the slots of the pause are closed
  // even if the disk is busy.
  backlog.put({{k, false}});
  for (std::int64_t i = 2; i <= k; ++i) REQUIRE(next(true) == i);
  CHECK(backlog.empty());
}
