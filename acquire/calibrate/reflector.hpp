// SPDX-License-Identifier: MIT
// Computes the range and the direction of the calibration reflector from each sensor, and their
// errors. Pure functions.
//
// Seen from behind the sensors, x points right, y up and z away. The detector is at the origin, the
// middle of the radar antennas at (-b, 0, 0). A reflector at (0, 0, d) in front of the detector is
// at
//   r = sqrt(d^2 + b^2),  sin(direction) = b / r
// from the radar: 1.118 m and 26.6 degrees at d = 1 m and b = 0.5 m.
//
// The errors of the distance (s_d) and the baseline (s_b) are propagated to first order (JCGM
// 100:2008, GUM, 5.1.2). The lateral error (mount tilted by s_d / d) and the height error are also
// s_d:
//   detector  s^2 = s_d^2
//   radar     s^2 = (d / r)^2 s_d^2 + (b / r)^2 (s_b^2 + s_d^2) + (s_d^2 / 2r)^2
// If the reflector is in front of the radar, d = r and b = 0.
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

  double range_m(Sensor sensor) const;  // true range of the reflector from the sensor
  double error_m(Sensor sensor) const;  // standard error of range_m()
  Reflector other() const;              // copy of this reflector with the other value of `mounting`
};

// Returns a question for the user if the radar peak fits the other mounting better; otherwise an
// empty string. The other mounting fits better if the peak is inside the search window of that
// mounting (full width) and implies a smaller offset. A negative offset is weighted by three,
// because cables and electronics increase the measured range. The string is also empty if the
// ranges for the two mountings differ by less than three standard errors.
std::string other_mounting(const Reflector& reflector, double measured_m, double window_m);

// Returns the phase (rad) of the reflector's spherical wave at each antenna, relative to antenna 0:
//   phase = -2 pi / wavelength (|P - tx| + |P - rx|)
// P, tx and rx are the positions of the reflector, the transmitter and the receiver, all relative
// to the middle of the antennas (Balanis, Antenna Theory, 4th ed., 4.4). The centres of
// transmitters and receivers are assumed to coincide.
std::vector<double> steering_phases(std::span<const radar::AntennaPair> antennas,
                                    const std::array<double, 3>& place, double wavelength_m);

struct Steering {
  double sine = 0;  // sine of the reflector's angle from the radar axis, positive to the right
  std::vector<double> phase_rad, error_rad;
};
// Returns the direction of the reflector, the phase of its wave at each antenna, and the phase
// errors caused by the uncertainty of its position.
Steering steering_of(const Reflector& reflector, std::span<const radar::AntennaPair> antennas,
                     double wavelength_m);

}  // namespace echofuse::acquire
