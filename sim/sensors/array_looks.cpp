// SPDX-License-Identifier: MIT
#include <array>
#include <cmath>
#include <random>

#include "sim/sensors/gaussian.hpp"
#include "sim/sensors/radar_array.hpp"

namespace echofuse::sim {

using record::Antennas;

Antennas antennas_in_layout(std::size_t count) {
  Antennas antennas(count);
  if (count <= 8) {
    for (std::size_t m = 0; m < count; ++m) antennas[m].x = static_cast<double>(m);
    return antennas;
  }
  constexpr std::array<std::array<double, 2>, 3> transmitters{{{0, 0}, {2, 2}, {0, 2}}};
  constexpr std::array<std::array<double, 2>, 4> receivers{{{1, 1}, {1, 0}, {0, 1}, {0, 0}}};
  for (std::size_t m = 0; m < count; ++m) {
    const auto &t = transmitters[m / 4 % 3], &r = receivers[m % 4];
    antennas[m].x = t[0] + r[0];
    antennas[m].y = t[1] + r[1];
  }
  return antennas;
}

Antennas simulated_antennas(const Conditions& c, std::uint64_t seed) {
  Antennas antennas = antennas_in_layout(static_cast<std::size_t>(c.radar_antennas));
  Rng rng = make_rng(seed, 0);
  std::normal_distribution<double> unit;
  for (auto& a : antennas) {
    a.phase_rad = c.radar_phase_error_rad * unit(rng);
    a.gain = std::pow(10, c.radar_gain_error_db * unit(rng) / 20);
  }
  return antennas;
}

Antennas stated_antennas(const Antennas& antennas, const Conditions& c) {
  return c.radar_array_calibrated ? antennas : antennas_in_layout(antennas.size());
}

ArrayLooks look_through_array(const Returns& returns, const RadarAxis& axis, std::size_t kept_bins,
                              const Antennas& antennas, const Conditions& c, double noise_power,
                              std::uint64_t still_seed, Rng& rng) {
  ArrayEcho echo(returns, axis, antennas, c, still_seed, rng);
  record::ArrayStatistics sums(kept_bins, antennas.size());
  std::vector<std::complex<float>> samples(echo.samples());
  auto* parts = reinterpret_cast<float*>(samples.data());
  const auto rms = static_cast<float>(std::sqrt(noise_power / 2));
  const double later_s = dataset_window_s / static_cast<double>(c.radar_frames);
  ArrayLooks looks;
  looks.power.resize(axis.count);
  for (std::int64_t f = 0; f < c.radar_frames; ++f) {
    echo.frame(later_s, rng, samples);
    add_gaussian({parts, 2 * samples.size()}, rms, rng);
    sums.add({samples.data(), kept_bins * antennas.size()});
    for (std::size_t i = 0; i < axis.count; ++i)
      for (std::size_t m = 0; m < antennas.size(); ++m)
        looks.power[i] += std::norm(samples[i * antennas.size() + m]);
  }
  const auto count = static_cast<double>(c.radar_frames) * static_cast<double>(antennas.size());
  for (double& power : looks.power) power /= count;
  looks.array = sums.take();
  return looks;
}

}  // namespace echofuse::sim
