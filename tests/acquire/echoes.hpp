// SPDX-License-Identifier: MIT
// Histograms of a simulated detector, and range profiles of a radar with 12 virtual antennas.
#pragma once
#include <complex>
#include <functional>

#include "../catch.hpp"
#include "acquire/calibrate/peak.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/random.hpp"
#include "drivers/radar/log2_codes.hpp"

namespace echofuse::test {

using Amplitude = std::complex<double>;
inline constexpr unsigned antennas = 12;
inline constexpr double pi = std::numbers::pi;

inline constexpr double step_ps = 10;
inline constexpr std::size_t bins = 2000;  // for ranges from 0 to 3 m

// Returns a photon histogram with a uniform background and a Gaussian IRF. Each of the `reflectors`
// is a pair {range in m, mean number of photons}. The delay of a fraction `share` of the photons is
// increased by an exponentially distributed time.
inline std::vector<std::uint32_t> photons(const std::vector<std::pair<double, double>>& reflectors,
                                          double background, Rng& rng, double fwhm_ps = 200,
                                          double tail_ps = 1, double share = 0) {
  std::vector<std::uint32_t> counts(bins);
  std::exponential_distribution<double> delay(1 / tail_ps);
  std::bernoulli_distribution delayed(share);
  for (const auto& [range_m, mean] : reflectors) {
    std::normal_distribution<double> time(range_m * ps_per_m,
                                          fwhm_ps / std::sqrt(8 * std::numbers::ln2));
    for (auto n = std::poisson_distribution<int>(mean)(rng); n > 0; --n) {
      const double t = time(rng) + (share > 0 && delayed(rng) ? delay(rng) : 0);
      if (t >= 0 && t < step_ps * bins) ++counts[static_cast<std::size_t>(t / step_ps)];
    }
  }
  for (auto n = std::poisson_distribution<int>(background)(rng); n > 0; --n) ++counts[rng() % bins];
  return counts;
}

struct NamedWindow {
  const char* name;
  // Returns the window amplitude. The argument is the position within the sweep, from -1/2 (start)
  // to 1/2 (end).
  std::function<double(double)> at;
  double cubic_rad = 0;  // phase error at the end of the sweep
};
// Returns a sum of cosines.
inline std::function<double(double)> cosines(const std::vector<double>& terms) {
  return [terms](double t) {
    double sum = 0, k = 0;
    for (const double term : terms) sum += term * std::cos(2 * pi * k++ * t);
    return sum;
  };
}
inline const NamedWindow blackman_window{"Blackman", cosines({.42, .5, .08})};

// Computes the range response directly, as a sum over the samples of the sweep.
inline Amplitude response(const NamedWindow& window, double cells) {
  constexpr unsigned samples = 120;
  Amplitude sum = 0;
  double all = 0;
  for (unsigned k = 0; k < samples; ++k) {
    const double t = (k + 0.5) / samples - 0.5;
    sum += window.at(t) * std::polar(1.0, 2 * pi * t * cells + window.cubic_rad * 8 * t * t * t);
    all += window.at(t);
  }
  return sum / all;
}

struct Echo {
  double range_m;
  Amplitude amplitude = 1;
};
// Returns range profiles of the radar firmware. Each power comes from an integer code, which is
// proportional to the sum over antennas of the log2 magnitudes. If `adds` is true, the noise power
// is added to the signal power. Otherwise, complex noise is added to the amplitudes.
inline acquire::Profiles frames_of(const std::vector<Echo>& echoes, const acquire::EchoAxis& axis,
                                   double noise_db, std::size_t count, Rng& rng,
                                   const NamedWindow& window = blackman_window, double leakage = 0,
                                   bool adds = false) {
  std::vector<Amplitude> clean(64);
  for (std::size_t i = 0; i < clean.size(); ++i)
    for (const auto& [range_m, amplitude] : echoes)
      clean[i] += amplitude * response(window, (static_cast<double>(i) * axis.step_m - range_m) /
                                                   axis.resolution_m);
  clean[0] += leakage;
  const double power = std::pow(10, noise_db / 10);
  std::normal_distribution<double> noise(0, std::sqrt(power / 2));
  std::exponential_distribution<double> more(1 / power);
  acquire::Profiles out(count);
  for (auto& frame : out)
    for (const auto& c : clean) {
      double sum = adds ? antennas * std::log2(1e6 * std::sqrt(std::norm(c) + more(rng))) : 0;
      for (unsigned n = 0; n < antennas && !adds; ++n)
        sum += std::log2(1e6 * std::abs(c + Amplitude(noise(rng), noise(rng))));
      frame.push_back(radar::power_from_code(
          static_cast<std::uint16_t>(std::lround(256 * sum / 16)), antennas));
    }
  return out;
}

}  // namespace echofuse::test
