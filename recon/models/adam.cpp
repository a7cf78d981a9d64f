// SPDX-License-Identifier: MIT
// Compiled with -fno-math-errno: otherwise the square root keeps the loop from being vectorised.
#include "recon/models/adam.hpp"

#include <cmath>

namespace echofuse::recon {

void Adam::step(std::vector<float>& parameters, const std::vector<float>& gradient,
                double learning_rate) {
  constexpr float b1 = 0.9f, b2 = 0.999f, epsilon = 1e-8f;
  ++steps_;
  const auto n = static_cast<double>(steps_);
  const double correction = std::sqrt(1 - std::pow(double{b2}, n)) / (1 - std::pow(double{b1}, n));
  const auto rate = static_cast<float>(learning_rate * correction);
  const float keep = 1 - static_cast<float>(learning_rate) * decay_;
  float* p = parameters.data();
  float* m = first_.data();
  float* v = second_.data();
  const float* g = gradient.data();
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    m[i] = b1 * m[i] + (1 - b1) * g[i];
    v[i] = b2 * v[i] + (1 - b2) * g[i] * g[i];
    p[i] = keep * p[i] - rate * m[i] / (std::sqrt(v[i]) + epsilon);
  }
}

}  // namespace echofuse::recon
