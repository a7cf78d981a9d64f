// SPDX-License-Identifier: MIT
// What the echoes of radar_array.cpp have in common, and those that stand still. Internal to it.
#pragma once
#include <array>
#include <complex>
#include <cstddef>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/clones.hpp"
#include "sim/sensors/radar_array.hpp"
#include "sim/sensors/range_nodes.hpp"

namespace echofuse::sim {

// A wave from this direction at each antenna, as its channel records it.
std::vector<std::complex<double>> wave_at(const record::Antennas& antennas, double x, double y);

// Complex numbers of one point or cell, one for each antenna: all real parts, then all imaginary
// ones, both filled up to a multiple of eight.
struct Layout {
  std::size_t antennas, padded, row;

  explicit Layout(std::size_t n)
      : antennas(n), padded((n + lanes - 1) / lanes * lanes), row(2 * padded) {}
  std::size_t planes() const { return row * lanes; }
};

// Adds one wave after the other, fast.
class Waves {
 public:
  Waves(const record::Antennas& antennas, const Layout& layout);
  void add(float x, float y, float amplitude, float ahead_turns, float* out);

 private:
  Layout layout_;
  std::vector<std::array<float, 4>> channels_;
  std::vector<float> turns_, re_, im_;
};

inline std::size_t blocks_of(const RadarAxis& axis) { return (axis.count + lanes - 1) / lanes; }
inline std::size_t slot_of(double range_m, const RadarAxis& axis) {
  return static_cast<std::size_t>(range_m / axis.resolution_m * RangeNodes::slots_per_cell);
}

// Planes of all blocks, at one carrier after the other. The reflector and the leakage are points;
// the room and objects are coherent, and what is hidden of them has a negative weight and is taken
// away.
void add_points(const Returns& returns, const ArrayRadar& radar, std::vector<float>& planes);
void add_still(const Returns& returns, const ArrayRadar& radar, std::vector<float>& planes);
// By how much less the phase of an echo is at a carrier so much higher, in turns.
inline double turns_of_carrier(double range_m, double carrier_hz) {
  return -2 * range_m * carrier_hz / speed_of_light_m_s;
}

}  // namespace echofuse::sim
