// SPDX-License-Identifier: MIT
#include "acquire/intake/signal_check.hpp"

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::acquire;
using namespace echofuse::test;
using Catch::EndsWith;
using Catch::StartsWith;

namespace {

std::vector<Axis> axes() {
  return {{"spd", "counts", "ps", 336, 13343, 100},
          {"radar", "power_with_noise", "m", 64, 0, 0.25},
          {"depth_x", "tangent", "1", 40, -0.5, 0.025},
          {"depth_y", "tangent", "1", 30, -0.4, 0.025}};
}

// Simulates records of an object 3.5 m in front of all three sensors. The simulated noise consists
// of photon, amplifier and pixel noise.
class Laboratory {
 public:
  double photons = 1e5, background = 0, radar_snr_db = 20, depth_share = 0.05;

  record::FusedRecord record() {
    record::FusedRecord r;
    r.index = next_++;
    r.slot_end = std::chrono::seconds(3);
    r.valid = SensorSet::from_bits(7);
    for (auto& sync : r.sync) sync.verdict = test::verdict_of("ok"), sync.used = 60;
    for (std::size_t i = 0; i < 336; ++i) {
      const double off = (static_cast<double>(i) - 100) / 10;
      std::poisson_distribution<std::uint32_t> n(photons / 25.07 * std::exp(-off * off / 2) +
                                                 background / 336 + 1e-12);
      counts(r).push_back(n(rng_));
    }
    r.spd_counts.in_range = std::accumulate(counts(r).begin(), counts(r).end(), std::uint64_t{0});
    std::normal_distribution<double> noise_db(0, 0.1);
    for (int i = 0; i < 64; ++i) {
      const double off = (i - 14) / 1.5;
      const double linear = 1 + std::pow(10, radar_snr_db / 10) * std::exp(-off * off);
      power(r).push_back(static_cast<float>(1e6 * linear * std::pow(10, noise_db(rng_) / 10)));
    }
    std::normal_distribution<double> depth(3500, 6);
    for (int i = 0; i < 1200; ++i)
      depth_mm(r).push_back(i < 1200 * depth_share ? static_cast<std::uint16_t>(depth(rng_)) : 0);
    return r;
  }

 private:
  std::int64_t next_ = 0;
  Rng rng_ = make_rng(11, 0);
};

using Verdicts = std::array<std::string, 3>;

// Returns the verdicts of a record. The check must not change which sensors are valid.
Verdicts verdicts(SignalCheck& check, record::FusedRecord r) {
  const SensorSet valid = r.valid;
  check.assess(r, axes());
  CHECK(r.valid == valid);
  return {verdict(r, Sensor::spd), verdict(r, Sensor::radar), verdict(r, Sensor::depth)};
}
const Verdicts all_ok{"ok", "ok", "ok"};

// Returns the verdicts of a record in which some samples of a sensor arrived and some were lost.
Verdicts with_losses(SignalCheck& check, record::FusedRecord r, Sensor sensor,
                     std::uint64_t arrived, std::uint64_t lost) {
  r.sync[sensor].arrived = r.sync[sensor].used = arrived, r.sync[sensor].lost = lost;
  return verdicts(check, r);
}

}  // namespace

TEST_CASE("a good record has the verdict ok and the measured signal values") {
  Laboratory lab;
  SignalCheck check({}, 3);
  for (int i = 0; i < 100; ++i) {
    auto r = lab.record();
    r.signal.clicks_per_pulse = 0.03;
    check.assess(r, axes());
    for (const auto& sync : r.sync) CHECK(sync.verdict.text() == "ok");
    CHECK(*r.signal.spd_clicks == Approx(1e5).epsilon(0.02));
    CHECK(*r.signal.spd_peak_m == Approx((13343 + 100 * 100.5) / ps_per_m).margin(0.1));
    CHECK(*r.signal.radar_snr_db == Approx(20).margin(1));
    CHECK(*r.signal.radar_peak_m == Approx(3.5));
    CHECK(*r.signal.depth_share == Approx(0.05));
  }
}

TEST_CASE("a laser signal that is a thousand times too weak is reported in the first record") {
  Laboratory lab;
  lab.photons = 100;
  SignalCheck check({}, 3);
  const auto v = verdicts(check, lab.record());
  CHECK_THAT(v[0], StartsWith("weak: ") && EndsWith(" clicks above the background (minimum 1000)"));
  CHECK(v[1] == "ok");
  SignalCheck indulgent({.spd_clicks = 0}, 3);
  CHECK(verdicts(indulgent, lab.record()) == all_ok);
}

TEST_CASE("a signal weaker than in the first minute has the verdict weak") {
  Laboratory lab;
  SignalCheck check({}, 3);
  for (int i = 0; i < 20; ++i) CHECK(verdicts(check, lab.record()) == all_ok);
  lab.photons = 5e3, lab.radar_snr_db = 9, lab.depth_share = 0.004;
  for (int i = 0; i < 30; ++i) {  // a weak record must not become the reference
    const auto v = verdicts(check, lab.record());
    CHECK_THAT(v[0], StartsWith("weak: light level is 0.0"));
    CHECK_THAT(v[1], StartsWith("weak: echo power is 0.0"));
    CHECK(v[2] == "weak: 0.42 % of the pixels have a return (minimum 0.5 %)");
  }
  lab = {};
  CHECK(verdicts(check, lab.record()) == all_ok);
}

TEST_CASE("neither background light alone nor radar noise alone is reported as a peak") {
  Laboratory lab;
  lab.photons = 0, lab.radar_snr_db = -40;
  for (const double background : {1.0, 300.0, 1e4, 1e6}) {
    lab.background = background;
    for (int i = 0; i < 200; ++i) {
      SignalCheck check({}, 3);
      const auto v = verdicts(check, lab.record());
      for (const std::string& text : {v[0], v[1]}) CHECK_THAT(text, StartsWith("no peak: "));
    }
  }
  record::FusedRecord far = lab.record();
  far.spd_counts = {.in_range = 100, .out_of_range = 900};
  SignalCheck checked({}, 3);
  CHECK_THAT(verdicts(checked, far)[0],
             EndsWith("90 % of the clicks are outside the histogram (2.00 to 7.04 m)"));
  far.spd_counts = {.in_range = 1, .out_of_range = 99};
  ++counts(far)[0];
  CHECK_THAT(verdicts(checked, far)[0], EndsWith("m): are the start and click channels swapped?"));
  lab.photons = 3e4, lab.radar_snr_db = 20, lab.background = 1e6;
  SignalCheck check({}, 3);
  CHECK(verdicts(check, lab.record()) == all_ok);
}

TEST_CASE("more than one click in 20 pulses or a clipped radar lobe gives the verdict saturated") {
  Laboratory lab;
  SignalCheck check({}, 3);
  constexpr float clipped = 3e7F;
  auto r = lab.record();
  r.signal.clicks_per_pulse = 0.06;
  for (float& v : power(r)) v = std::min(v, clipped);
  auto v = verdicts(check, r);
  CHECK(v[1] == "ok");  // one repeated record does not prove that the radar is frozen
  for (float& p : power(r)) p = p == clipped ? p : 1.01F * p;
  ++counts(r)[0];
  v = verdicts(check, r);
  CHECK(v[0] == "saturated: 0.06 clicks per laser pulse (limit 0.05)");
  CHECK(v[1] == "saturated: the lobe at 3.25 m is clipped");
  r.spd_counts = {.starts = 100, .in_range = 100, .out_of_range = 1900};
  ++counts(r)[0];
  CHECK_THAT(verdicts(check, r)[0], EndsWith("): are the start and click channels swapped?"));
  r.sync[Sensor::radar].used = 1;  // with a single frame, two bins may have equal powers
  for (float& p : power(r)) p = p == clipped ? p : 0.98F * p;
  CHECK(verdicts(check, r)[1] == "ok");
  SignalCheck indulgent({.clicks_per_pulse = 0}, 3);
  CHECK(verdicts(indulgent, r)[0] == "ok");
}

TEST_CASE("sensor data that repeat bit for bit are reported as frozen (verdict: stands still)") {
  Laboratory lab;
  SignalCheck check({}, 3);
  auto r = lab.record();
  CHECK(verdicts(check, r) == all_ok);
  // Simulates the rounding error that results from averaging a different number of frames.
  for (float& v : power(r)) v *= 1.000001F;
  for (const auto& v : verdicts(check, r)) CHECK_THAT(v, StartsWith("stands still: "));
  CHECK(verdicts(check, lab.record()) == all_ok);
  // Data that repeat after a missing record are reported as frozen. Sensors without a signal are
  // not reported as frozen.
  auto gone = lab.record();
  const auto kept = gone;
  CHECK(verdicts(check, gone) == all_ok);
  gone.valid = SensorSet::from_bits(0);
  for (auto& sync : gone.sync) sync.verdict = test::verdict_of("no frames");
  CHECK(verdicts(check, gone) == Verdicts{"no frames", "no frames", "no frames"});
  CHECK_THAT(verdicts(check, kept)[2], StartsWith("stands still: "));
  lab.photons = 0, lab.depth_share = 0;
  SignalCheck dark({}, 3);
  for (int i = 0; i < 3; ++i) {
    const auto v = verdicts(dark, lab.record());
    CHECK_THAT(v[0], StartsWith("no peak"));
    CHECK_THAT(v[2], StartsWith("weak: 0.00 % of the pixels"));
  }
}

TEST_CASE("a record with less than 80 % of the expected frames or pulses has the verdict lossy") {
  Laboratory lab;
  SignalCheck check({}, 3, {1000, 20, 0});
  const auto with = [&](std::uint64_t starts, std::uint64_t radar, std::uint64_t depth) {
    auto r = lab.record();
    r.spd_counts = {.tags = starts + 100, .starts = starts, .in_range = 100};
    r.sync[Sensor::spd].arrived = starts + 100;
    r.sync[Sensor::radar].used = r.sync[Sensor::radar].arrived = radar;
    r.sync[Sensor::depth].arrived = depth;
    r.sync[Sensor::depth].lost = depth < 90 ? 90 - depth : 0;
    return verdicts(check, r);
  };
  for (int i = 0; i < 6; ++i) CHECK(with(3000, 60, 90) == all_ok);
  CHECK(with(2400, 48, 72) == all_ok);
  CHECK(with(2100, 47, 45) == Verdicts{"lossy: 70 % of the 3000 expected start pulses received",
                                       "lossy: 78 % of the 60 expected frames received",
                                       "lossy: 50 % of the 90 frames received"});
  check = SignalCheck({.lossy_share = 0}, 3, {1000, 20, 30});
  CHECK(with(300, 3, 3) == all_ok);
}

TEST_CASE("a slot that is cut short by the end of a recording is checked up to that end") {
  Laboratory lab;
  SignalCheck check({}, 3, {0, 20, 0});
  for (const auto& [end_s, verdict] : {std::pair{0.4, "ok"},
                                       {1.0, "lossy: 40 % of the 20 expected frames received"},
                                       {9.0, "lossy: 13 % of the 60 expected frames received"}}) {
    auto r = lab.record();
    r.sync[Sensor::radar].used = 8;
    check.assess(r, axes(), {std::nullopt, from_seconds(end_s), std::nullopt});
    CHECK(r.sync[Sensor::radar].verdict.text() == verdict);
  }
}

TEST_CASE("frames that arrive in a neighbouring short slot are not counted as lost") {
  Laboratory lab;
  SignalCheck check({}, 0.1, {0, 20, 30});
  auto r = lab.record();
  r.slot_end = std::chrono::milliseconds(100);
  r.sync[Sensor::radar].used = 1;
  r.sync[Sensor::depth].arrived = 2;
  CHECK(verdicts(check, r) == all_ok);
}

TEST_CASE("missing start pulses are not reported if the tagger uses a conditional filter") {
  Laboratory lab;
  SignalCheck check({}, 3, {1e6, 0, 0});
  auto r = lab.record();
  r.spd_counts = {.tags = 20'000, .starts = 10'000, .in_range = 10'000};
  r.signal.clicks_per_pulse = 0.01;
  CHECK(verdicts(check, r)[0] == "ok");
  r = lab.record();  // a filter does not pass two starts per click
  r.spd_counts = {.tags = 30'000, .starts = 20'000, .in_range = 10'000};
  r.signal.clicks_per_pulse = 0.01;
  CHECK(verdicts(check, r)[0] == "lossy: 1 % of the 3000000 expected start pulses received");
  // All clicks are dark counts. The tagger's filter passed one start per click, so 10 000 starts
  // remain of 3e6 laser pulses.
  r = lab.record();
  r.spd_counts = {.tags = 20'000, .starts = 10'000, .in_range = 10'000};
  r.signal.clicks_per_pulse = 1;
  check = SignalCheck({.clicks_per_pulse = 0}, 3, {1e6, 0, 0});
  CHECK(verdicts(check, r)[0] == "lossy: 0 % of the 3000000 expected start pulses received");
}

TEST_CASE("a sensor is lossy if 60 % of its samples are lost, also behind a conditional filter") {
  Laboratory lab;
  for (const bool filtered : {false, true})
    for (const auto& [sensor, received, lost, words] :
         {std::tuple(Sensor::spd, 4000U, 6000U, "lossy: 40 % of the 10000 tags received"),
          {Sensor::radar, 24U, 36U, "lossy: 40 % of the 60 frames received"},
          {Sensor::depth, 36U, 54U, "lossy: 40 % of the 90 frames received"}}) {
      SignalCheck check({}, 3, {filtered ? 4e6 : 0, 0, 0});
      const auto record = [&] {
        auto r = lab.record();
        if (filtered) r.signal.clicks_per_pulse = 0.01;
        r.spd_counts = {.tags = 4000, .starts = 2000, .in_range = 2000};
        return r;
      };
      const auto v = with_losses(check, record(), sensor, received, lost);
      CHECK(v[static_cast<std::size_t>(sensor)] == words);
      CHECK(with_losses(check, record(), sensor, received, received / 4) == all_ok);
    }
  SignalCheck check({}, 3);
  auto r = lab.record();  // a detector that sends histograms: 16 of 40 exposures arrived
  r.spd_counts = {.tags = 9000, .starts = 8000, .in_range = 1000};
  CHECK(with_losses(check, r, Sensor::spd, 16, 24)[0] ==
        "lossy: 40 % of the 40 histograms received");
  // Losses take precedence over a missing peak, which is named, too.
  std::ranges::fill(counts(r), 100U);
  CHECK(with_losses(check, r, Sensor::spd, 16, 24)[0] ==
        "lossy: 40 % of the 40 histograms received; also no peak: no bins clearly exceed the mean");
}

TEST_CASE("depths beyond the range of the depth map do not count as returns") {
  Laboratory lab;
  SignalCheck check({}, 3, {}, 6);
  auto r = lab.record();
  for (auto& z : depth_mm(r)) z = z == 0 ? 40'000 : z;
  check.assess(r, axes());
  CHECK(*r.signal.depth_share == Approx(0.05));
}

TEST_CASE("radar leakage is no echo, and a verdict needs three range bins beyond it") {
  SignalCheck check({}, 3);
  for (const auto& [bins, expected] :
       {std::pair{128u, "no peak: 0.4 dB above the median bin"},
        {15u, "no peak: -59.6 dB above the median bin"},
        {14u, "not assessed: only 2 range bins beyond the leakage below 0.5 m (minimum 3)"}}) {
    record::FusedRecord r;
    r.valid = {Sensor::radar};
    for (unsigned i = 0; i < bins; ++i) power(r).push_back(i < 10 ? 1e6F : i % 3 == 0 ? 1.1F : 1);
    check.assess(r, std::vector{range_axis("power", bins, 0, 0.044)});
    CHECK_THAT(verdict(r, Sensor::radar), StartsWith(expected));
  }
  CHECK_FALSE(test::verdict_of("not assessed").row().doubtful);
}

TEST_CASE("the signal of each detector zone is checked separately") {
  SignalCheck check({.clicks_per_pulse = 0.05}, 3);
  record::FusedRecord r;
  r.valid = {Sensor::spd};
  const auto assessed = [&](double clicks_per_pulse) {
    r.signal.clicks_per_pulse = clicks_per_pulse;
    set_verdict(r, Sensor::spd, "ok");
    check.assess(r, std::vector{spd_axis(40, 0, 100)});
    return verdict(r, Sensor::spd);
  };
  counts(r).assign(80, 0);
  std::fill_n(counts(r).begin(), 40, 1000);  // only the first zone has a background
  counts(r)[40 + 12] = 5000;
  CHECK(assessed(0.04) == "ok");
  CHECK(*r.signal.spd_clicks == 5000);
  // The first zone is the brighter one, with 40/70 of all clicks.
  counts(r)[40 + 12] = 30'000;
  CHECK(assessed(0.1) ==
        "saturated: 0.0571 clicks per laser pulse in the brightest zone (limit 0.05)");
  std::fill(counts(r).begin(), counts(r).end(), 3);
  CHECK(assessed(0.01) == "no peak: no bins clearly exceed the mean");
}
