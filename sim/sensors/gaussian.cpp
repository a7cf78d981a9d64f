// SPDX-License-Identifier: MIT
#include "sim/sensors/gaussian.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace echofuse::sim {
namespace {

constexpr std::size_t pairs = 2 * lanes;  // number of random values generated per step

using Words = std::array<std::uint32_t, lanes>;

// Returns the natural logarithm of a number in (0, 1], with a relative error of about 1e-7.
float logarithm(float u) {
  // Bit pattern of sqrt(1/2) as a float. u is split into a power of two and a factor from sqrt(1/2)
  // to sqrt(2).
  constexpr std::int32_t root_half = 0x3f3504f3;
  const std::int32_t bits = std::bit_cast<std::int32_t>(u) - root_half;
  const float t = std::bit_cast<float>((bits & 0x7fffff) + root_half) - 1;
  const float s = t / (t + 2), q = s * s;
  return static_cast<float>(bits >> 23) * std::numbers::ln2_v<float> +
         2 * s * (1 + q * (1.f / 3 + q * (1.f / 5 + q * (1.f / 7))));
}

void next(std::array<Words, 4>& state, Words& out) {
  auto& [a, b, c, d] = state;
  for (std::size_t i = 0; i < lanes; ++i) {
    const std::uint32_t sum = a[i] + d[i], t = b[i] << 9;
    out[i] = ((sum << 7) | (sum >> 25)) + a[i];
    c[i] ^= a[i];
    d[i] ^= b[i];
    b[i] ^= c[i];
    a[i] ^= d[i];
    c[i] ^= t;
    d[i] = (d[i] << 11) | (d[i] >> 21);
  }
}

// Adds Gaussian numbers with this rms value to steps * pairs values.
void add_steps(std::array<Words, 4>& kept, float rms, float* values, std::size_t steps) {
  std::array<Words, 4> state = kept;
  Words first, second;
  for (; steps > 0; --steps, values += pairs) {
    next(state, first);
    next(state, second);
    for (std::size_t i = 0; i < lanes; ++i) {
      // u is uniform in (0, 1]. x is half of a uniform angle, so it is uniform in [-pi/2, pi/2).
      const float u = (static_cast<float>(static_cast<std::int32_t>(first[i] >> 1)) + 1) * 0x1p-31f;
      const float x = static_cast<float>(static_cast<std::int32_t>(second[i])) *
                      (std::numbers::pi_v<float> * 0x1p-32f);
      // Sine and cosine of x as power series. The sine and cosine of the full angle 2 x then have
      // errors below 2e-5.
      const float q = x * x;
      const float s = x * (1 + q * (-1.f / 6 + q * (1.f / 120 + q * (-1.f / 5040 + q / 362880))));
      const float c =
          1 + q * (-0.5f + q * (1.f / 24 + q * (-1.f / 720 + q * (1.f / 40320 - q / 3628800))));
      const float radius = std::sqrt(std::max(0.f, -2 * rms * rms * logarithm(u)));
      values[i] += radius * (1 - 2 * s * s);
      values[lanes + i] += radius * (2 * s * c);
    }
  }
  kept = state;
}

}  // namespace

GaussianNoise::GaussianNoise(Rng& seed) {
  for (auto& words : state_)
    for (std::size_t i = 0; i < lanes; i += 2) {
      const std::uint64_t bits = seed();
      words[i] = static_cast<std::uint32_t>(bits);
      words[i + 1] = static_cast<std::uint32_t>(bits >> 32);
    }
}

void GaussianNoise::add(std::span<float> values, float rms) {
  const std::size_t whole = values.size() / pairs;
  add_steps(state_, rms, values.data(), whole);
  const auto rest = values.subspan(whole * pairs);
  if (rest.empty()) return;
  std::array<float, pairs> some{};
  std::copy(rest.begin(), rest.end(), some.begin());
  add_steps(state_, rms, some.data(), 1);
  std::copy_n(some.begin(), rest.size(), rest.begin());
}

void add_gaussian(std::span<float> values, float rms, Rng& rng) {
  GaussianNoise(rng).add(values, rms);
}

}  // namespace echofuse::sim
