// SPDX-License-Identifier: MIT
// Axis of a sensor's values. It is written once per run and checked by every reader.
#pragma once
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "drivers/core/zone.hpp"

namespace echofuse {

inline constexpr double speed_of_light_m_s = 299'792'458.0;  // exact, because it defines the metre
// two-way time of flight in ps per metre of range
inline constexpr double ps_per_m = 2e12 / speed_of_light_m_s;

// Axis with equal steps. Bin i of the SPD covers [start + i*step, start + (i+1)*step). Point i of
// the radar and pixel i of the depth map lie exactly at start + i*step.
//   name      quantity                unit  meaning of the values along it
//   spd       counts                  ps    detections per bin of two-way time of flight
//   radar     power                   m     linear power (arbitrary scale)
//   radar     binned_power            m     linear power, summed over one step around each point
//   radar     power_with_noise        m     linear power that includes the receiver noise (TI)
//   array     covariance            m     covariances of the radar's `scale` virtual antennas
//                                   (acquire/measurement/radar_array.hpp)
//   depth_x   tangent                 1     x/z of a pixel column, x to the right
//   depth_y   tangent                 1     y/z of a pixel row, y up (step is negative)
//   map_x     tangent                 1     x/z of the map grid (acquire/measurement/depth_map.hpp)
//   map_y     tangent                 1     y/z of the map grid
//   map_z     depth                   m     range of the map grid: one bin, starting at 0
struct Axis {
  std::string name;
  std::string quantity;
  std::string unit;
  std::uint32_t count = 0;
  double start = 0;
  double step = 0;
  double scale = 1;
  // Zones of the detector, for the axis "spd". Each zone has its own values along the axis.
  Zones zones = single_pixel();

  double at(double i) const { return start + i * step; }
  std::size_t values() const { return zones.size() * count; }  // in one record, for all zones
};

inline Axis spd_axis(std::uint32_t bins, double start_ps, double step_ps,
                     Zones zones = single_pixel()) {
  return {"spd", "counts", "ps", bins, start_ps, step_ps, 1, std::move(zones)};
}
inline Axis range_axis(const char* quantity, std::uint32_t points, double start_m, double step_m) {
  return {"radar", quantity, "m", points, start_m, step_m};
}
inline Axis tangent_axis(const char* name, std::uint32_t count, double start, double step) {
  return {name, "tangent", "1", count, start, step};
}

// Returns the axis with this name, or nullptr.
inline const Axis* find_axis(std::span<const Axis> axes, std::string_view name) {
  for (const Axis& axis : axes)
    if (axis.name == name) return &axis;
  return nullptr;
}

// Returns true if all fields are equal, except that start and end may differ by up to 0.001 steps.
inline bool same_axis(const Axis& a, const Axis& b) {
  const double tolerance = 1e-3 * std::abs(a.step);
  return a.name == b.name && a.quantity == b.quantity && a.unit == b.unit && a.count == b.count &&
         a.scale == b.scale && a.zones == b.zones && std::abs(a.start - b.start) <= tolerance &&
         std::abs(a.at(a.count) - b.at(b.count)) <= tolerance;
}

}  // namespace echofuse
