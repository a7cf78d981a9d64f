// SPDX-License-Identifier: MIT
// Returns and echoes of the room alone. The room stands still: in a scene before it, only the part
// that people and objects change has to be looked at (RoomIs::subtracted).
#pragma once
#include <vector>

#include "sim/sensors/antennas.hpp"

namespace echofuse::sim {

struct RoomAlone {
  std::vector<double> light;  // spd_rate, without background counts
  std::vector<double> power;  // radar_power, if incoherent
  // Result of room_echo() with coherent antennas; else empty.
  std::vector<std::complex<float>> echo;
};
RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar);

// The sum is nowhere below 0.
void add_room(const std::vector<double>& room, std::vector<double>& all);

}  // namespace echofuse::sim
