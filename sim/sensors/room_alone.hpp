// SPDX-License-Identifier: MIT
// What the room gives if nobody is in it. It stands still: of a scene before it only that has to be
// looked at which people and objects change (RoomIs::subtracted).
#pragma once
#include <vector>

#include "sim/sensors/antennas.hpp"

namespace echofuse::sim {

struct RoomAlone {
  std::vector<double> light;  // spd_rate, without background counts
  std::vector<double> power;  // radar_power, if incoherent
  // room_echo, if there are antennas and it is coherent
  std::vector<std::complex<float>> echo;
};
RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar);

// What is left of the room is nowhere below 0.
void add_room(const std::vector<double>& room, std::vector<double>& all);

}  // namespace echofuse::sim
