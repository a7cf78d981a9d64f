// SPDX-License-Identifier: MIT
#include "sim/sensors/range_nodes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "drivers/core/clones.hpp"
#include "sim/sensors/array_kernels.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {
namespace {

constexpr std::size_t nodes_per_cell = 2, taps = 10;
constexpr std::size_t phases = RangeNodes::slots_per_cell / nodes_per_cell;
using Taps = std::array<std::array<float, taps>, phases>;

Taps make_taps() {
  constexpr double pi = std::numbers::pi, half = taps / 2.0;
  const double beta = pi * half / 2;  // the band and its image are half a sampling rate apart
  Taps out{};
  for (std::size_t p = 0; p < phases; ++p)
    for (std::size_t t = 0; t < taps; ++t) {
      const double place = (static_cast<double>(p) + 0.5) / phases;  // after node taps/2 - 1
      const double u = place + half - 1 - static_cast<double>(t), v = u / half;
      out[p][t] =
          static_cast<float>(std::sin(pi * u) / (pi * u) *
                             std::cyl_bessel_i(0.0, beta * std::sqrt(std::max(0.0, 1 - v * v))) /
                             std::cyl_bessel_i(0.0, beta));
    }
  return out;
}

std::int64_t first_node_of(std::size_t slot) {
  return static_cast<std::int64_t>(slot / phases) - static_cast<std::int64_t>(taps / 2 - 1);
}

}  // namespace

RangeNodes::RangeNodes(const RadarAxis& axis, std::size_t first_slot, std::size_t last_slot)
    : first_node_(first_node_of(first_slot)),
      count_(static_cast<std::size_t>(first_node_of(last_slot) - first_node_) + taps) {
  constexpr float least = 1e-4f;
  const std::size_t blocks = (axis.count + lanes - 1) / lanes;
  responses_.resize(blocks * count_ * lanes);
  reach_.assign(blocks, {count_, 0});
  const RangeResponse response(axis);
  std::vector<double> psf;
  for (std::size_t j = 0; j < count_; ++j) {
    response.at(static_cast<double>(first_node_ + static_cast<std::int64_t>(j)) / nodes_per_cell,
                psf);
    for (std::size_t i = 0; i < psf.size(); ++i) {
      const auto value = static_cast<float>(psf[i]);
      responses_[(i / lanes * count_ + j) * lanes + i % lanes] = value;
      if (std::abs(value) <= least) continue;
      Reach& reach = reach_[i / lanes];
      reach.first = std::min(reach.first, j);
      reach.last = j + 1;
    }
  }
}

void RangeNodes::share(std::size_t slot, const float* values, std::size_t row, float* nodes) const {
  static const Taps all = make_taps();
  nodes += static_cast<std::size_t>(first_node_of(slot) - first_node_) * row;
  share_row(values, row, all[slot % phases].data(), taps, nodes);
}

void RangeNodes::respond(std::size_t block, const float* nodes, std::size_t row,
                         float* planes) const {
  const Reach& reach = reach_[block];
  if (reach.first < reach.last)
    sim::respond(&responses_[(block * count_ + reach.first) * lanes], nodes + reach.first * row,
                 reach.last - reach.first, row, planes);
}

}  // namespace echofuse::sim
