// SPDX-License-Identifier: MIT
#include "acquire/intake/tag_check.hpp"

#include <span>

#include "../catch.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

// Returns starts and clicks with times that wrap at 2^32 ps. Neighbours are up to 1 us out of
// order.
std::vector<Tag> wrapping_tags(Rng& rng, std::size_t count, std::vector<std::int64_t>& in_order) {
  std::vector<Tag> tags;
  std::int64_t time_ps = 3'000'000'000;
  for (std::size_t i = 0; i < count; ++i) {
    time_ps += static_cast<std::int64_t>(rng() % 4'000'000);
    tags.push_back({.channel = 1 + static_cast<std::int32_t>(rng() % 2), .time_ps = time_ps});
    in_order.push_back(time_ps);
  }
  for (std::size_t i = 1; i < count; i += 2)
    if (tags[i].time_ps - tags[i - 1].time_ps < 900'000) std::swap(tags[i], tags[i - 1]);
  for (Tag& tag : tags) tag.time_ps &= 0xffff'ffff;
  return tags;
}

struct Checked {
  std::vector<std::int64_t> times;
  std::vector<std::string> reports;
};

template <class Size>
Checked checked(std::span<const Tag> tags, Size size) {
  Checked out;
  TagCheck check({}, false, [&](const std::string& text) { out.reports.push_back(text); });
  const auto keep = [&](const TagBlock& block) {
    for (const Tag& tag : block.tags) out.times.push_back(tag.time_ps);
  };
  // All blocks arrive within one second, in which the events wait for later events.
  while (!tags.empty()) {
    const auto block = tags.first(std::min<std::size_t>(tags.size(), size()));
    check.take({.received = 5s, .tags = block}, keep);
    tags = tags.subspan(block.size());
  }
  check.flush(keep);
  check.finish();
  return out;
}

}  // namespace

TEST_CASE("tags in random blocks are sorted, unwrapped and reported like tags in one block") {
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    CAPTURE(seed);
    Rng rng = make_rng(seed, 7);
    std::vector<std::int64_t> in_order;
    const auto tags = wrapping_tags(rng, 4000, in_order);
    const Checked whole = checked(tags, [&] { return tags.size(); });
    CHECK((whole.times == in_order));
    REQUIRE(whole.reports.size() >= 2);
    CHECK_THAT(whole.reports[0], Catch::StartsWith("2 wrap-arounds of the tagger's time at 2^32"));
    CHECK_THAT(whole.reports[1], Catch::Contains(" events out of order by up to 1 us"));
    const Checked cut = checked(tags, [&] { return 1 + rng() % 40; });
    CHECK((cut.times == in_order));
    CHECK(cut.reports == whole.reports);
  }
}
