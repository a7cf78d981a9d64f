// SPDX-License-Identifier: MIT
// Compares the counts of every instruction set of this processor with counts made tag by tag. The
// target SCALAR never uses groups.
#include "drivers/tdc/tag_groups.hpp"

#include <hwy/highway.h>

#include "../catch.hpp"
#include "drivers/core/random.hpp"
#include "tag_reference.hpp"

using namespace echofuse::tdc;

namespace {

void compare(const HistogramSettings& settings, std::span<const Tag> tags, std::size_t block) {
  const test::TagReference expected(settings, tags);
  auto targets = hwy::SupportedAndGeneratedTargets();
  targets.push_back(HWY_SCALAR);
  for (const std::int64_t target : targets) {
    INFO(hwy::TargetName(target));
    hwy::GetChosenTarget().Update(target);
    Histogram histogram(settings);
    for (auto rest = tags; !rest.empty(); rest = rest.subspan(std::min(block, rest.size())))
      histogram.add(rest.first(std::min(block, rest.size())));
    REQUIRE((histogram.counts() == expected.counts));
    REQUIRE(histogram.tag_counts() == expected.n);
  }
  hwy::GetChosenTarget().DeInit();  // lets Highway choose the best target again
}

// Returns random starts, clicks and other tags. Some of the tags go backwards in time. If
// `near_wrap` is true, the times are close to the wrap-around of the clock. On average, one in
// `marker_among` tags is a marker or a bad tag. If `marker_among` is 0, there are no markers or bad
// tags.
std::vector<Tag> stream(Rng& rng, std::size_t size, bool near_wrap, std::uint64_t marker_among) {
  std::vector<Tag> tags(size);
  std::uint64_t time = near_wrap ? (std::uint64_t{1} << 63) - 5'000'000 : rng() >> 20;
  for (Tag& tag : tags) {
    time += rng() % 20'000;
    if (rng() % 50 == 0) time -= rng() % 90'000;
    const auto dice = rng() % 16;
    tag = {.missed_events = static_cast<std::uint16_t>(rng() % 5),
           .channel = dice < 6    ? 1
                      : dice < 14 ? 2
                      : dice < 15 ? -1
                                  : 7,
           .time_ps = static_cast<std::int64_t>(time)};
    if (marker_among == 0 || rng() % marker_among != 0) continue;
    tag.type = static_cast<TagType>(rng() % 6);
    tag.reserved = rng() % 8 == 0;
  }
  return tags;
}

}  // namespace

TEST_CASE("counting tags in SIMD groups gives the same result as counting them one by one") {
  const int streams = std::getenv("ECHOFUSE_LONG") ? 200'000 : 2000;
  constexpr std::uint64_t marker_among[] = {0, 40, 4};
  for (int i = 0; i < streams; ++i) {
    CAPTURE(i);
    Rng rng = make_rng(static_cast<std::uint64_t>(i), 18);
    HistogramSettings settings{.bin_width_ps = 1 + static_cast<std::int64_t>(rng() % 200),
                               .first_bin_ps = static_cast<std::int64_t>(rng() % 20'000) - 5000,
                               .bins = 1 + static_cast<std::uint32_t>(rng() % 934)};
    if (i % 7 == 0) settings.bin_width_ps = std::int64_t{1} << 40, settings.bins = 8;
    if (i % 11 == 0) settings.start_channel = -1;
    compare(settings, stream(rng, rng() % 300, i % 5 == 0, marker_among[i % 3]), 1 + rng() % 97);
  }
  Rng rng = make_rng(1, 19);
  for (const std::uint64_t among : {0, 1000})
    compare({}, stream(rng, 100'000, true, among), 65'536);
}

TEST_CASE("histogram bin edges are exact for tags counted in SIMD groups") {
  const std::int64_t width = 67'108'863;  // the bin width is 2^26 - 1, which is not a power of two
  const std::uint32_t bins = 1u << 24;
  std::vector<Tag> tags{{.channel = 1, .time_ps = 5}};
  Rng rng = make_rng(3, 4);
  for (int i = 0; i < 2000; ++i) {
    const auto border = 5 + static_cast<std::int64_t>(i == 0 ? bins : rng() % bins) * width;
    for (const std::int64_t step : {-1, 0, 1})
      tags.push_back({.channel = 2, .time_ps = border + step});
  }
  compare({.bin_width_ps = width, .first_bin_ps = 0, .bins = bins}, tags, tags.size());
}

TEST_CASE("a marker or an earlier time is found at every position of a block") {
  constexpr std::int64_t first_ps = std::numeric_limits<std::int64_t>::max() - 20;  // times wrap
  struct Change {
    void (*make)(Tag&);
    bool ordered;  // the block still consists of time tags in order
  };
  const Change changes[] = {{[](Tag& t) { t.type = TagType::missed_events; }, false},
                            {[](Tag& t) { t.reserved = 1; }, false},
                            {[](Tag& t) { t.time_ps -= 2; }, false},
                            {[](Tag& t) { t.missed_events = 1; }, true}};
  auto targets = hwy::SupportedAndGeneratedTargets();
  targets.push_back(HWY_SCALAR);
  for (const std::int64_t target : targets) {
    INFO(hwy::TargetName(target));
    hwy::GetChosenTarget().Update(target);
    for (std::size_t count = 1; count <= 40; ++count)
      for (std::size_t at = 0; at < count; ++at)
        for (const Change& change : changes) {
          std::vector<Tag> tags(count, Tag{.channel = -1});
          for (std::size_t i = 0; i < count; ++i)
            tags[i].time_ps = static_cast<std::int64_t>(std::uint64_t{first_ps} + i);
          change.make(tags[at]);
          REQUIRE(only_ordered_times(tags, first_ps) == change.ordered);
        }
  }
  hwy::GetChosenTarget().DeInit();
}
