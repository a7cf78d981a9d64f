// SPDX-License-Identifier: MIT
#include "sim/sensors/gaussian.hpp"

#include <array>
#include <cmath>
#include <cstdint>

namespace echofuse::sim {
namespace {

// Marsaglia and Tsang, "The ziggurat method for generating random variables" (2000): 128 layers of
// equal area under exp(-x^2 / 2).
class Ziggurat {
 public:
  Ziggurat() {
    constexpr double area = 9.91256303526217e-3;
    const auto density = [](double x) { return std::exp(-x * x / 2); };
    const double base = area / density(tail);
    edge_[0] = base, edge_[1] = tail;
    for (std::size_t i = 2; i < layers; ++i)
      edge_[i] = std::sqrt(-2 * std::log(area / edge_[i - 1] + density(edge_[i - 1])));
    edge_[layers] = 0;
    for (std::size_t i = 0; i < layers; ++i) {
      inside_[i] = static_cast<float>(edge_[i + 1] / edge_[i]);
      width_[i] = static_cast<float>(edge_[i]);
      height_[i] = i == 0 ? density(tail) : density(edge_[i]);
    }
    height_[layers] = 1;
  }

  // From 32 random bits, 7 of them for the layer; more are drawn for one number in fifty.
  float operator()(std::uint32_t bits, Rng& rng) const {
    for (;; bits = static_cast<std::uint32_t>(rng())) {
      const std::size_t layer = bits % layers;
      const float share = static_cast<float>(static_cast<std::int32_t>(bits & ~127u)) * 0x1p-31f;
      if (std::abs(share) < inside_[layer]) return share * width_[layer];
      const double x = share * width_[layer];
      if (layer == 0) return static_cast<float>(std::copysign(beyond(rng), share));
      const double from = height_[layer], to = height_[layer + 1];
      if (from + unit(rng) * (to - from) < std::exp(-x * x / 2)) return static_cast<float>(x);
    }
  }

 private:
  static constexpr std::size_t layers = 128;
  static constexpr double tail = 3.442619855899;
  static double unit(Rng& rng) { return (static_cast<double>(rng() >> 11) + 0.5) * 0x1p-53; }
  static double beyond(Rng& rng) {
    for (;;) {
      const double x = -std::log(unit(rng)) / tail, y = -std::log(unit(rng));
      if (y + y > x * x) return tail + x;
    }
  }
  std::array<double, layers + 1> edge_{}, height_{};
  std::array<float, layers> inside_{}, width_{};
};

}  // namespace

void add_gaussian(std::span<float> values, float rms, Rng& rng) {
  static const Ziggurat draw;
  for (std::size_t i = 0; i < values.size(); i += 2) {
    const std::uint64_t bits = rng();
    values[i] += rms * draw(static_cast<std::uint32_t>(bits), rng);
    if (i + 1 < values.size())
      values[i + 1] += rms * draw(static_cast<std::uint32_t>(bits >> 32), rng);
  }
}

}  // namespace echofuse::sim
