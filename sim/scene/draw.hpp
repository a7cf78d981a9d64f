// SPDX-License-Identifier: MIT
// Random numbers for photon counts. The standard library's poisson_distribution and
// binomial_distribution call lgamma, whose global sign is a data race between threads, and give
// other numbers with each library.
#pragma once
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "drivers/core/random.hpp"

namespace echofuse::sim {

// The number is in [low, high) and has 53 random bits.
double uniform(Rng& rng, double low, double high);

// Draws the random numbers that make a scene. It keeps its draws, and can make the same scene again
// with the continuous ones moved, as a study of sensitivity needs.
class SceneSampler {
 public:
  struct Draw {
    double low = 0, high = 0, value = 0;
  };

  explicit SceneSampler(Rng rng) : rng_(rng) {}
  // Draw k then is its value plus moves[k], which may leave the range; draws beyond the end are not
  // moved.
  SceneSampler(Rng rng, std::vector<double> moves) : rng_(rng), moves_(std::move(moves)) {}

  double uniform(double low, double high);
  // Returns one of 0..n-1; the draw is discrete, and not kept.
  std::size_t pick(std::size_t n) { return rng_() % n; }
  // Returns all draws of uniform() so far, in their order.
  const std::vector<Draw>& draws() const { return draws_; }

 private:
  Rng rng_;
  std::vector<double> moves_;
  std::vector<Draw> draws_;
};

// Poisson number by PTRS of Hormann, "The transformed rejection method for generating Poisson
// random variables" (1993).
std::int64_t poisson(double mean, Rng& rng);

// Binomial number by BTRS of Hormann, "The generation of binomial random variates" (1993).
std::int64_t binomial(std::int64_t n, double p, Rng& rng);

}  // namespace echofuse::sim
