// SPDX-License-Identifier: MIT
#include "sim/sensors/gaussian.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

namespace echofuse::sim {
namespace {

using State = std::array<std::array<std::uint32_t, lanes>, 4>;
constexpr std::size_t pairs = 2 * lanes;  // what one step makes

using Words [[gnu::vector_size(4 * lanes)]] = std::uint32_t;
using Whole [[gnu::vector_size(4 * lanes)]] = std::int32_t;
using Reals = Eight;

#define ECHOFUSE_INLINE [[gnu::always_inline]] inline

// All by reference: a function of the default target may not return vectors that AVX2 holds in one
// register.
ECHOFUSE_INLINE void next(Words& a, Words& b, Words& c, Words& d, Words& out) {
  const Words sum = a + d;
  out = ((sum << 7) | (sum >> 25)) + a;
  const Words t = b << 9;
  c ^= a;
  d ^= b;
  b ^= c;
  a ^= d;
  c ^= t;
  d = (d << 11) | (d >> 21);
}

// ln of numbers in (0, 1], to 1e-7.
ECHOFUSE_INLINE void logarithm(const Reals& u, Reals& out) {
  constexpr std::int32_t root_half = 0x3f3504f3;  // of sqrt(1/2), in whose octave mantissas lie
  const Whole bits = reinterpret_cast<Whole>(u) - root_half;
  const Reals exponent = __builtin_convertvector(bits >> 23, Reals);
  const Reals t = reinterpret_cast<Reals>((bits & 0x7fffff) + root_half) - 1;
  const Reals s = t / (t + 2), q = s * s;
  out = exponent * std::numbers::ln2_v<float> +
        2 * s * (1 + q * (1.f / 3 + q * (1.f / 5 + q * (1.f / 7))));
}

// cos and sin of x in [-pi/2, pi/2], doubled; exact to 1e-5.
ECHOFUSE_INLINE void turn_twice(const Reals& x, Reals& cosine, Reals& sine) {
  const Reals q = x * x;
  const Reals s = x * (1 + q * (-1.f / 6 + q * (1.f / 120 + q * (-1.f / 5040 + q / 362880))));
  const Reals c =
      1 + q * (-0.5f + q * (1.f / 24 + q * (-1.f / 720 + q * (1.f / 40320 - q / 3628800))));
  cosine = 1 - 2 * s * s;
  sine = 2 * s * c;
}

// Whole steps: `steps` times `pairs` numbers.
ECHOFUSE_CLONES void add_steps(State& state, float rms, float* values, std::size_t steps) {
  Words a, b, c, d;
  std::memcpy(&a, &state[0], sizeof a);
  std::memcpy(&b, &state[1], sizeof b);
  std::memcpy(&c, &state[2], sizeof c);
  std::memcpy(&d, &state[3], sizeof d);
  for (; steps > 0; --steps, values += pairs) {
    Words first, second;
    next(a, b, c, d, first);
    next(a, b, c, d, second);
    // (0, 1], and an angle's half in [-pi/2, pi/2)
    const Reals u =
        (__builtin_convertvector(reinterpret_cast<Whole>(first >> 1), Reals) + 1) * 0x1p-31f;
    const Reals x = __builtin_convertvector(reinterpret_cast<Whole>(second), Reals) *
                    (std::numbers::pi_v<float> * 0x1p-32f);
    Reals log, cosine, sine;
    logarithm(u, log);
    turn_twice(x, cosine, sine);
    const Reals square = -2 * rms * rms * log;
    alignas(sizeof(Reals)) std::array<float, lanes> roots;
    store(roots.data(), square > 0 ? square : Reals{});
    for (float& root : roots) root = std::sqrt(root);
    Reals radius;
    load(radius, roots.data());
    Reals one, other;
    load(one, values);
    load(other, values + lanes);
    store(values, one + radius * cosine);
    store(values + lanes, other + radius * sine);
  }
  std::memcpy(&state[0], &a, sizeof a);
  std::memcpy(&state[1], &b, sizeof b);
  std::memcpy(&state[2], &c, sizeof c);
  std::memcpy(&state[3], &d, sizeof d);
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
