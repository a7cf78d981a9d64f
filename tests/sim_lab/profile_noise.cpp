// SPDX-License-Identifier: MIT
// Tests that the radar of the simulated laboratory has the same noise as a simulated data set.

#include "../catch.hpp"
#include "../fixtures/record.hpp"
#include "drivers/radar/log2_codes.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/devices/radar_chirp.hpp"

using namespace echofuse::sim;
using namespace echofuse::test;

namespace {

struct Moments {
  double mean = 0, deviation = 0;
};

Moments moments(const std::vector<double>& values) {
  Moments m;
  const auto n = static_cast<double>(values.size());
  for (const double v : values) m.mean += v / n;
  for (const double v : values) m.deviation += (v - m.mean) * (v - m.mean) / (n - 1);
  m.deviation = std::sqrt(m.deviation);
  return m;
}

// Returns the logarithm of the peak-to-scatter ratio. The scatter is computed from the weaker half
// of the bins.
double peak_over_scatter(std::vector<double> power) {
  std::sort(power.begin(), power.end());
  const double peak = power.back();
  power.resize(power.size() / 2 + 1);
  const Moments weaker = moments(power);
  return std::log((peak - weaker.mean) / weaker.deviation);
}

}  // namespace

TEST_CASE(
    "a radar slot of the simulated laboratory is as noisy as a record of a simulated data set") {
  const auto [frames, window_s] =
      GENERATE(std::pair<std::int64_t, double>{4, 0.2}, std::pair<std::int64_t, double>{20, 1.0},
               std::pair<std::int64_t, double>{60, 3.0});
  constexpr unsigned antennas = 12;
  Plan plan;
  plan.people = 30, plan.letters = 30;
  Conditions& c = plan.conditions;
  c.radar_psf = "blackman";
  c.radar_resolution_m = 0.2665, c.radar_bins = 64;
  c.radar_frames = frames, c.window_s = window_s;
  const Generator generator(plan);
  const RadarAxis axis = radar_response(c);
  const double mean_peak = mean_peak_power(axis, c);
  std::vector<double> of_dataset, of_lab;
  Rng rng(1);
  for (std::int64_t i = 0; i < generator.records(); ++i) {
    const auto record = power(generator.make(i));
    of_dataset.push_back(peak_over_scatter({record.begin(), record.end()}));
    // The frames of a slot are averaged in the same way as by the daemon
    // (acquire/intake/window.hpp).
    const auto echoes = radar_power(radar_returns(generator.scene(i), c), axis);
    std::vector<double> slot(echoes.size());
    for (std::int64_t f = 0; f < frames; ++f) {
      const auto codes = range_profile_codes(echoes, mean_peak, antennas, c, rng);
      for (std::size_t k = 0; k < slot.size(); ++k)
        slot[k] += radar::power_from_code(codes[k], antennas) / static_cast<double>(frames);
    }
    of_lab.push_back(peak_over_scatter(slot));
  }
  const Moments a = moments(of_dataset), b = moments(of_lab);
  const auto n = static_cast<double>(of_lab.size());
  INFO(frames << " frames: data set " << a.mean << " +- " << a.deviation << ", laboratory "
              << b.mean << " +- " << b.deviation);
  CHECK(std::abs(a.mean - b.mean) < 4.5 * std::hypot(a.deviation, b.deviation) / std::sqrt(n));
  CHECK(std::abs(std::log(a.deviation / b.deviation)) < 4.5 / std::sqrt(n));
  CHECK(std::abs(a.mean - b.mean) < 0.25);
}
