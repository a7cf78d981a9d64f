// SPDX-License-Identifier: MIT
#include "acquire/intake/sample_check.hpp"

#include <functional>

#include "../catch.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;

namespace {

struct Checked {
  std::vector<std::string> events;
  SampleCheck check{1.0, [this](Sensor, const std::string& text) { events.push_back(text); }};
};

struct Run {
  std::vector<std::string> events;
  std::uint64_t taken = 0, lost = 0;
};

// Sends 60 histograms at intervals of 50 ms, after `change`.
Run run(const std::function<void(HistogramFrame&, int)>& change) {
  Checked checked;
  Run out;
  Rng rng(3);
  for (int k = 0; k < 60; ++k) {
    HistogramFrame frame;
    frame.received = from_seconds(1 + 0.05 * k);
    frame.device_time_us = static_cast<std::uint64_t>(50'000 * k);
    frame.exposure_us = 50'000;
    for (int i = 0; i < 100; ++i) frame.counts.push_back(static_cast<std::uint32_t>(rng() % 20));
    change(frame, k);
    if (checked.check.take(frame)) ++out.taken, out.lost += frame.lost_before;
  }
  out.events = checked.events;
  return out;
}

}  // namespace

TEST_CASE("mistakes of a histogramming board are reported once") {
  std::vector<std::uint32_t> sum(100);
  const auto add = [&](HistogramFrame& frame) {
    for (std::size_t i = 0; i < sum.size(); ++i) frame.counts[i] = sum[i] += frame.counts[i];
  };
  const auto says = [](const Run& r, const std::string& text) {
    CAPTURE(r.events);
    CHECK(r.events.size() == (text.empty() ? 0 : 1));
    if (!text.empty()) CHECK_THAT(r.events.at(0), Catch::Contains(text));
  };
  says(run([](HistogramFrame&, int) {}), "");
  says(run([](HistogramFrame& f, int) { f.counts.assign(100, 0); }), "");
  says(run([](HistogramFrame& f, int k) { f.received = from_seconds(k < 30 ? 2.5 : 4.0); }), "");
  says(run([](HistogramFrame& f, int) { f.device_time_us = 0; }), "");
  says(run([&](HistogramFrame& f, int) { add(f); }), "counts fall in no bin over ten exposures");
  says(run([](HistogramFrame& f, int) { f.exposure_us = 1'000'000; }),
       "exposures add up to 20 times the time between them");
  says(run([](HistogramFrame& f, int) { f.exposure_us = 65'000; }),
       "exposures add up to 1.3 times the time between them");
  says(run([](HistogramFrame& f, int) { f.exposure_us = 50; }),
       "most exposures are shorter than 0.2 % of the time between their ends; are the exposure ");
  says(run([](HistogramFrame& f, int k) {
         f.exposure_us = 5'000'000;
         f.device_time_us = static_cast<std::uint64_t>(5'000'000 * k);
       }),
       "exposures of 5 s do not fit slots of 1 s");
  for (const std::uint32_t count : {0xffffffffu, 5'000'001u}) {
    const Run marked = run([&](HistogramFrame& f, int k) {
      if (k % 20 == 9) f.counts[30] = count;
    });
    says(marked, "bin 30 contains " + std::to_string(count) + " counts in an exposure of 0.05 s");
    CHECK(marked.taken == 57);
    CHECK(marked.lost == 3);
  }
}

TEST_CASE("power in dB, profiles of zeros and depths in metres are reported once") {
  Checked linear, db;
  for (int k = 0; k < 40; ++k) {
    RadarFrame frame{}, frame_db{};
    for (int i = 0; i < 64; ++i) {
      frame.power.push_back(i == 13 ? 1.0F : 0.01F);
      frame_db.power.push_back(10 * std::log10(frame.power.back()) + 60);
    }
    linear.check.take(frame), db.check.take(frame_db);
  }
  CHECK(linear.events.empty());
  REQUIRE(db.events.size() == 1);
  CHECK_THAT(db.events[0], Catch::Contains("are they in dB?"));
  for (int k = 0; k < 20; ++k) {
    RadarFrame zeros{};
    zeros.power.assign(64, 0);
    linear.check.take(zeros);
    CHECK(zeros.power.empty());
    DepthFrame map, millimetres;
    map.depth_mm = {0, 0, 0, 2, 3, 3}, millimetres.depth_mm = {0, 0, 0, 19, 20, 20};
    linear.check.take(map), db.check.take(millimetres);
  }
  CHECK(linear.events ==
        std::vector<std::string>{"all bins of a range profile are zero; such profiles are not used",
                                 "depth map: its median is 3 mm; expected depths in millimetres"});
  CHECK(db.events.size() == 1);
}

TEST_CASE("axes in other units and zones with the same direction are reported") {
  const Zones zones{{-0.1, 0, 0.2, 0}, {0.1, 0, 0.2, 0}, {}, {}};
  Zones alike = zones;
  alike[1] = {-0.1, 0, 0.2, 90'000};
  const std::string bins = " m; are its bins in ps?";
  const std::pair<Axis, std::vector<std::string>> rows[] = {
      {range_axis("power", 64, 0, 4.6), {}},
      {range_axis("power", 64, 0, 5),
       {"the range profile ends at 320 m; is its range step in metres?"}},
      {spd_axis(336, 13343, 100), {}},
      {spd_axis(4, 0, 100), {}},
      {spd_axis(3, 0, 100), {"the histogram ends at 0.04497" + bins}},
      {spd_axis(336, 13343, 10'000), {"the histogram ends at 505.7" + bins}},
      {tangent_axis("depth_x", 32, -2.9, 0.1), {}},
      {tangent_axis("depth_y", 32, 0.55, -0.034), {}},
      {tangent_axis("depth_x", 32, -28.8, 1.8),
       {"the field of view contains the tangent 28.8, or 88.01 degrees from the optical axis; are "
        "the tangents in degrees?"}},
      {spd_axis(336, 13343, 100, zones), {}},
      {spd_axis(336, 13343, 100, alike),
       {"several zones have the direction x = -0.1, y = 0; check the list of zones",
        "the histogram ends at -6.454 m; are its bins and zero_ps in ps?"}}};
  for (const auto& [axis, events] : rows) {
    CAPTURE(axis.name, axis.count, axis.step);
    Checked checked;
    checked.check.take(axis);
    CHECK(checked.events == events);
  }
}

TEST_CASE("a device clock that stands still or runs at another rate is reported for each sensor") {
  for (const auto& [factor, saying] : {std::pair{0.0, "stands still"},
                                       {1e-3, "runs at 1/1000 of the rate of the host clock"},
                                       {0.98, ""},
                                       {2.0, "runs at 2 times the rate of the host clock"}}) {
    Checked checked;
    for (int k = 0; k < 200; ++k) {
      const double at_s = 100 + 0.05 * k;
      HistogramFrame histogram;
      // The counts fall and rise, so that they do not look like sums.
      histogram.exposure_us = 50'000, histogram.counts.assign(10, k % 2 == 0);
      RadarFrame profile;
      DepthFrame map;
      histogram.received = profile.received = map.received = from_seconds(at_s);
      histogram.device_time_us = map.device_time_us =
          static_cast<std::uint64_t>(std::llround(1e6 * factor * at_s));
      profile.time_cpu_cycles = static_cast<std::uint32_t>(
          static_cast<std::uint64_t>(std::llround(RadarFrame::clock_hz * factor * at_s)));
      checked.check.take(histogram);
      checked.check.take(profile);
      checked.check.take(map);
    }
    CAPTURE(factor);
    const std::string text = std::string("the device clock ") + saying +
                             "; check that its times are in us. Receipt times are used instead";
    CHECK(checked.events == std::vector(*saying ? 3 : 0, text));
  }
}
