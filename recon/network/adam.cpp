// SPDX-License-Identifier: MIT
// Compiled with -fno-math-errno and -fno-trapping-math, which allow the compiler to vectorise the
// square root and the comparisons.
#include "recon/network/adam.hpp"

#include <algorithm>
#include <cmath>

#include "recon/numbers/parallel.hpp"

namespace echofuse::recon {
namespace {

// Defaults of Kingma and Ba (ICLR 2015).
constexpr float b1 = 0.9f, b2 = 0.999f, epsilon = 1e-8f;
// Gradients and moments below these limits are set to 0. They are far below epsilon and do not
// change any weight, but calculations with subnormal numbers are slow. NaN is kept.
constexpr float min_gradient = 1e-16f, min_moment = 1e-30f;

// Updates n parameters p by their gradients g and moments m and v, and clears g. This is a separate
// function, because the compiler vectorises the loop only for plain arguments.
inline __attribute__((always_inline)) void step_each(std::size_t n, float* p, float* m, float* v,
                                                     float* g, float keep, float rate) {
  for (std::size_t i = 0; i < n; ++i) {
    const float slope = std::abs(g[i]) < min_gradient ? 0 : g[i];
    const float mean = b1 * m[i] + (1 - b1) * slope;
    const float square = b2 * v[i] + (1 - b2) * slope * slope;
    m[i] = std::abs(mean) < min_moment ? 0 : mean;
    v[i] = square < min_moment ? 0 : square;
    p[i] = keep * p[i] - rate * m[i] / (std::sqrt(v[i]) + epsilon);
    g[i] = 0;
  }
}

#if defined(__x86_64__)
// The results are bit-identical to those on processors without AVX2, because this version does not
// use FMA.
__attribute__((target("avx2"))) void step_avx2(std::size_t n, float* p, float* m, float* v,
                                               float* g, float keep, float rate) {
  step_each(n, p, m, v, g, keep, rate);
}
#endif

void step_part(std::size_t n, float* p, float* m, float* v, float* g, float keep, float rate) {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return step_avx2(n, p, m, v, g, keep, rate);
#endif
  step_each(n, p, m, v, g, keep, rate);
}

}  // namespace

void Adam::step(std::vector<float>& parameters, std::vector<float>& gradient,
                double learning_rate) {
  ++steps;
  const auto n = static_cast<double>(steps);
  const double correction = std::sqrt(1 - std::pow(double{b2}, n)) / (1 - std::pow(double{b1}, n));
  const auto rate = static_cast<float>(learning_rate * correction);
  const float keep = 1 - static_cast<float>(learning_rate) * decay;
  constexpr std::size_t part = 1 << 17;
  for_each_part((parameters.size() + part - 1) / part, [&](std::size_t k) {
    const std::size_t at = k * part;
    step_part(std::min(part, parameters.size() - at), parameters.data() + at, first.data() + at,
              second.data() + at, gradient.data() + at, keep, rate);
  });
}

}  // namespace echofuse::recon
