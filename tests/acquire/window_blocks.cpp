// SPDX-License-Identifier: MIT
// Tests that records do not depend on the division of the tags into blocks.
#include <chrono>
#include <span>
#include <vector>

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "acquire/intake/window.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

constexpr SlotGrid grid{.first = 10s, .length = 1s};
constexpr tdc::HistogramSettings tdc_settings{.bin_width_ps = 100, .first_bin_ps = 0, .bins = 50};

Tag start_at(std::int64_t ps) { return {.channel = 1, .time_ps = ps}; }
Tag click_at(std::int64_t ps) { return {.channel = 2, .time_ps = ps}; }

}  // namespace

TEST_CASE("tags in random blocks give the same records as one block for each 100 ms") {
  // The clock fit is given, so the times of the tags do not depend on the blocks.
  SensorClocks clocks;
  std::vector<Tag> tags;
  Rng rng = make_rng(1, 6);
  for (std::int64_t ms = 0; ms < 1000; ms += 10) {
    const std::vector<Tag> mark{start_at(ms * 1'000'000'000)};
    clocks.observe(TagBlock{.received = 10s + std::chrono::milliseconds(ms), .tags = mark});
  }
  REQUIRE(clocks[Sensor::spd].sound());
  for (std::int64_t ps = 0; ps < 3'000'000'000'000;
       ps += 1'000'000'000 + std::int64_t(rng() % 4000))
    for (const Tag& tag : {start_at(ps), click_at(ps + std::int64_t(rng() % 6000))})
      tags.push_back(tag);
  const auto records = [&](auto size) {
    auto settings = tdc_settings;
    settings.dead_time_ps = 1'000'000'000;
    Windows windows({.first = 10s, .length = 700ms}, settings, clocks, {Sensor::spd});
    for (std::span<const Tag> rest = tags; !rest.empty();) {
      const auto block = rest.first(std::min<std::size_t>(rest.size(), size()));
      const HostTime last(10s + std::chrono::nanoseconds(block.back().time_ps / 1000 + 1000));
      windows.add(TagBlock{.received = last, .tags = block});
      rest = rest.subspan(block.size());
    }
    std::vector<record::FusedRecord> all;
    for (std::int64_t k = 0; k < 4; ++k) all.push_back(windows.close({.index = k}));
    return all;
  };
  const auto expected = records([] { return 100u; });
  for (int round = 0; round < 20; ++round) {
    const auto found = records([&] { return 1 + rng() % 50; });
    for (std::size_t k = 0; k < 4; ++k) {
      CAPTURE(round, k);
      CHECK(expected[k].spd_counts.removed > 0);
      CHECK(counts(found[k]) == counts(expected[k]));
      CHECK(found[k].spd_counts == expected[k].spd_counts);
      CHECK(found[k].valid == expected[k].valid);
    }
  }
}
