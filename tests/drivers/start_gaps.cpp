// SPDX-License-Identifier: MIT

#include "../catch.hpp"
#include "drivers/core/random.hpp"
#include "drivers/tdc/histogram.hpp"

using namespace echofuse::tdc;

namespace {

// Returns the tags of laser pulses emitted every 50 ns. Each pulse causes a click with the
// probability `chance`. If `filtered` is true, starts that are not followed by a click are left
// out.
std::vector<Tag> pulses(double chance, bool filtered, std::int64_t count, Rng& rng) {
  std::bernoulli_distribution clicks(chance);
  std::vector<Tag> tags;
  for (std::int64_t n = 0; n < count; ++n) {
    const bool click = clicks(rng);
    if (click || !filtered) tags.push_back({.channel = 1, .time_ps = n * 50'000});
    if (click) tags.push_back({.channel = 2, .time_ps = n * 50'000 + 6667});
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

TEST_CASE("if no conditional filter is used, the pulse count does not depend on the brightness") {
  Rng rng = make_rng(7, 1);
  for (const double chance : {0.001, 0.5, 1.0})
    CHECK(share_of(pulses(chance, false, 20'000, rng)) == 1);
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
  for (const double chance : {0.03, 0.1, 0.5}) {
    for (const bool filtered : {false, true}) {
      const auto tags = pulses(chance, filtered, 300'000, rng);
      StartGaps gaps(1);
      gaps.add(tags);
      const auto starts = static_cast<std::uint64_t>(
          std::count_if(tags.begin(), tags.end(), [](const Tag& t) { return t.channel == 1; }));
      CHECK(gaps.clicks_per_pulse(tags.size() - starts, starts).value() ==
            Approx(chance).epsilon(0.1));
    }
  }
  // The following streams contain too few tags for an estimate.
  StartGaps few(1);
  CHECK_FALSE(few.clicks_per_pulse(0, 0));
  few.add(pulses(1e-3, true, 100'000, rng));
  CHECK_FALSE(few.clicks_per_pulse(100, 100));
  StartGaps slow(1);
  slow.add(pulses(0.5, false, 30, rng));
  CHECK(slow.clicks_per_pulse(15, 30) == 0.5);
}
