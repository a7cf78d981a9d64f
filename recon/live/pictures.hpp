// SPDX-License-Identifier: MIT
// Converts the data of a record to images, columns and curves for the page.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/fused_record.hpp"

namespace echofuse::view {

const Axis* find(const std::vector<Axis>& axes, const char* name);  // returns null if not found

// Camera image reduced to every k-th row and column, so that each side has at most 320 pixels.
struct Picture {
  std::vector<std::uint16_t> mm;
  std::size_t height = 0, width = 0;
};
Picture thinned(const std::vector<std::uint16_t>& mm, std::size_t height, std::size_t width);

// Returns the radar power in dB for each range and direction; NaN if the record has no antenna
// data.
std::vector<float> beams_of(const record::FusedRecord& r, const record::Antennas& antennas,
                            std::size_t bins);

// Returns the number of bins in a column of the waterfall, at most 256. Each bin contains the
// maximum of several neighbouring values.
std::size_t column_bins(std::size_t bins);
std::vector<float> column_of(const std::vector<float>& values);

// Returns the camera's depth map on this grid, m; 0: no return. Empty if the record has no camera
// image.
std::vector<float> map_of(const record::FusedRecord& r, const std::vector<Axis>& axes,
                          const record::MapGrid& grid);

// Returns the SPD histogram, summed over all zones.
std::vector<float> clicks_of(const record::FusedRecord& r, const std::vector<Axis>& axes);

std::vector<float> to_db(std::span<const float> power);

}  // namespace echofuse::view
