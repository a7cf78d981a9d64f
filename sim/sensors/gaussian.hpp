// SPDX-License-Identifier: MIT
#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/core/clones.hpp"
#include "drivers/core/random.hpp"

namespace echofuse::sim {

// Generates Gaussian random numbers many times faster than std::normal_distribution, with the same
// result on every machine. Applies the method of Box and Muller (Ann. Math. Stat. 29, 610, 1958) to
// eight streams of xoshiro128++ (Blackman and Vigna, ACM Trans. Math. Softw. 47, 36, 2021). All
// numbers are within 6.6 standard deviations.
class GaussianNoise {
 public:
  explicit GaussianNoise(Rng& seed);
  // Adds an independent Gaussian random number with this rms value to each value.
  void add(std::span<float> values, float rms);

 private:
  std::array<std::array<std::uint32_t, lanes>, 4> state_;
};

void add_gaussian(std::span<float> values, float rms, Rng& rng);

}  // namespace echofuse::sim
