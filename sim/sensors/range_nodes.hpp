// SPDX-License-Identifier: MIT
// Echoes of a radar from many ranges, all antennas at once: what a response limited in bandwidth
// makes of them follows from few nodes. Internal to radar_array.cpp.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "sim/scene/radar_axis.hpp"

namespace echofuse::sim {

// Nodes stand half a resolution cell apart. An echo from the middle of slot s, an eighth of a cell
// wide, is shared among ten of them, by a sinc in Kaiser's window, as reading between samples is;
// the error is 2e-3 of the echo at most, 4e-4 on average.
class RangeNodes {
 public:
  static constexpr std::size_t slots_per_cell = 8;

  // For echoes from slots first..last.
  RangeNodes(const RadarAxis& axis, std::size_t first_slot, std::size_t last_slot);
  std::size_t count() const { return count_; }

  // Adds a slot's row to the nodes'.
  void share(std::size_t slot, const float* values, std::size_t row, float* nodes) const;
  // Adds what the nodes make of points `block` * lanes and following, by planes
  // (array_kernels.hpp).
  void respond(std::size_t block, const float* nodes, std::size_t row, float* planes) const;

 private:
  struct Reach {
    std::size_t first, last;  // nodes that answer with more than -80 dB in a block
  };
  std::int64_t first_node_;
  std::size_t count_;
  std::vector<float> responses_;  // by blocks, of each node: those of `lanes` points
  std::vector<Reach> reach_;
};

}  // namespace echofuse::sim
