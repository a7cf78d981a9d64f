// SPDX-License-Identifier: MIT
// Model of a radar's echo of one reflector, shared by the two fits of the echo. Pure.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

namespace echofuse::acquire {

// The transform of cos k x over the sweep; u in cells of c / 2B (Harris, Proc. IEEE 66, 1978).
inline double term_amplitude(double u, double k) {
  const auto sinc = [](double v) {
    const double x = std::numbers::pi * v;
    return std::abs(v) < 1e-9 ? 1.0 : std::sin(x) / x;
  };
  return (sinc(u - k) + sinc(u + k)) / 2;
}

// Amplitude of the window 1 + a cos x + b cos 2x + ...; terms: a, b, ...; 1 at u = 0.
inline double window_amplitude(double u, std::span<const double> terms) {
  double sum = term_amplitude(u, 0), k = 0;
  for (const double term : terms) sum += term * term_amplitude(u, ++k);
  return sum;
}

// The terms of the firmware's Blackman window (SDK 3.x, mmwDemo_genWindow).
inline constexpr std::array blackman{0.5 / 0.42, 0.08 / 0.42};

// Window by which echoes are placed.
struct Window {
  std::vector<double> terms{blackman.begin(), blackman.end()};
  double adding = 0;  // from 0 to 1: noise interferes with the echo, or its power adds

  // log2 of the lobe's power, 0 at its top.
  double lobe(double u) const {
    return 2 * std::log2(std::max(1e-6, std::abs(window_amplitude(u, terms))));
  }
};

// The power of a signal over the noise; the arguments are log2 of powers.
inline double power_over_noise(double log2_signal, double log2_noise) {
  return std::max(std::exp2(log2_signal - log2_noise), 1e-9);
}

// Mean of log2 of the power of a signal in noise: log2 of the signal's power plus E1(x) / ln 2, x =
// power over noise, if the noise interferes. If the noise's power adds: exp(x) E1(x).
inline double mean_log2_power(double over_noise, double log2_noise, double adding = 0) {
  const double x = over_noise, e1 = x < 50 ? -std::expint(-x) : 0,
               more = x < 50 ? std::exp(x) * e1 : 1 / x;
  return std::log2(x) + log2_noise + ((1 - adding) * e1 + adding * more) / std::numbers::ln2;
}

// Noise alone: the mean of the logarithm is Euler's constant below the logarithm of the mean.
inline double log2_noise_of(double mean_log2) {
  return mean_log2 + std::numbers::egamma / std::numbers::ln2;
}

}  // namespace echofuse::acquire
