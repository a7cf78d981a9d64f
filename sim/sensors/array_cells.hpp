// SPDX-License-Identifier: MIT
// Patches that the antennas cannot tell apart, added up. Internal to radar_array.cpp.
#pragma once
#include <cstdint>
#include <vector>

#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Weights are added, everything else is their centre's.
struct ArrayCell {
  double weight = 0, range_m = 0, x = 0, y = 0, height_m = 0;
  std::int32_t person = Returns::still;
  std::size_t slot = 0;  // of range, from 0; those of one slot stand together
};

// Across a cell the phase of eight antennas turns by 0.7 rad from end to end, and that of a head
// that sways 5 mm, against the feet, by 0.7 rad.
struct CellSize {
  double range_m = 0.0625;
  double cosine = 0.03;
  double height_m = 0.1;
};

struct ArrayCells {
  std::vector<ArrayCell> cells;      // by slot
  std::vector<double> slot_range_m;  // centre of what is in it
  std::size_t people = 0;
};

enum class Echoes : std::uint8_t { of_people, of_people_and_room };
ArrayCells cells_of(const Returns& returns, const CellSize& size, Echoes which);

// All patches of one kind (Returns::reflector, leakage) as one cell; weight 0: there are none.
ArrayCell one_cell_of(const Returns& returns, std::int32_t kind);

}  // namespace echofuse::sim
