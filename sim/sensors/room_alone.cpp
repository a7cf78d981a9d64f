// SPDX-License-Identifier: MIT
#include "sim/sensors/room_alone.hpp"

#include <algorithm>

#include "sim/scene/room.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {

RoomAlone room_alone(const Conditions& conditions, const AntennaRadar& radar) {
  Conditions c = conditions;
  c.background_counts = 0;
  c.radar_leakage = 0;
  const Scene scene = empty_room(*room_named(c.background));
  RoomAlone room;
  room.light = spd_rate(spd_returns(scene, c), c);
  if (c.radar_sum != "coherent")
    room.power = radar_power(radar_returns(scene, c), radar.axis);
  else if (!radar.antennas.empty())
    room.echo = room_echo(radar, c);
  return room;
}

void add_room(const std::vector<double>& room, std::vector<double>& all) {
  std::transform(room.begin(), room.end(), all.begin(), all.begin(),
                 [](double a, double b) { return std::max(0.0, a + b); });
}

}  // namespace echofuse::sim
