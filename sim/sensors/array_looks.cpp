// SPDX-License-Identifier: MIT
#include <algorithm>
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

std::vector<double> antenna_drift(const Conditions& c, std::size_t antennas, std::uint64_t seed,
                                  double time_s) {
  if (c.radar_warming_k == 0) return {};
  const double kelvin = c.radar_warming_k * -std::expm1(-time_s / c.radar_warming_s);
  Rng rng = make_rng(seed, 1);  // 0: simulated_antennas
  std::normal_distribution<double> unit;
  std::vector<double> phases(antennas);
  for (double& phase : phases)
    phase = kelvin * (c.radar_drift_common_rad_k + c.radar_drift_rad_k * unit(rng));
  return phases;
}

namespace {

// Sum over the antennas of each of the bins, of planes.
void put_powers(std::span<const float> re, std::span<const float> im, std::size_t bins,
                std::span<float> out) {
  for (std::size_t at = 0; at < re.size(); at += lanes)
    for (std::size_t i = 0; i < bins; ++i)
      out[i] += re[at + i] * re[at + i] + im[at + i] * im[at + i];
}

}  // namespace

ArrayLooks look_through_array(const Returns& returns, const ArrayRadar& radar,
                              std::size_t kept_bins, const Conditions& c, double noise_power,
                              Rng& rng, std::span<const double> drift) {
  const std::size_t antennas = radar.antennas.size(), points = radar.axis.count;
  const std::size_t carriers = radar.carriers_hz.size();
  const std::size_t frames = static_cast<std::size_t>(c.radar_frames) * carriers;
  const double later_s = dataset_window_s / static_cast<double>(frames);
  const auto rms = static_cast<float>(std::sqrt(noise_power / 2));
  ArrayEcho echo(returns, radar, c, rng);
  echo.set_drift(drift);
  // Fresh memory takes the kernel as long as the half of this.
  thread_local std::vector<float> states;
  states.resize(frames * echo.state_size());
  const auto state = [&](std::size_t f) {
    return std::span(states).subspan(f * echo.state_size(), echo.state_size());
  };
  for (std::size_t f = 0; f < frames; ++f) {
    echo.set_carrier(f % carriers);
    echo.advance(later_s, rng, state(f));
  }
  GaussianNoise noise(rng);
  // Incoherent echoes are drawn per frame, but stand for such as do not vary.
  const bool varies = c.radar_sum == "coherent";
  std::vector<float> of_frames(varies ? frames * points : 0);  // power of each point
  ArrayLooks looks;
  looks.array.reserve(kept_bins * record::values_of_bin(antennas));
  std::vector<float> planes(echo.planes_size());
  const auto re = std::span(planes).first(antennas * lanes);
  const auto im = std::span(planes).subspan(echo.imaginary_plane(), antennas * lanes);
  // A block's statistics stay in the cache over all frames.
  for (std::size_t block = 0; block < echo.blocks(); ++block) {
    const std::size_t bins = std::min(lanes, points - block * lanes);
    record::ArrayStatistics sums(bins, antennas);
    for (std::size_t f = 0; f < frames; ++f) {
      echo.set_carrier(f % carriers);
      echo.look(block, state(f), planes);
      noise.add(re, rms);
      noise.add(im, rms);
      if (carriers > 1) sums.skip();  // the frame before was of another carrier
      sums.add_planes(re.data(), im.data());
      if (varies)
        put_powers(re, im, bins, std::span(of_frames).subspan(f * points + block * lanes, bins));
    }
    const auto array = sums.take();
    for (std::size_t i = 0; i < bins; ++i) {
      const auto bin = record::bin_of(array, antennas, i);
      looks.power.push_back(double{bin.power()} / static_cast<double>(antennas));
      if (block * lanes + i < kept_bins)
        looks.array.insert(looks.array.end(), bin.values.begin(), bin.values.end());
    }
  }
  if (!varies) return looks;
  record::SpeckleStatistics speckle(carriers);
  for (std::size_t f = 0; f < frames; ++f)
    speckle.add(f / carriers, f % carriers, static_cast<double>(f) * later_s,
                std::span(of_frames).subspan(f * points, points));
  looks.speckle = speckle.take();
  return looks;
}

}  // namespace echofuse::sim
