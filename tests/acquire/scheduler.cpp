// SPDX-License-Identifier: MIT
#include "acquire/scheduler.hpp"

#include <catch2/catch.hpp>
#include <vector>

#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 100s, .length = 200ms};

std::vector<std::int64_t> indices(const std::vector<DueSlot>& due) {
  std::vector<std::int64_t> all;
  for (const auto& d : due) all.push_back(d.index);
  return all;
}

}  // namespace

TEST_CASE("a time belongs to the slot whose half-open interval holds it") {
  CHECK(grid.slot_of(100s) == 0);
  CHECK(grid.slot_of(100s + 200ms - 1ns) == 0);
  CHECK(grid.slot_of(100s + 200ms) == 1);
  CHECK(grid.slot_of(100s - 1ns) == -1);
  CHECK(grid.slot_of(100s - 200ms) == -1);
  CHECK(grid.slot_of(100s - 200ms - 1ns) == -2);
}

TEST_CASE("slots are absolute: a day of them drifts by nothing") {
  ManualClock clock;
  clock.set(grid.first);
  Scheduler scheduler(grid, 50ms);
  Rng rng = make_rng(1, 0);
  std::uniform_int_distribution<int> late_us(0, 150'000);
  std::int64_t expected = 0;
  while (expected < 24 * 3600 * 5) {
    clock.set(scheduler.next_deadline() - 1ns);
    REQUIRE(scheduler.tick(clock.now()).empty());
    clock.advance(1ns + std::chrono::microseconds(late_us(rng)));
    const auto due = scheduler.tick(clock.now());
    REQUIRE(due == std::vector<DueSlot>{{expected, false}});
    ++expected;
  }
  CHECK(scheduler.next_deadline() == grid.first + (expected + 1) * grid.length + 50ms);
}

TEST_CASE("random stalls: every slot comes once and in order, stalled if it began in a gap") {
  Rng rng = make_rng(2, 0);
  Scheduler scheduler(grid, 50ms, 5000);
  struct Gap {
    std::int64_t first_due;
    HostTime until;
  };
  std::vector<Gap> gaps;
  std::vector<DueSlot> all;
  HostTime now = grid.first;
  while (!scheduler.done()) {
    const bool stall = rng() % 10 == 0;
    now += stall ? std::chrono::milliseconds(rng() % 3000) : std::chrono::milliseconds(rng() % 100);
    const HostTime deadline = scheduler.next_deadline();
    if (now - deadline > grid.length) gaps.push_back({scheduler.closed(), now});
    for (const auto& due : scheduler.tick(now)) {
      REQUIRE(grid.end(due.index) + 50ms <= now);
      all.push_back(due);
    }
  }
  REQUIRE(all.size() == 5000);
  REQUIRE(gaps.size() > 100);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto index = static_cast<std::int64_t>(k);
    bool in_gap = false;
    for (const auto& gap : gaps)
      in_gap = in_gap || (index > gap.first_due && grid.start(index) < gap.until);
    REQUIRE(all[k] == DueSlot{index, in_gap});
  }
}

TEST_CASE("the end of a run") {
  Scheduler scheduler(grid, 50ms, 10);
  SECTION("after its count, however late the call") {
    CHECK(scheduler.tick(200s).size() == 10);
    CHECK(scheduler.done());
    CHECK(scheduler.tick(300s).empty());
  }
  SECTION("finish lets the running slot end") {
    scheduler.tick(grid.end(2) + 60ms);
    scheduler.finish(grid.start(3) + 80ms);
    CHECK_FALSE(scheduler.done());
    CHECK(scheduler.tick(grid.end(3) + 49ms).empty());
    CHECK(indices(scheduler.tick(grid.end(3) + 50ms)) == std::vector<std::int64_t>{3});
    CHECK(scheduler.done());
  }
  SECTION("finish in the grace period also ends the slot that has begun") {
    scheduler.finish(grid.start(1) + 10ms);
    CHECK(indices(scheduler.tick(200s)) == std::vector<std::int64_t>{0, 1});
    CHECK(scheduler.done());
  }
  SECTION("finish before the first slot") {
    scheduler.finish(99s);
    CHECK(scheduler.done());
  }
  SECTION("a second finish does not extend the run") {
    scheduler.finish(grid.start(1));
    scheduler.finish(grid.start(5));
    CHECK(scheduler.tick(200s).size() == 2);
  }
}

TEST_CASE("the grace period is a quarter of the slot, at most 50 ms") {
  CHECK(Scheduler::default_grace(3s) == 50ms);
  CHECK(Scheduler::default_grace(100ms) == 25ms);
}
