// SPDX-License-Identifier: MIT
// Model of the radar echo of one reflector, used by peak.cpp and response_fit.cpp. Pure functions.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace echofuse::acquire {

// Cosine coefficients of the firmware's Blackman window, relative to its constant term (SDK 3.x,
// mmwDemo_genWindow).
inline constexpr std::array blackman{0.5 / 0.42, 0.08 / 0.42};

// Window function of the range transform: 1 + a cos x + b cos 2x + ... with x = 2 pi t, -1/2 < t <
// 1/2 over the sweep (Harris, Proc. IEEE 66, 1978). `terms` contains a, b, ... A nonlinear ramp
// adds the phase skew_rad (y^3 - y/4) with y = 2t, which makes the lobe asymmetric. Of all cubic
// phases, this one shifts the lobe of a Hann window least.
struct Window {
  std::vector<double> terms{blackman.begin(), blackman.end()};
  double adding = 0;  // 0: the amplitudes of noise and echo add (interference); 1: their powers add
  double skew_rad = 0;
  double zero_cells = 0;  // offset of range zero from the transform's origin, in cells of c / 2B
};

// Fourier transform of a window: the response to an echo at distance u, in cells of c / 2B.
class Lobe {
 public:
  explicit Lobe(const Window& window) : zero_(window.zero_cells) {
    for (std::size_t i = 0; i < samples; ++i) {
      const double y = (static_cast<double>(i) + 0.5) / samples, x = std::numbers::pi * y;
      double k = 0;
      weights_[i] = 1;
      for (const double term : window.terms) weights_[i] += term * std::cos(++k * x);
      weights_[i] /= samples;
      phases_[i] = window.skew_rad * (y * y * y - y / 4);
    }
  }
  double amplitude(double u) const {
    double sum = 0;
    for (std::size_t i = 0; i < samples; ++i)
      sum += weights_[i] *
             std::cos(std::numbers::pi * (u + zero_) * (static_cast<double>(i) + 0.5) / samples +
                      phases_[i]);
    return sum;
  }
  double power(double u) const { return amplitude(u) * amplitude(u); }
  double log2_power(double u) const { return std::log2(std::max(1e-12, power(u))); }

 private:
  static constexpr std::size_t samples = 48;  // number of points over half of the sweep
  double zero_;
  std::array<double, samples> weights_, phases_;
};

// Returns the signal-to-noise power ratio. The arguments are log2 of the two powers.
inline double power_over_noise(double log2_signal, double log2_noise) {
  return std::max(std::exp2(log2_signal - log2_noise), 1e-9);
}

// Returns the mean log2 power of a signal in noise. If signal and noise interfere (adding = 0), the
// mean is log2(signal) + E1(x) / ln 2 with x = signal / noise. If their powers add (adding = 1),
// exp(x) E1(x) replaces E1(x).
inline double mean_log2_power(double over_noise, double log2_noise, double adding = 0) {
  const double x = over_noise, e1 = x < 50 ? -std::expint(-x) : 0,
               more = x < 50 ? std::exp(x) * e1 : 1 / x;
  return std::log2(x) + log2_noise + ((1 - adding) * e1 + adding * more) / std::numbers::ln2;
}

// Returns log2 of the mean noise power, given the mean of log2 of the noise power. For noise alone,
// the mean of ln P is lower than the logarithm of the mean of P by Euler's constant.
inline double log2_noise_of(double mean_log2) {
  return mean_log2 + std::numbers::egamma / std::numbers::ln2;
}

}  // namespace echofuse::acquire
