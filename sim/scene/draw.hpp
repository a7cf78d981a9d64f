// SPDX-License-Identifier: MIT
// Random numbers for photon counts. The standard library's poisson_distribution and
// binomial_distribution call lgamma, whose global sign is a data race between threads, and give
// other numbers with each library.
#pragma once
#include <cstdint>

#include "drivers/core/random.hpp"

namespace echofuse::sim {

// The number is in [low, high) and has 53 random bits.
double uniform(Rng& rng, double low, double high);

// Poisson number by PTRS of Hormann, "The transformed rejection method for generating Poisson
// random variables" (1993).
std::int64_t poisson(double mean, Rng& rng);

// Binomial number by BTRS of Hormann, "The generation of binomial random variates" (1993).
std::int64_t binomial(std::int64_t n, double p, Rng& rng);

}  // namespace echofuse::sim
