// SPDX-License-Identifier: MIT
#include "drivers/tdc/histogram.hpp"

#include <array>

#include "../fixtures/error.hpp"
#include "drivers/core/random.hpp"
#include "drivers/tdc/tag_filter.hpp"

using namespace echofuse::tdc;

namespace {

Tag tag(std::int32_t channel, std::int64_t time_ps) {
  return {.channel = channel, .time_ps = time_ps};
}
Tag marker(TagType type, std::int32_t channel = 0, std::uint16_t missed = 0) {
  return {.type = type, .missed_events = missed, .channel = channel};
}

std::vector<Tag> random_tags(Rng& rng, std::size_t count) {
  std::vector<Tag> tags(count);
  std::uint64_t time = std::numeric_limits<std::int64_t>::max() - 160'000;  // the times wrap
  for (Tag& one : tags) {
    time += rng() % 4002;
    const auto dice = rng() % 100;
    one = dice < 94
              ? tag(dice < 45   ? 1
                    : dice < 90 ? 2
                                : -7,
                    static_cast<std::int64_t>(time))
              : marker(static_cast<TagType>(1 + rng() % 4), static_cast<std::int32_t>(rng() % 4),
                       static_cast<std::uint16_t>(rng()));
  }
  return tags;
}

using Times = std::vector<std::int64_t>;

Times times_of(std::span<const Tag> tags) {
  Times times;
  for (const Tag& t : tags) times.push_back(t.time_ps);
  return times;
}

// Returns the tags of laser pulses emitted every 50 ns. Each pulse causes a click with the
// probability `chance`. If `filtered` is true, starts that are not followed by a click are left
// out.
std::vector<Tag> pulses(double chance, bool filtered, std::int64_t count, Rng& rng) {
  std::bernoulli_distribution clicks(chance);
  std::vector<Tag> tags;
  for (std::int64_t n = 0; n < count; ++n) {
    const bool click = clicks(rng);
    if (click || !filtered) tags.push_back(tag(1, n * 50'000));
    if (click) tags.push_back(tag(2, n * 50'000 + 6667));
  }
  return tags;
}

double share_of(const std::vector<Tag>& tags) {
  StartGaps gaps(1);
  gaps.add(tags);
  REQUIRE(gaps.share());
  return *gaps.share();
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
  CHECK(times_of(filter.feed(tags)) == Times{100, 200});
  CHECK(times_of(filter.feed(std::vector{marker(TagType::error)})) == Times{260, 0});
  CHECK(filter.flush().empty());
  CHECK(filter.take_removed() == 1);
}

TEST_CASE("a tag exactly the dead time after the last kept tag of its channel is kept") {
  TagFilter filter({.dead_time_ps = 10});
  CHECK(times_of(filter.feed(std::vector{tag(2, 0), tag(2, 9), tag(1, 9), tag(2, 10),
                                         tag(2, 19)})) == Times{0, 9, 10});
  CHECK(times_of(filter.feed(std::vector{tag(2, 20), tag(1, 21), tag(2, 29)})) == Times{20, 21});
  CHECK(filter.flush().empty());
  CHECK(filter.take_removed() == 3);
}

TEST_CASE("the tag filter releases waiting tags if their times stand still") {
  TagFilter filter({.click_delay_ps = 5});
  const std::vector<Tag> clicks((1u << 20) + 1, tag(2, 100));
  CHECK(filter.feed(std::span(clicks).first(1u << 20)).empty());
  CHECK(filter.feed(std::span(clicks).last(1)).size() == clicks.size());
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
    const auto tags = random_tags(rng, 600);
    Histogram expected(s);
    expected.add(tags);
    expected.flush();
    std::vector<Histogram> parts{Histogram(s)};
    parts.reserve(tags.size() + 1);
    for (std::span<const Tag> rest = tags; !rest.empty();) {
      if (slots && rng() % 3 == 0) {
        parts.emplace_back(s);
        parts.back().follow(parts[parts.size() - 2]);
      }
      const std::size_t n = std::min<std::size_t>(rest.size(), 1 + rng() % 12);
      parts.back().add(rest.first(n));
      rest = rest.subspan(n);
    }
    parts.back().flush();
    std::vector<std::uint32_t> counts(s.bins);
    TagCounts sum;
    for (const Histogram& part : parts) {
      std::ranges::transform(counts, part.counts(), counts.begin(), std::plus());
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
  constexpr std::int64_t period_ps = 50'000, flight_ps = 26'350, cable_ps = 50'000, pulses = 1000;
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

TEST_CASE("the histogram axis matches the bin settings, and invalid settings are refused") {
  CHECK(same_axis(Histogram({}).axis(), Axis{"spd", "counts", "ps", 336, 13343, 100}));
  const auto refused = [](const HistogramSettings& s) {
    return test::error_of([&] { Histogram{s}; }).first == ExitCode::config;
  };
  CHECK_FALSE(refused({.bins = 1u << 24}));
  CHECK(refused({.bins = (1u << 24) + 1}));
  CHECK(refused({.bins = 0}));
  CHECK(refused({.bin_width_ps = 0}));
  CHECK(refused({.start_channel = 2}));
  CHECK_FALSE(refused({.bin_width_ps = 1ll << 49, .bins = 2}));
  CHECK(refused({.bin_width_ps = (1ll << 49) + 1, .bins = 2}));
  for (const int sign : {-1, 1}) {
    CHECK_FALSE(refused({.click_delay_ps = sign * 1'000'000'000}));
    CHECK(refused({.click_delay_ps = sign * 1'000'000'001}));
  }
  CHECK_FALSE(refused({.dead_time_ps = 1'000'000'000}));
  CHECK(refused({.dead_time_ps = 1'000'000'001}));
  CHECK(refused({.dead_time_ps = -1}));
}

TEST_CASE(
    "if a conditional filter is used, click probability is computed from gaps between starts") {
  Rng rng = make_rng(7, 0);
  for (const double chance : {0.03, 0.1, 0.5, 0.95}) {
    const double n = 1e6 * chance, gaps = std::min(n, 1e5);
    CHECK(std::abs(share_of(pulses(chance, true, 1'000'000, rng)) - chance) <
          5 * std::sqrt(chance * (1 - chance) / gaps));
  }
  for (const double chance : {1e-3, 5e-3})
    CHECK(share_of(pulses(chance, true, 10'000'000, rng)) < 0.02);
}

TEST_CASE("gaps in the tags and damaged time stamps do not count as laser pulses") {
  Rng rng = make_rng(7, 2);
  auto tags = pulses(0.1, true, 1'000'000, rng);
  const double whole = share_of(tags);
  for (std::size_t i = 500; i < tags.size(); i += 5000) tags[i].time_ps ^= std::int64_t{1} << 40;
  for (std::size_t i = 700; i < tags.size(); i += 5000) tags[i].time_ps += 3;
  for (std::size_t i = 900; i < tags.size(); i += 5000) tags[i].type = TagType::overflow_begin;
  CHECK(std::abs(share_of(tags) - whole) < 2e-3);
  StartGaps gaps(1);
  for (const Tag& tag : tags) {
    gaps.add({&tag, 1});
    gaps.forget_start();
  }
  CHECK_FALSE(gaps.share());
}

TEST_CASE("clicks per laser pulse are equal with and without a conditional filter") {
  Rng rng = make_rng(7, 3);
  for (const double chance : {0.03, 0.1, 0.5})
    for (const bool filtered : {false, true}) {
      const auto tags = pulses(chance, filtered, 300'000, rng);
      StartGaps gaps(1);
      gaps.add(tags);
      const auto starts = static_cast<std::uint64_t>(
          std::ranges::count(tags, 1, [](const Tag& t) { return t.channel; }));
      if (!filtered) CHECK(gaps.share() == 1);
      CHECK(gaps.clicks_per_pulse(tags.size() - starts, starts).value() ==
            Approx(chance).epsilon(0.1));
    }
  // The following streams contain too few tags for an estimate.
  StartGaps few(1), slow(1);
  CHECK_FALSE(few.clicks_per_pulse(0, 0));
  few.add(pulses(1e-3, true, 100'000, rng));
  CHECK_FALSE(few.clicks_per_pulse(100, 100));
  slow.add(pulses(0.5, false, 30, rng));
  CHECK(slow.clicks_per_pulse(15, 30) == 0.5);
}
