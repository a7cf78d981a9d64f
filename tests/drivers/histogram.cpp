// SPDX-License-Identifier: MIT
#include "drivers/tdc/histogram.hpp"

#include <array>

#include "../catch.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/core/random.hpp"
#include "drivers/tdc/tag_filter.hpp"
#include "drivers/util/exit_code.hpp"

using namespace echofuse::tdc;

namespace {

Tag tag(std::int32_t channel, std::int64_t time_ps) {
  return {.channel = channel, .time_ps = time_ps};
}
Tag marker(TagType type, std::int32_t channel = 0, std::uint16_t missed = 0) {
  return {.type = type, .missed_events = missed, .channel = channel};
}

std::vector<Tag> random_tags(Rng& rng, const HistogramSettings& s, std::size_t count) {
  std::vector<Tag> tags;
  const auto span = s.bin_width_ps * s.bins;
  std::int64_t time = std::numeric_limits<std::int64_t>::max() - 20 * span;
  for (std::size_t i = 0; i < count; ++i) {
    time = static_cast<std::int64_t>(static_cast<std::uint64_t>(time) +
                                     rng() % static_cast<std::uint64_t>(span / 2 + 2));
    const auto dice = rng() % 100;
    if (dice < 45)
      tags.push_back(tag(s.start_channel, time));
    else if (dice < 90)
      tags.push_back(tag(s.click_channel, time));
    else if (dice < 94)
      tags.push_back(tag(-7, time));
    else
      tags.push_back(marker(static_cast<TagType>(1 + rng() % 4),
                            static_cast<std::int32_t>(rng() % 4),
                            static_cast<std::uint16_t>(rng())));
  }
  return tags;
}

// Calls `take` with consecutive blocks of 1 to `most` tags.
template <class Take>
void for_random_blocks(Rng& rng, std::span<const Tag> tags, std::size_t most, Take take) {
  while (!tags.empty()) {
    const std::size_t n = std::min<std::size_t>(tags.size(), 1 + rng() % most);
    take(tags.first(n));
    tags = tags.subspan(n);
  }
}

}  // namespace

TEST_CASE("each click is counted once, in the bin of its delay after the last start") {
  Histogram h({.bin_width_ps = 100, .first_bin_ps = 1000, .bins = 4});
  h.add(std::vector{tag(1, 0), tag(2, 1000), tag(2, 1099), tag(2, 1100), tag(2, 1399), tag(2, 1400),
                    tag(2, 999), tag(1, 500), tag(2, 1500)});
  CHECK(h.counts() == std::vector<std::uint32_t>{3, 1, 0, 1});
  CHECK(h.tag_counts() ==
        TagCounts{.tags = 9, .starts = 2, .in_range = 5, .out_of_range = 2, .backwards = 2});
}

TEST_CASE("the last start is kept across slots but not across a gap in the tags") {
  Histogram h({.bin_width_ps = 100, .first_bin_ps = 0, .bins = 10});
  h.add(std::vector{tag(1, 0), tag(2, 50)});
  CHECK(h.take()[0] == 1);
  CHECK(h.tag_counts() == TagCounts{});
  h.add(std::vector{tag(2, 150)});
  CHECK(h.take()[1] == 1);
  h.forget_start();
  h.add(std::vector{tag(2, 250)});
  CHECK(h.tag_counts() == TagCounts{.tags = 1, .without_start = 1});
  CHECK(h.counts() == std::vector<std::uint32_t>(10));
}

TEST_CASE("the tag filter delays and sorts tags and removes tags within the dead time") {
  const std::vector<Tag> tags{tag(1, 100), tag(2, 110), tag(2, 115), tag(1, 200)};
  TagFilter plain(FilterSettings{});
  CHECK(plain.feed(tags).data() == tags.data());
  TagFilter filter({.click_delay_ps = 150, .dead_time_ps = 10});
  std::vector<std::int64_t> times;
  const auto note = [&](std::span<const Tag> out) {
    for (const Tag& t : out) times.push_back(t.time_ps);
  };
  note(filter.feed(tags));
  CHECK(times == std::vector<std::int64_t>{100, 200});
  note(filter.feed(std::vector{marker(TagType::error)}));
  CHECK(times == std::vector<std::int64_t>{100, 200, 260, 0});
  CHECK(filter.flush().empty());
  CHECK(filter.take_removed() == 1);
}

TEST_CASE("a tag exactly the dead time after the last kept tag of its channel is kept") {
  TagFilter filter({.dead_time_ps = 10});
  std::vector<std::int64_t> clicks;
  const auto note = [&](std::span<const Tag> out) {
    for (const Tag& t : out)
      if (t.channel == 2) clicks.push_back(t.time_ps);
  };
  note(filter.feed(std::vector{tag(2, 0), tag(2, 9), tag(1, 9), tag(2, 10), tag(2, 19)}));
  note(filter.feed(std::vector{tag(2, 20), tag(1, 21), tag(2, 29)}));
  note(filter.flush());
  CHECK(clicks == std::vector<std::int64_t>{0, 10, 20});
  CHECK(filter.take_removed() == 3);
}

TEST_CASE("the tag filter releases waiting tags if their times stand still") {
  TagFilter filter({.click_delay_ps = 5});
  const std::vector<Tag> clicks((1u << 20) + 1, tag(2, 100));
  CHECK(filter.feed(clicks).size() == clicks.size());
  CHECK(filter.flush().empty());
}

TEST_CASE("tags in random blocks and slots are counted like tags in one block of one slot") {
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    CAPTURE(seed);
    Rng rng = make_rng(seed, 4);
    // A delay makes slots differ, because tags that wait at the end of a slot are counted there.
    const bool slots = seed % 2 == 0;
    const HistogramSettings s{.bin_width_ps = 1000,
                              .first_bin_ps = -2000,
                              .bins = 8,
                              .click_delay_ps = slots ? 0 : std::array{-5000, 7000}[seed % 4 / 2],
                              .dead_time_ps = std::array{0, 2000, 3000}[seed % 3]};
    const auto tags = random_tags(rng, s, 600);
    Histogram expected(s);
    expected.add(tags);
    expected.flush();
    std::vector<Histogram> parts{Histogram(s)};
    parts.reserve(tags.size() + 1);
    for_random_blocks(rng, tags, 12, [&](auto block) {
      if (slots && rng() % 3 == 0) {
        parts.emplace_back(s);
        parts.back().follow(parts[parts.size() - 2]);
      }
      parts.back().add(block);
    });
    parts.back().flush();
    std::vector<std::uint32_t> counts(s.bins);
    TagCounts sum;
    for (const Histogram& part : parts) {
      for (std::size_t i = 0; i < counts.size(); ++i) counts[i] += part.counts()[i];
      sum += part.tag_counts();
    }
    CHECK(counts == expected.counts());
    CHECK(sum == expected.tag_counts());
    CHECK(sum.tags == tags.size());
  }
}

TEST_CASE("the dead time also applies to two clicks on either side of a slot border") {
  const HistogramSettings s{
      .bin_width_ps = 100, .first_bin_ps = 0, .bins = 200, .dead_time_ps = 10'000};
  Histogram first(s), second(s);
  first.add(std::vector{tag(1, 0), tag(2, 5000)});
  second.follow(first);
  second.add(std::vector{tag(2, 6000), tag(2, 15'000)});
  CHECK(first.tag_counts().in_range == 1);
  CHECK(second.tag_counts().removed == 1);
  CHECK(second.tag_counts().in_range == 1);
  CHECK(second.counts()[150] == 1);
}

TEST_CASE("a cable delay longer than the laser period is compensated") {
  constexpr std::int64_t period_ps = 50'000, flight_ps = 26'350, cable_ps = 50'000;
  constexpr std::uint32_t pulses = 1000;
  std::vector<Tag> tags;
  for (std::int64_t k = 0; k < pulses; ++k) {
    tags.push_back(tag(1, k * period_ps));
    if (k > 0) tags.push_back(tag(2, (k - 1) * period_ps + flight_ps + cable_ps));
  }
  Histogram histogram({.click_delay_ps = -cable_ps});
  histogram.add(tags);
  histogram.flush();
  CHECK(histogram.counts()[(flight_ps - 13343) / 100] == pulses - 1);
}

TEST_CASE("the histogram axis matches the bin settings") {
  CHECK(same_axis(Histogram({}).axis(), Axis{"spd", "counts", "ps", 336, 13343, 100}));
}

TEST_CASE("invalid histogram settings are refused") {
  CHECK_THROWS_AS(Histogram({.bins = 0}), Error);
  CHECK_THROWS_AS(Histogram({.bin_width_ps = 0}), Error);
  CHECK_THROWS_AS(Histogram({.start_channel = 2}), Error);
  CHECK_THROWS_AS(Histogram({.bin_width_ps = 1ll << 50, .bins = 2}), Error);
  CHECK_THROWS_AS(Histogram({.bins = (1u << 24) + 1}), Error);
  CHECK_THROWS_AS(Histogram({.click_delay_ps = -1'000'000'001}), Error);
  CHECK_THROWS_AS(Histogram({.dead_time_ps = -1}), Error);
}
