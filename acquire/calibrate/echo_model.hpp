// SPDX-License-Identifier: MIT
// What a radar shows of one reflector: the two fits of its echo share this model. Pure.
#pragma once
#include <algorithm>
#include <cmath>
#include <numbers>

namespace echofuse::acquire {

// The transform of the window 1 + a cos x + b cos 2x over the sweep, 1 at u = 0; u in cells of
// c / 2B (Harris, Proc. IEEE 66, 1978).
inline double window_amplitude(double u, double a, double b) {
  const auto sinc = [](double v) {
    const double x = std::numbers::pi * v;
    return std::abs(v) < 1e-9 ? 1.0 : std::sin(x) / x;
  };
  return sinc(u) + a / 2 * (sinc(u - 1) + sinc(u + 1)) + b / 2 * (sinc(u - 2) + sinc(u + 2));
}

// The terms of the firmware's Blackman window (SDK 3.x, mmwDemo_genWindow).
inline constexpr double blackman_a = 0.5 / 0.42, blackman_b = 0.08 / 0.42;

// The power of a signal over the noise; the arguments are log2 of powers.
inline double power_over_noise(double log2_signal, double log2_noise) {
  return std::max(std::exp2(log2_signal - log2_noise), 1e-9);
}

// The mean of log2 of the power of a signal in noise: that of the signal, and E1 of the signal's
// power over the noise.
inline double mean_log2_power(double over_noise, double log2_noise) {
  return std::log2(over_noise) + log2_noise +
         (over_noise < 50 ? -std::expint(-over_noise) / std::numbers::ln2 : 0);
}

// Of noise alone the mean of the logarithm is Euler's constant below the logarithm of the mean.
inline double log2_noise_of(double mean_log2) {
  return mean_log2 + std::numbers::egamma / std::numbers::ln2;
}

}  // namespace echofuse::acquire
