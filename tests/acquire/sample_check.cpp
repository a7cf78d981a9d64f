// SPDX-License-Identifier: MIT
#include "acquire/intake/sample_check.hpp"

#include <functional>

#include "../catch.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;

namespace {

struct Run {
  std::vector<std::string> events;
  std::uint64_t taken = 0, lost = 0;
};

// Sends 60 histograms at intervals of 50 ms, after `change`.
Run run(const std::function<void(HistogramFrame&, int)>& change) {
  Run out;
  SampleCheck check(1.0, [&](Sensor, const std::string& text) { out.events.push_back(text); });
  Rng rng(3);
  for (int k = 0; k < 60; ++k) {
    HistogramFrame frame;
    frame.received = from_seconds(1 + 0.05 * k);
    frame.device_time_us = static_cast<std::uint64_t>(50'000 * k);
    frame.exposure_us = 50'000;
    for (int i = 0; i < 100; ++i) frame.counts.push_back(static_cast<std::uint32_t>(rng() % 20));
    change(frame, k);
    if (!check.take(frame)) continue;
    ++out.taken;
    out.lost += frame.lost_before;
  }
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

TEST_CASE("power in dB, ranges in other units and depths in metres are reported once") {
  std::vector<std::string> events;
  SampleCheck check(1.0, [&](Sensor, const std::string& text) { events.push_back(text); });
  RadarFrame linear{}, db{};
  for (int i = 0; i < 64; ++i) {
    linear.power.push_back(i == 13 ? 1.0F : 0.01F);
    db.power.push_back(10 * std::log10(linear.power.back()) + 60);
  }
  SampleCheck other = check;
  for (int k = 0; k < 40; ++k) check.take(linear);
  CHECK(events.empty());
  for (int k = 0; k < 40; ++k) other.take(db);
  REQUIRE(events.size() == 1);
  CHECK_THAT(events[0], Catch::Contains("are they in dB?"));
  RadarFrame zeros{};
  zeros.power.assign(64, 0);
  for (int k = 0; k < 3; ++k) {
    RadarFrame frame = zeros;
    check.take(frame);
    CHECK(frame.power.empty());
  }
  REQUIRE(events.size() == 2);
  CHECK(events[1] == "all bins of a range profile are zero; such profiles are not used");
  events.pop_back();
  check.take(Axis{"radar", "power", "m", 64, 0, 0.25, 1});
  CHECK(events.size() == 1);
  SampleCheck other_axes = check;
  check.take(Axis{"radar", "power", "m", 64, 0, 25, 1});
  CHECK(events.at(1) == "the range profile ends at 1600 m; is its range step in metres?");
  events.clear();
  other_axes.take(Axis{"spd", "counts", "ps", 336, 13343, 100, 1});
  other_axes.take(Axis{"depth_x", "tangent", "1", 32, -0.55, 0.034, 1});
  other_axes.take(Axis{"depth_y", "tangent", "1", 32, 0.55, -0.034, 1});
  CHECK(events.empty());
  other_axes.take(Axis{"depth_x", "tangent", "1", 32, -28.8, 1.8, 1});
  CHECK(events.at(0) ==
        "the field of view contains the tangent 28.8, or 88.01 degrees from the optical axis; are "
        "the tangents in degrees?");
  other_axes.take(Axis{"spd", "counts", "ps", 336, 13.343, 0.1, 1});
  CHECK(events.at(1) == "the histogram ends at 0.007037 m; are its bins in ps?");
  Axis zones{"spd", "counts", "ps", 336, 13343, 100, 1};
  zones.zones = {{-0.1, 0, 0.2, 0}, {0.1, 0, 0.2, 0}, {}, {}};
  other_axes.take(zones);
  CHECK(events.size() == 2);
  zones.zones[1] = {-0.1, 0, 0.2, 90'000};
  SampleCheck late_zero = check;
  late_zero.take(zones);
  CHECK(events.at(2) ==
        "several zones have the direction x = -0.1, y = 0; check the list of zones");
  CHECK(events.at(3) == "the histogram ends at -6.454 m; are its bins and zero_ps in ps?");
  events.assign(2, "");
  DepthFrame map;
  map.depth_mm = {0, 0, 0, 2, 3, 3};
  for (int k = 0; k < 20; ++k) check.take(map);
  CHECK(events.size() == 3);
  CHECK(events.at(2) == "depth map: its median is 3 mm; expected depths in millimetres");
}

TEST_CASE("a device clock that stands still or runs at another rate is reported for each sensor") {
  for (const auto& [factor, saying] : {std::pair{0.0, "stands still"},
                                       {1e-3, "runs at 1/1000 of the rate of the host clock"},
                                       {0.98, ""},
                                       {2.0, "runs at 2 times the rate of the host clock"}}) {
    PerSensor<std::vector<std::string>> events;
    SampleCheck check(1.0, [&](Sensor s, const std::string& text) { events[s].push_back(text); });
    Rng rng(3);
    for (int k = 0; k < 200; ++k) {
      const double at_s = 100 + 0.05 * k;
      HistogramFrame histogram;
      RadarFrame profile;
      DepthFrame map;
      for (auto* frame : {&histogram.received, &profile.received, &map.received})
        *frame = from_seconds(at_s);
      histogram.exposure_us = 50'000;
      for (int i = 0; i < 100; ++i)
        histogram.counts.push_back(static_cast<std::uint32_t>(rng() % 20));
      histogram.device_time_us = map.device_time_us =
          static_cast<std::uint64_t>(std::llround(1e6 * factor * at_s));
      profile.time_cpu_cycles = static_cast<std::uint32_t>(
          static_cast<std::uint64_t>(std::llround(RadarFrame::clock_hz * factor * at_s)));
      check.take(histogram);
      check.take(profile);
      check.take(map);
    }
    CAPTURE(factor);
    for (const auto& reported : events) {
      CHECK(reported.size() == (*saying ? 1 : 0));
      if (*saying)
        CHECK(reported.at(0) == std::string("the device clock ") + saying +
                                    "; check that its times are in us. Receipt times are used "
                                    "instead");
    }
  }
}
