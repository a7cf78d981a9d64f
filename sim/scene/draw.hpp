// SPDX-License-Identifier: MIT
// Random numbers for photon counts. The distributions of the standard library call lgamma, a data
// race because of its global sign, and differ between libraries.
#pragma once
#include <cstdint>

#include "drivers/core/random.hpp"

namespace echofuse::sim {

// Returns a number in [low, high) with 53 random bits.
double uniform(Rng& rng, double low, double high);

// Poisson number by PTRS of Hormann, "The transformed rejection method for generating Poisson
// random variables" (1993).
std::int64_t poisson(double mean, Rng& rng);

// Binomial number by BTRS of Hormann, "The generation of binomial random variates" (1993).
std::int64_t binomial(std::int64_t n, double p, Rng& rng);

}  // namespace echofuse::sim
