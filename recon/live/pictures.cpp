// SPDX-License-Identifier: MIT
#include "recon/live/pictures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace echofuse::view {
namespace {

constexpr std::size_t max_column_bins = 256;
std::size_t column_step(std::size_t bins) { return (bins + max_column_bins - 1) / max_column_bins; }

}  // namespace

std::size_t column_bins(std::size_t bins) {
  return bins == 0 ? 0 : (bins + column_step(bins) - 1) / column_step(bins);
}

const Axis* find(const std::vector<Axis>& axes, const char* name) {
  for (const Axis& a : axes)
    if (a.name == name) return &a;
  return nullptr;
}

Picture thinned(const std::vector<std::uint16_t>& mm, std::size_t height, std::size_t width) {
  constexpr std::size_t longest = 320;
  const std::size_t k = (std::max(height, width) + longest - 1) / longest;
  Picture out;
  for (std::size_t y = k / 2; y < height; y += k, ++out.height)
    for (std::size_t x = k / 2; x < width; x += k) out.mm.push_back(mm[y * width + x]);
  out.width = out.height > 0 ? out.mm.size() / out.height : 0;
  return out;
}

std::vector<float> beams_of(const record::FusedRecord& r, const record::Antennas& antennas,
                            std::size_t bins) {
  std::vector<float> out(bins * record::beams, std::nanf(""));
  if (!r.has(Sensor::radar) || r.array.empty() || antennas.empty()) return out;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double power =
        record::beam_power(record::bin_of(r.array, antennas.size(), i / record::beams), antennas,
                           record::beam_cosine(i % record::beams));
    out[i] = static_cast<float>(10 * std::log10(std::max(power, 1e-12)));
  }
  return out;
}

std::vector<float> column_of(const std::vector<float>& values) {
  std::vector<float> out(column_bins(values.size()), -std::numeric_limits<float>::infinity());
  const std::size_t step = column_step(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    float& highest = out[i / step];
    highest = std::max(highest, values[i]);
  }
  return out;
}

std::vector<float> map_of(const record::FusedRecord& r, const std::vector<Axis>& axes,
                          const record::MapGrid& grid) {
  const Axis *x = find(axes, "depth_x"), *y = find(axes, "depth_y");
  if (!r.has(Sensor::depth) || !x || !y) return {};
  return record::to_target(r.depth_mm, *x, *y, grid);
}

std::vector<float> clicks_of(const record::FusedRecord& r, const std::vector<Axis>& axes) {
  const Axis* axis = find(axes, "spd");
  const auto sum = sum_of_zones(r.spd, axis ? axis->count : 0);
  return {sum.begin(), sum.end()};
}

std::vector<float> to_db(std::span<const float> power) {
  std::vector<float> out;
  out.reserve(power.size());
  for (const float v : power)
    out.push_back(static_cast<float>(10 * std::log10(std::max(double{v}, 1e-12))));
  return out;
}

}  // namespace echofuse::view
