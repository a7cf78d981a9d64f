// SPDX-License-Identifier: MIT
#include "acquire/intake/clock_fit.hpp"

#include "../catch.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

constexpr HostTime host_start = 5000s;

// Device clock that reads `offset_s` at host_start and runs fast by the fraction `drift`.
struct Device {
  double tick_s, offset_s, drift;
  std::uint64_t mask = ~0ull;

  std::uint64_t ticks(double t) const {
    return (static_cast<std::uint64_t>(std::llround(offset_s / tick_s)) +
            static_cast<std::uint64_t>(std::llround(t * (1 + drift) / tick_s))) &
           mask;
  }
};

HostTime host(double t) { return host_start + from_seconds(t); }

double error_s(const ClockFit& fit, const Device& device, double t, HostTime received) {
  return std::abs(seconds(fit.taken(device.ticks(t), received) - host(t)));
}

// Feeds 90 s of samples to the fit. Most samples are read up to 50 ms late, one in twenty up to 550
// ms late. A late sample also delays the samples after it. Checks the errors of the fit after the
// first 30 s.
void watch(ClockFit fit, const Device& device, double rate_hz, std::uint64_t seed) {
  Rng rng = make_rng(seed, 7);
  std::uniform_real_distribution<double> uniform(0, 1);
  HostTime last{};
  double worst_s = 0, t = 0;
  for (; t < 90; t += (0.5 + uniform(rng)) / rate_hz) {
    const double delay = 0.05 * uniform(rng) + (rng() % 20 == 0 ? 0.5 * uniform(rng) : 0);
    last = std::max(last, host(t + delay));
    fit.add(device.ticks(t), last);
    if (t >= 30) worst_s = std::max(worst_s, error_s(fit, device, t, last));
  }
  const auto state = fit.state(host(t)).value();
  CHECK(fit.sound());
  CHECK(worst_s < std::min(0.005, state.residual_s));
  CHECK(std::abs(state.drift_ppm - 1e6 * device.drift) < 100);
}

// Feeds `count` samples at 10 per second to the fit, starting at time t. Each sample is read 1 ms
// late.
double feed(ClockFit& fit, const Device& device, double t, int count) {
  for (int i = 0; i < count; ++i, t += 0.1) fit.add(device.ticks(t), host(t + 0.001));
  return t;
}

}  // namespace

TEST_CASE("the clock fit is accurate to 5 ms despite an offset, a drift and random delays") {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    CAPTURE(seed);
    const double offset_s = -0.5 + static_cast<double>(seed) / 299;
    const double drift = seed % 2 ? 200e-6 : -200e-6;
    // The sample rates correspond to 10 radar frames, 30 camera frames or 20 blocks of time tags
    // (at a weak signal) per second.
    watch(ClockFit(5e-9, 32), {5e-9, offset_s, drift, 0xffff'ffff}, 10, seed);
    watch(ClockFit(1e-6), {1e-6, 1000 + offset_s, drift}, 30, seed);
    watch(ClockFit(1e-12), {1e-12, offset_s, drift}, 20, seed);
  }
}

TEST_CASE("with small transfer delays, the clock fit is as accurate as the receipt times") {
  const Device device{1e-6, -0.5, 200e-6};
  ClockFit fit(1e-6);
  Rng rng = make_rng(1, 0);
  double worst_s = 0;
  for (double t = 0; t < 200; t += 0.03) {
    const HostTime received = host(t + 1e-4 * static_cast<double>(rng() % 100) / 100);
    fit.add(device.ticks(t), received);
    if (t > 40) worst_s = std::max(worst_s, error_s(fit, device, t, received));
  }
  CHECK(worst_s < 20e-6);
  const auto state = fit.state(host(200)).value();
  CHECK(std::abs(state.drift_ppm - 200) < 1);
  CHECK(std::abs(state.offset_s - (seconds(host_start) + 0.5 - 200 * 200e-6)) < 50e-6);
  CHECK(state.residual_s < 20e-6);
  // The fit uses the samples of the last 128 s, which are about 4270 samples at intervals of 30 ms.
  CHECK((state.samples > 4000 && state.samples < 4400));
}

TEST_CASE("a sample is assigned its receive time until the clock fit is valid") {
  const Device device{1e-6, 3, 0};
  ClockFit fit(1e-6);
  CHECK_FALSE(fit.sound());
  CHECK(fit.taken(7, host(1)) == host(1));
  feed(fit, device, 0, 31);
  CHECK(fit.taken(device.ticks(1), host(9)) == host(9));
  CHECK_FALSE(fit.state(host(9)));
  feed(fit, device, 3.1, 1);
  CHECK(fit.sound());
  // Each sample was read 1 ms late. The fit includes this constant transport delay.
  CHECK(fit.taken(device.ticks(1), host(9)) == host(1.001));
  // a fitted sample time is never later than the arrival time
  CHECK(fit.taken(device.ticks(4), host(3.9)) == host(3.9));
}

TEST_CASE("the clock fit unwraps device counters that overflow") {
  SECTION("a 32-bit radar counter that wraps every 21.47 s is unwrapped despite gaps of 4 s") {
    const Device device{5e-9, 20, -150e-6, 0xffff'ffff};
    ClockFit fit(5e-9, 32);
    double t = 0;
    for (int i = 0; i < 40; ++i) t = feed(fit, device, t + 4, 20);
    CHECK(error_s(fit, device, t - 0.5, host(t)) < 0.0015);
    CHECK(std::abs(fit.state(host(t))->drift_ppm + 150) < 2);
  }
  SECTION("a 64-bit tagger counter is unwrapped after 2^63 ps") {
    const Device device{1e-12, 9'223'371.0, 0};  // the counter exceeds 2^63 ps after 1.04 s
    ClockFit fit(1e-12);
    const double t = feed(fit, device, 0, 100);
    CHECK(static_cast<std::int64_t>(device.ticks(t)) < 0);
    CHECK(error_s(fit, device, t - 0.5, host(t)) < 0.0011);
  }
}

TEST_CASE("damaged time stamps do not affect the clock fit") {
  const Device device{1e-12, 100, 0};
  ClockFit fit(1e-12);
  double t = feed(fit, device, 0, 100);
  Rng rng = make_rng(5, 0);
  for (int i = 0; i < 200; ++i) {
    const std::uint64_t wrong = rng();
    fit.add(wrong, host(t));
    // The arrival time is used instead of the corrupted time stamp.
    CHECK(fit.taken(wrong, host(t)) == host(t));
    t = feed(fit, device, t, 2);
    REQUIRE(error_s(fit, device, t - 0.1, host(t)) < 0.0011);
  }
}

TEST_CASE("the clock fit detects a restarted device clock and follows it") {
  const Device before{1e-6, 1000, 100e-6};
  ClockFit fit(1e-6);
  double t = feed(fit, before, 0, 600);
  // Each row contains the step of the clock, and the samples and the gap before the clock is used:
  // a restart at zero, a step forward, a backward step below the detection limit, and a backward
  // step during a gap in the samples.
  const auto [step_s, samples, gap_s] = GENERATE(
      table<double, int, double>({{-1060, 0, 0}, {30, 0, 0}, {-0.7, 35, 0}, {-0.4, 0, 11}}));
  CAPTURE(step_s);
  Device after = before;
  after.offset_s += step_s;
  t = feed(fit, after, t, samples) + gap_s;
  t = feed(fit, after, t, 100);
  CHECK(fit.sound());
  CHECK(fit.state(host(t))->samples < static_cast<unsigned>(105 + samples));
  CHECK(error_s(fit, after, t - 1, host(t)) < 0.0011);
}

TEST_CASE("a stalled program or a drained queue is not mistaken for a clock restart") {
  const Device device{1e-6, 1, 0};
  ClockFit fit(1e-6);
  double t = feed(fit, device, 0, 100);
  const double woken = t + 8;
  for (; t < woken; t += 0.01) fit.add(device.ticks(t), host(woken));
  t = feed(fit, device, t, 100);
  CHECK(fit.state(host(t))->samples == 1000);
  CHECK(error_s(fit, device, t - 1, host(t)) < 0.0011);
}

TEST_CASE("the transport delay of a tag block is measured from the last event in the block") {
  SensorClocks clocks;
  Tag no_event;
  no_event.type = TagType::overflow_end;
  for (int i = 0; i < 120; ++i) {
    const std::int64_t ps = 5'000'000'000 * i;  // one block every 5 ms
    const std::vector<Tag> tags = {
        {.channel = 1, .time_ps = ps}, {.channel = 2, .time_ps = ps + 4'000'000'000}, no_event};
    clocks.observe(TagBlock{.received = host(0.005 * i + 0.0045), .tags = tags});
  }
  REQUIRE(clocks[Sensor::spd].sound());
  const auto taken = clocks[Sensor::spd].taken(495'000'000'000, host(1));
  // Each block arrives 0.5 ms after its last event, so the fit adds 0.5 ms to the time of each tag.
  CHECK(std::abs(seconds(taken - host(0.4955))) < 1e-6);
}
