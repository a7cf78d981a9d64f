// SPDX-License-Identifier: MIT
// A preview shows a record as a picture: depth map, histogram, profile; with antennas also the
// power over range and direction.
#pragma once
#include <cstdint>
#include <string>

namespace echofuse::sim {

// Writes `svg`. Throws Error(failed) for a run or record that is not there, Error(usage) for
// another kind of file, Error(disk) if the picture cannot be written.
void draw_record(const std::string& run, std::int64_t index, const std::string& svg);

}  // namespace echofuse::sim
