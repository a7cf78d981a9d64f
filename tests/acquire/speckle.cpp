// SPDX-License-Identifier: MIT
// How the radar's power varies within a slot, and the mean over subframes.
#include "acquire/measurement/speckle.hpp"

#include <cmath>
#include <random>

#include "acquire/record/run_file.hpp"
#include "acquire/run/window.hpp"
#include "drivers/core/log2_codes.hpp"
#include "drivers/core/random.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace testing;
using namespace std::chrono_literals;
using record::SpeckleStatistics;

TEST_CASE("speckle: exponential powers vary by 1 over carriers, by 1 / N over frames of N") {
  Rng rng(3);
  std::exponential_distribution<float> power(2);
  for (const std::size_t carriers : {std::size_t{1}, std::size_t{4}}) {
    SpeckleStatistics statistics(carriers);
    for (std::uint64_t frame = 0; frame < 300; ++frame)
      for (std::size_t k = 0; k < carriers; ++k) {
        std::vector<float> profile(40);
        for (float& p : profile) p = power(rng);
        statistics.add(frame, k, 0.05 * static_cast<double>(frame), profile);
      }
    const auto found = statistics.take();
    REQUIRE(found);
    CHECK(found->over_frames == Approx(1 / static_cast<double>(carriers)).epsilon(0.06));
    CHECK(found->over_carriers.has_value() == (carriers > 1));
    if (carriers > 1) CHECK(*found->over_carriers == Approx(1).epsilon(0.06));
  }
}

TEST_CASE("speckle: by hand, without frames that lack a carrier") {
  SpeckleStatistics statistics(2);
  CHECK_FALSE(statistics.take());
  const auto add = [&](std::uint64_t frame, std::size_t carrier, float power) {
    statistics.add(frame, carrier, 0, std::vector<float>{power, 0});
  };
  add(1, 0, 1), add(1, 1, 3);  // mean 2, variance 2
  add(2, 0, 100);              // its other one was lost
  add(3, 1, 4), add(3, 0, 4);  // mean 4, variance 0
  const auto found = statistics.take();
  REQUIRE(found);
  CHECK(found->over_frames == Approx(2.0 / 9));     // 2 over 3^2
  CHECK(*found->over_carriers == Approx(1.0 / 9));  // the mean of 2 and 0
  SpeckleStatistics dark;
  for (std::uint64_t frame = 0; frame < 3; ++frame) dark.add(frame, 0, 0, std::vector<float>{0, 0});
  CHECK_FALSE(dark.take());
}

namespace {

// Power of mean 2 that varies as cos(2 pi t / period_s), and noise.
std::optional<double> within_150_ms(double period_s, double frame_s, float noise, int frames,
                                    bool loses = false) {
  Rng rng(5);
  std::normal_distribution<float> unit(0, 1);
  SpeckleStatistics statistics;
  for (int i = 0; i < frames; ++i) {
    if (loses && i % 7 == 3) continue;
    const double time_s = 7 + i * frame_s;
    const auto power = static_cast<float>(2 + std::cos(2 * M_PI * time_s / period_s));
    statistics.add(static_cast<std::uint64_t>(i), 0, time_s,
                   std::vector{power + noise * unit(rng)});
  }
  const auto found = statistics.take();
  return found ? found->over_150_ms : std::nullopt;
}

// Half the mean squared difference of a cosine, over the squared mean of the power.
double of_cosine(double period_s, double lag_s) {
  return (1 - std::cos(2 * M_PI * lag_s / period_s)) / 2 / 4;
}

}  // namespace

TEST_CASE("speckle: frames 150 ms apart, whatever the frame rate, and noise adds its variance") {
  for (const double frame_s : {0.05, 0.0125})
    for (const double period_s : {0.5, 2.0, 10.0}) {
      CAPTURE(frame_s, period_s);
      const double expected = of_cosine(period_s, 0.15);
      CHECK(within_150_ms(period_s, frame_s, 0, 4000).value() == Approx(expected).epsilon(0.01));
      CHECK(within_150_ms(period_s, frame_s, 0.3f, 4000).value() ==
            Approx(expected + 0.3 * 0.3 / 4).epsilon(0.05));
    }
  // Slow radars' frames, and frames after a loss, are a little farther apart.
  CHECK(within_150_ms(2, 0.1, 0, 1000).value() == Approx(of_cosine(2, 0.2)).epsilon(0.01));
  const double lossy = within_150_ms(2, 0.05, 0, 1000, true).value();
  CHECK((lossy > of_cosine(2, 0.15) && lossy < of_cosine(2, 0.2)));
  for (const double frame_s : {0.0, 0.3, -0.05}) CHECK_FALSE(within_150_ms(1, frame_s, 0, 50));
  CHECK_FALSE(within_150_ms(1, 0.05, 0, 3));
}

namespace {

constexpr SlotGrid grid{.first = 10s, .length = 1s};
const SensorClocks no_clocks;

RadarFrame subframe_of(std::uint32_t number, std::uint32_t subframe, std::uint16_t code) {
  RadarFrame frame;
  frame.received = 10s + number * 50ms + subframe * 12ms;
  frame.frame_number = number;
  frame.time_cpu_cycles = number * 10'000'000 + subframe * 2'400'000;
  frame.subframe = subframe, frame.subframes = 4;
  frame.range_profile = {code, 0};
  return frame;
}

}  // namespace

TEST_CASE("a record's profile is the mean power over frames and their subframes") {
  const Axis axis{"radar", "log2_q8", "m", 2, 0, 0.25, 12};
  Windows windows(grid, {}, no_clocks, {Sensor::radar});
  DeviceInfo info;
  info.sensor = Sensor::radar, info.axes = {axis};
  REQUIRE(windows.announce(info));
  double sum = 0, count = 0;
  SpeckleStatistics expected(4);
  for (std::uint32_t frame = 1; frame <= 5; ++frame)
    for (std::uint32_t k = 0; k < 4; ++k) {
      const auto code = static_cast<std::uint16_t>(3000 + 40 * k + 17 * frame * (k + 1));
      const RadarFrame one = subframe_of(frame, k, code);
      windows.add(one);
      windows.add(one);  // a frame that comes twice counts once
      const double power = power_from_code(code, axis.scale);
      sum += power, ++count;
      expected.add(frame, k, seconds(one.received), std::vector{static_cast<float>(power), 1.f});
    }
  const auto r = windows.close({0, false});
  REQUIRE(r.has(Sensor::radar));
  CHECK(r.sync[Sensor::radar].used == 20);
  CHECK(r.sync[Sensor::radar].lost == 0);
  CHECK(power_from_code(r.radar[0], axis.scale) == Approx(sum / count).epsilon(1e-4));
  REQUIRE(r.speckle);
  CHECK(r.speckle->over_frames == Approx(expected.take()->over_frames).epsilon(1e-6));
  CHECK(*r.speckle->over_carriers == Approx(*expected.take()->over_carriers).epsilon(1e-6));
}

TEST_CASE("a run keeps how the power varied") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  {
    record::RunWriter writer(path, {});
    writer.put_axis({"radar", "power", "m", 2, 0, 0.25});
    for (std::int64_t i = 0; i < 3; ++i) {
      record::FusedRecord r;
      r.index = i;
      r.valid.insert(Sensor::radar);
      r.radar = {1, 2};
      if (i == 1) r.speckle = record::Speckle{0.5, {}};
      if (i == 2) r.speckle = record::Speckle{0.25, 0.75, 0.125};
      writer.append(r);
    }
    writer.close("complete");
  }
  const record::RunReader run(path);
  CHECK_FALSE(run.read(0).speckle);
  CHECK(run.read(1).speckle == record::Speckle{0.5, {}});
  CHECK(run.read(2).speckle == record::Speckle{0.25, 0.75, 0.125});
}
