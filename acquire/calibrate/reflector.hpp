// SPDX-License-Identifier: MIT
// Range and direction of the calibration reflector from each sensor, with errors. Pure.
//
// Seen from behind, x is to the right, y up, z away. The detector is at the origin, the middle of
// the radar's antennas at (-b, 0, 0). A reflector at (0, 0, d) in front of the detector is at
//   r = sqrt(d^2 + b^2),  sin(direction) = b / r
// from the radar: 1.118 m and 26.6 degrees at d = 1 m and b = 0.5 m.
//
// The errors of the distance (s_d) and the baseline (s_b) are propagated to first order (JCGM
// 100:2008, GUM, 5.1.2). The lateral error (mount tilted by s_d / d) and the height error are also
// s_d:
//   detector  s^2 = s_d^2
//   radar     s^2 = (d / r)^2 s_d^2 + (b / r)^2 (s_b^2 + s_d^2) + (s_d^2 / 2r)^2
// In front of the radar d = r and b = 0.
#pragma once
#include <array>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/radar/board_antennas.hpp"

namespace echofuse::acquire {

enum class Mounting { detector, each };
const char* name_of(Mounting mounting);

struct Reflector {
  Mounting mounting = Mounting::detector;
  double distance_m = 1, baseline_m = 0.5;
  double distance_error_m = 2e-3, baseline_error_m = 2e-3;

  double range_m(Sensor sensor) const;  // true range from the sensor
  double error_m(Sensor sensor) const;  // standard error of this range
  Reflector other() const;              // same distance, other mounting
};

// Returns why the radar's peak fits the other mounting better, or an empty text. Of the mountings
// with the peak in the window (full width), the one with the smaller offset is likelier. A negative
// offset is weighted by three, because cables and electronics make ranges longer. Empty if the
// mountings differ by less than three standard errors.
std::string other_mounting(const Reflector& reflector, double measured_m, double window_m);

// Phase of the reflector's spherical wave at each antenna relative to antenna 0, rad:
//   phase = -2 pi / wavelength (|P - tx| + |P - rx|)
// with the reflector at P from the middle of the antennas (Balanis, Antenna Theory, 4th ed., 4.4).
// The centres of transmitters and receivers are assumed to coincide.
std::vector<double> steering_phases(std::span<const radar::AntennaPair> antennas,
                                    const std::array<double, 3>& place, double wavelength_m);

struct Steering {
  double sine = 0;  // sine of the direction, positive to the right
  std::vector<double> phase_rad, error_rad;
};
// Direction of the reflector, with the errors of its position.
Steering steering_of(const Reflector& reflector, std::span<const radar::AntennaPair> antennas,
                     double wavelength_m);

}  // namespace echofuse::acquire
