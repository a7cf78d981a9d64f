// SPDX-License-Identifier: MIT
#include "sim/sensors/array_parts.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "sim/sensors/array_cells.hpp"
#include "sim/sensors/array_kernels.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {
namespace {

using Complex = std::complex<double>;

constexpr double pi = std::numbers::pi;

// The same for the same patch, whatever stands before others.
float turns_of_patch(const Returns& returns, std::size_t k, std::uint64_t seed) {
  const auto range = std::bit_cast<std::uint64_t>(returns.range_m[k]);
  const auto x = std::bit_cast<std::uint32_t>(returns.place[k].x);
  const auto y = std::bit_cast<std::uint32_t>(returns.place[k].y);
  return static_cast<float>(mix(seed ^ mix(range ^ mix(x ^ mix(y)))) >> 40) * 0x1p-24f;
}

}  // namespace

std::vector<Complex> wave_at(const record::Antennas& antennas, double x, double y) {
  std::vector<Complex> wave;
  wave.reserve(antennas.size());
  for (const auto& a : antennas)
    wave.push_back(std::polar(a.gain, pi * (a.x * x + a.y * y) + a.phase_rad));
  return wave;
}

Waves::Waves(const record::Antennas& antennas, const Layout& layout)
    : layout_(layout), turns_(layout.padded), re_(layout.padded), im_(layout.padded) {
  for (const auto& a : antennas)
    channels_.push_back({static_cast<float>(a.x / 2), static_cast<float>(a.y / 2),
                         static_cast<float>(a.phase_rad / (2 * pi)), static_cast<float>(a.gain)});
}

void Waves::add(float x, float y, float amplitude, float ahead_turns, float* out) {
  for (std::size_t m = 0; m < channels_.size(); ++m) {
    const auto& c = channels_[m];
    turns_[m] = c[0] * x + c[1] * y + c[2] + ahead_turns;
  }
  turn(turns_.data(), re_.data(), im_.data(), turns_.size());
  for (std::size_t m = 0; m < channels_.size(); ++m) {
    out[m] += amplitude * channels_[m][3] * re_[m];
    out[layout_.padded + m] += amplitude * channels_[m][3] * im_[m];
  }
}

void add_points(const Returns& returns, const ArrayRadar& radar, std::vector<float>& planes) {
  const Layout layout(radar.antennas.size());
  const RangeResponse response(radar.axis);
  std::vector<double> psf;
  for (const auto kind : {Returns::reflector, Returns::leakage}) {
    const ArrayCell cell = one_cell_of(returns, kind);
    if (cell.weight <= 0) continue;
    const auto wave = wave_at(radar.antennas, cell.x, cell.y);
    response.at(cell.range_m / radar.axis.resolution_m, psf);
    for (std::size_t i = 0; i < psf.size(); ++i)
      for (std::size_t m = 0; m < wave.size(); ++m) {
        const Complex value = std::sqrt(cell.weight) * psf[i] * wave[m];
        for (std::size_t carrier = 0; carrier < radar.carriers_hz.size(); ++carrier) {
          const std::size_t block = carrier * blocks_of(radar.axis) + i / lanes;
          float* out = &planes[block * layout.planes() + i % lanes];
          out[m * lanes] += static_cast<float>(value.real());
          out[(layout.padded + m) * lanes] += static_cast<float>(value.imag());
        }
      }
  }
}

void add_still(const Returns& returns, const ArrayRadar& radar, std::vector<float>& planes) {
  const Layout layout(radar.antennas.size());
  std::vector<std::size_t> patches;
  std::size_t first = SIZE_MAX, last = 0;
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    if (returns.place[k].person != Returns::still || returns.range_m[k] <= 0) continue;
    patches.push_back(k);
    first = std::min(first, slot_of(returns.range_m[k], radar.axis));
    last = std::max(last, slot_of(returns.range_m[k], radar.axis));
  }
  if (patches.empty()) return;
  Waves waves(radar.antennas, layout);
  const RangeNodes range(radar.axis, first, last);
  const std::size_t blocks = blocks_of(radar.axis);
  for (std::size_t carrier = 0; carrier < radar.carriers_hz.size(); ++carrier) {
    std::vector<float> slots((last - first + 1) * layout.row);
    for (const std::size_t k : patches) {
      const auto& place = returns.place[k];
      const double weight = returns.weight[k], range_m = returns.range_m[k];
      waves.add(place.x, place.y,
                static_cast<float>(std::copysign(std::sqrt(std::abs(weight)), weight)),
                turns_of_patch(returns, k, radar.still_seed) +
                    static_cast<float>(turns_of_carrier(range_m, radar.carriers_hz[carrier])),
                &slots[(slot_of(range_m, radar.axis) - first) * layout.row]);
    }
    std::vector<float> nodes(range.count() * layout.row);
    for (std::size_t slot = first; slot <= last; ++slot)
      range.share(slot, &slots[(slot - first) * layout.row], layout.row, nodes.data());
    for (std::size_t block = 0; block < blocks; ++block)
      range.respond(block, nodes.data(), layout.row,
                    &planes[(carrier * blocks + block) * layout.planes()]);
  }
}

}  // namespace echofuse::sim
