// SPDX-License-Identifier: MIT
// Detects a swapped antenna row from an echo on a known side. Pure functions.
//
// If the board is mounted upside down, or radar.board is wrong, a calibration at sin(direction) =
// u0 adds the phases of 2 u0 to the antennas: an object at u is then found at 2 u0 - u. The
// error cannot be detected at u0, because 2 u0 - u0 = u0. Therefore the operator moves the
// reflector by one baseline to the left or right of its calibration position.
#pragma once
#include <span>
#include <string>

#include "acquire/calibrate/reflector.hpp"
#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

enum class Side { left, right };

struct SidePlace {
  double x_m = 0;      // lateral position relative to the detector
  double range_m = 0;  // distance from the radar
  double sine = 0;     // sine of the reflector's angle from the radar axis
};
// Returns the expected position of the reflector after it has been moved to `side`. `sine` is the
// sine of the reflector's direction during the calibration.
SidePlace place_at(Side side, const Reflector& reflector, double sine);

struct SideFinding {
  double sine = 0, expected = 0, if_swapped = 0;
  bool swapped = false;
  // Reason for the rejection if the direction of the echo matches neither the normal nor the
  // reversed antenna order; otherwise empty.
  std::string refusal;
};
// Uses the calibrated phases to find the direction of a wave. `seen` contains the gains and phases
// that fit_antennas() measured for this wave.
SideFinding find_side(Side side, const Reflector& reflector, const AntennaGains& seen,
                      const AntennaGains& calibrated, std::span<const radar::AntennaPair> antennas,
                      double wavelength_m);
std::string to_text(Side side, const SideFinding& finding);

}  // namespace echofuse::acquire
