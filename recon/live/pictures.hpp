// SPDX-License-Identifier: MIT
// Data of a record as the page draws them.
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

// Returns the power in dB by range and direction; NaN without antenna data.
std::vector<float> beams_of(const record::FusedRecord& r, const record::Antennas& antennas,
                            std::size_t bins);

// Column of the waterfall: at most 256 values, each the maximum of neighbouring bins.
std::size_t column_bins(std::size_t bins);
std::vector<float> column_of(const std::vector<float>& values);

// Returns the camera's map on this grid, metres, 0 = no return; empty without a camera image.
std::vector<float> map_of(const record::FusedRecord& r, const std::vector<Axis>& axes,
                          const record::MapGrid& grid);

// Returns the SPD histogram, summed over the zones.
std::vector<float> clicks_of(const record::FusedRecord& r, const std::vector<Axis>& axes);

// Converts a value of a profile to linear power: it is power or a code of the firmware
// (drivers/core/axis.hpp).
double power_of(float value, const Axis& axis);
std::vector<float> to_db(std::span<const float> profile, const Axis& axis);

}  // namespace echofuse::view
