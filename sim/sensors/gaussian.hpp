// SPDX-License-Identifier: MIT
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/core/clones.hpp"
#include "drivers/core/random.hpp"

namespace echofuse::sim {

// Makes Gaussian numbers, many times as fast as std::normal_distribution, and the same on every
// machine. The method is Box and Muller (Ann. Math. Stat. 29, 610, 1958) on eight streams of
// xoshiro128++ (Blackman and Vigna, ACM Trans. Math. Softw. 47, 36, 2021). None is beyond 6.6 rms.
class GaussianNoise {
 public:
  explicit GaussianNoise(Rng& seed);
  // Adds a number of this rms to each value.
  void add(std::span<float> values, float rms);

 private:
  std::array<std::array<std::uint32_t, lanes>, 4> state_;
};

void add_gaussian(std::span<float> values, float rms, Rng& rng);

}  // namespace echofuse::sim
