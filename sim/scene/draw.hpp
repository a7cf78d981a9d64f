// SPDX-License-Identifier: MIT
// Random numbers for photon counts. Standard library distributions give different numbers in
// different implementations. They also call lgamma, which causes data races because it writes a
// global variable.
#pragma once
#include <cstdint>

#include "drivers/core/random.hpp"

namespace echofuse::sim {

// Returns a uniform random number in [low, high) with 53 random bits.
double uniform(Rng& rng, double low, double high);

// Returns a Poisson-distributed number by the method PTRS of Hormann, "The transformed rejection
// method for generating Poisson random variables" (1993).
std::int64_t poisson(double mean, Rng& rng);

// Returns a binomially distributed number by the method BTRS of Hormann, "The generation of
// binomial random variates" (1993).
std::int64_t binomial(std::int64_t n, double p, Rng& rng);

}  // namespace echofuse::sim
