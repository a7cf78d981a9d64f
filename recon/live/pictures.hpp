// SPDX-License-Identifier: MIT
// Numbers that the page draws of a record.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_file.hpp"

namespace echofuse::view {

const Axis* find(const std::vector<Axis>& axes, const char* name);  // null: not found

// Every k-th row and column of a picture, so that no side is longer than 320 pixels.
struct Picture {
  std::vector<std::uint16_t> mm;
  std::size_t height = 0, width = 0;
};
Picture thinned(const std::vector<std::uint16_t>& mm, std::size_t height, std::size_t width);

// dB by range and direction; NaN without the radar's antennas.
std::vector<float> beams_of(const record::FusedRecord& r, const record::Antennas& antennas,
                            std::size_t bins);

// A column of the waterfall: neighbours as their highest, so that none has more than 256.
std::size_t column_bins(std::size_t bins);
std::vector<float> column_of(const std::vector<float>& values);

// Camera's map on this grid, metres, 0 = no return; empty without a picture.
std::vector<float> map_of(const record::FusedRecord& r, const std::vector<Axis>& axes,
                          const record::MapGrid& grid);

// SPD histogram: the sum over the zones.
std::vector<float> clicks_of(const record::FusedRecord& r, const std::vector<Axis>& axes);

// Linear power of a profile's value: power, or one of the firmware's codes (drivers/core/axis.hpp).
double power_of(float value, const Axis& axis);
// A profile in dB.
std::vector<float> to_db(std::span<const float> profile, const Axis& axis);

}  // namespace echofuse::view
