// SPDX-License-Identifier: MIT
#include "sim/scene/draw.hpp"

#include <math.h>  // lgamma_r is POSIX

#include <cmath>

namespace echofuse::sim {
namespace {

// Below this mean, events are counted one by one. This is as fast as the rejection methods, which
// are valid only above this mean.
constexpr double few = 10;

double log_factorial(double k) {
  int sign = 0;
  return ::lgamma_r(k + 1, &sign);
}

// Returns the number of events before the sum of exponential waiting times exceeds the mean.
std::int64_t count_poisson(double mean, Rng& rng) {
  const double limit = std::exp(-mean);
  std::int64_t k = 0;
  for (double product = uniform(rng, 0, 1); product > limit; product *= uniform(rng, 0, 1)) ++k;
  return k;
}

// Returns the number of successes before the sum of the geometric gaps between them exceeds n.
std::int64_t count_binomial(std::int64_t n, double p, Rng& rng) {
  const double scale = 1 / std::log1p(-p);
  std::int64_t k = 0;
  for (double place = 0;; ++k) {
    place += std::floor(std::log1p(-uniform(rng, 0, 1)) * scale) + 1;
    if (!(place <= static_cast<double>(n))) return k;
  }
}

// Candidate k of the transformed-rejection method, computed from two uniform random numbers and the
// hat parameters a and b.
struct Proposal {
  double us, v, k;
  Proposal(double a, double b, double centre, Rng& rng) {
    const double u = uniform(rng, -0.5, 0.5);
    us = 0.5 - std::abs(u);
    v = uniform(rng, 0, 1);
    k = std::floor((2 * a / us + b) * u + centre);
  }
};

}  // namespace

double uniform(Rng& rng, double low, double high) {
  constexpr double unit = 0x1p-53;
  return low + (high - low) * unit * static_cast<double>(rng() >> 11);
}

std::int64_t poisson(double mean, Rng& rng) {
  if (mean < few) return count_poisson(mean, rng);
  const double b = 0.931 + 2.53 * std::sqrt(mean), a = -0.059 + 0.02483 * b;
  const double scale = 1.1239 + 1.1328 / (b - 3.4), squeeze = 0.9277 - 3.6224 / (b - 2);
  const double log_mean = std::log(mean);
  for (;;) {
    const Proposal t(a, b, mean + 0.43, rng);
    if (t.us >= 0.07 && t.v <= squeeze) return static_cast<std::int64_t>(t.k);
    if (t.k < 0 || (t.us < 0.013 && t.v > t.us)) continue;
    if (std::log(t.v * scale / (a / (t.us * t.us) + b)) <=
        t.k * log_mean - mean - log_factorial(t.k))
      return static_cast<std::int64_t>(t.k);
  }
}

std::int64_t binomial(std::int64_t n, double p, Rng& rng) {
  if (n <= 0 || p <= 0) return 0;
  if (p >= 1) return n;
  if (p > 0.5) return n - binomial(n, 1 - p, rng);
  const auto trials = static_cast<double>(n);
  if (trials * p < few) return count_binomial(n, p, rng);
  const double sigma = std::sqrt(trials * p * (1 - p)), b = 1.15 + 2.53 * sigma;
  const double a = -0.0873 + 0.0248 * b + 0.01 * p, squeeze = 0.92 - 4.2 / b;
  const double scale = (2.83 + 5.1 / b) * sigma, log_odds = std::log(p / (1 - p));
  const double mode = std::floor((trials + 1) * p);
  const double at_mode = log_factorial(mode) + log_factorial(trials - mode);
  for (;;) {
    const Proposal t(a, b, trials * p + 0.5, rng);
    if (t.k < 0 || t.k > trials) continue;
    if (t.us >= 0.07 && t.v <= squeeze) return static_cast<std::int64_t>(t.k);
    if (std::log(t.v * scale / (a / (t.us * t.us) + b)) <=
        at_mode - log_factorial(t.k) - log_factorial(trials - t.k) + (t.k - mode) * log_odds)
      return static_cast<std::int64_t>(t.k);
  }
}

}  // namespace echofuse::sim
