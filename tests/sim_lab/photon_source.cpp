// SPDX-License-Identifier: MIT
// Compares the simulated photon stream with the expected histogram by a chi-squared test.
#include "sim/devices/photon_source.hpp"

#include "../fixtures/error.hpp"
#include "../sim/scenes.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/tdc/histogram.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/optics.hpp"

using namespace echofuse::sim;

namespace {

constexpr double window_s = 0.5;

struct Stream {
  std::vector<Tag> tags;
  std::vector<double> counts;  // histogram counts computed by the product code (drivers/tdc)
};

Stream draw(const Conditions& c, const Tagging& tagging, const Returns& returns,
            std::int64_t slices = 50) {
  PhotonSource source(c, tagging, window_s, 7);
  source.set_returns(returns);
  Bytes bytes;
  const auto pulses = static_cast<std::int64_t>(std::llround(source.laser_rate_hz() * window_s));
  for (std::int64_t i = 0; i < slices; ++i)
    source.draw(i * pulses / slices, (i + 1) * pulses / slices, bytes);
  Stream stream{to_values<Tag>(bytes), {}};
  tdc::HistogramSettings settings;
  settings.bins = static_cast<std::uint32_t>(c.bins);
  tdc::Histogram histogram(settings);
  histogram.add(stream.tags);
  const auto counts = histogram.take();
  stream.counts.assign(counts.begin(), counts.end());
  return stream;
}

// Returns the z-score (chi2 - n) / sqrt(2 n). Only the n bins with an expected count of at least 5
// are used.
double z_of_chi2(const std::vector<double>& counts, const std::vector<double>& expected) {
  double chi2 = 0, n = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (expected[i] < 5) continue;
    chi2 += std::pow(counts[i] - expected[i], 2) / expected[i];
    ++n;
  }
  REQUIRE(n > 10);
  return (chi2 - n) / std::sqrt(2 * n);
}

Returns person(const Conditions& c) {
  return spd_returns(make_scene(c, SceneKind::person, 3, 0), c);
}

}  // namespace

TEST_CASE("simulated photons have the expected rate in each bin, also with pile-up or a tail") {
  const auto [tail_ps, pulses] =
      GENERATE(table<double, std::int64_t>({{0, 0}, {300, 0}, {0, 60'000}}));
  CAPTURE(tail_ps, pulses);
  Conditions c;
  c.irf_tail_ps = tail_ps, c.pulses_per_window = pulses;
  if (pulses == 0) c.background_counts = 2e4;
  const Returns returns = person(c);
  const Stream stream = draw(c, {}, returns);
  const auto rate = spd_rate(returns, c);
  const auto n = static_cast<double>(pulses);
  const auto expected = pulses > 0 ? first_photons(rate, n).mean : rate;
  CHECK(std::abs(z_of_chi2(stream.counts, expected)) < 5);
  CHECK(std::abs(total(stream.counts) - total(expected)) < 5 * std::sqrt(total(expected)));
  if (pulses == 0) return;
  // With pile-up, only the first photon of each pulse is sent.
  REQUIRE(total(rate) > 0.3 * n);
  for (std::size_t i = 1; i < stream.tags.size(); ++i)
    REQUIRE(stream.tags[i].channel != stream.tags[i - 1].channel);
}

TEST_CASE("a photon stream with dead time gives the same counts as the histogram simulation") {
  Conditions c;
  c.signal_photons = 3e4;
  c.background_counts = 1e4;
  c.pulses_per_window = 20'000;
  // The dead time of 2 ns is shorter than the duration of the light signal from a person.
  c.spd_dead_time_ps = 2'000;
  const Returns returns = person(c);
  const Stream stream = draw(c, {}, returns);
  const auto rate = spd_rate(returns, c);
  Rng rng = make_rng(5, 5);
  constexpr int draws = 40;
  std::vector<double> mean(rate.size());
  for (int d = 0; d < draws; ++d) {
    const auto counts = draw_counts(rate, c, rng);
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += 1.0 * counts[i] / draws;
  }
  // Without the dead time, the counts would be very different.
  CHECK(z_of_chi2(stream.counts, rate) > 50);
  // Because of the dead time, the scatter is smaller than that of a Poisson distribution. Using a
  // mean over 40 draws increases the variance by 1/40.
  const double z = z_of_chi2(stream.counts, mean);
  CHECK(z < 5);
  std::int64_t last_ps = -1'000'000;
  for (const Tag& tag : stream.tags) {
    if (tag.channel != 2) continue;
    // Both time stamps are rounded down to picoseconds, which may reduce the dead time from 2000 ps
    // to 1999 ps.
    REQUIRE(tag.time_ps - last_ps >= 1999);
    last_ps = tag.time_ps;
  }
}

TEST_CASE(
    "simulated time tags are sorted, and with the filter on, each sync tag precedes a photon") {
  Conditions c;
  Tagging tagging;
  const Returns returns = person(c);
  const auto sorted = [](const std::vector<Tag>& tags) {
    return std::is_sorted(tags.begin(), tags.end(),
                          [](const Tag& a, const Tag& b) { return a.time_ps < b.time_ps; });
  };
  const auto tags = draw(c, tagging, returns).tags;
  REQUIRE(tags.size() > 1000);
  CHECK(sorted(tags));
  CHECK(tags.front().channel == 1);
  CHECK(tags.back().channel == 2);
  for (std::size_t i = 1; i < tags.size(); ++i)
    REQUIRE((tags[i].channel == 2 || tags[i - 1].channel == 2));
  // Without the filter, each laser pulse has a sync tag.
  tagging.conditional_filter = false;
  const auto all = draw(c, tagging, returns).tags;
  CHECK(sorted(all));
  std::int64_t syncs = 0;
  for (const Tag& tag : all)
    if (tag.channel == 1) REQUIRE(tag.time_ps == 1'000'000 * syncs++);
  CHECK(syncs == 500'000);
  CHECK(draw({}, {}, Returns{}).tags.empty());
}

TEST_CASE("the simulated tagger refuses laser and tag rates beyond its limits") {
  Conditions c;
  const auto refusal = [&](double laser_hz, double window) {
    return test::refusal_by(
        [&] { PhotonSource source(c, {.laser_rate_hz = laser_hz}, window, 1); });
  };
  CHECK(refusal(1e6, 3).empty());
  CHECK_THAT(refusal(80e6, 3),
             Catch::Contains("the next pulse is emitted before the end of the last bin"));
  CHECK_THAT(refusal(10, 3), Catch::Contains("at least 250 Hz"));
  c.signal_photons = 1e9;
  CHECK_THAT(refusal(1e6, 3), Catch::Contains("at most 5 million"));
}
