// SPDX-License-Identifier: MIT
// Is the radar's antenna row swapped? Asks for one echo at a known side. Pure.
//
// Calibrated with a reflector at sin(direction) = u0, antennas of a board that is mounted the other
// way round, or of another radar.board, contain the phases of 2 u0: what stands at u is then found
// at 2 u0 - u. An echo at u0 does not show that. So the reflector moves by one baseline to the left
// or to the right of its place at the calibration.
#pragma once
#include <span>
#include <string>
#include <vector>

#include "acquire/calibrate/reflector.hpp"
#include "acquire/config/calibration.hpp"

namespace echofuse::acquire {

enum class Side { left, right };

struct SidePlace {
  double x_m = 0;      // from the detector
  double range_m = 0;  // from the radar
  double sine = 0;     // sine of the direction from the radar
};
// `sine` is that of the calibration.
SidePlace place_at(Side side, const Reflector& reflector, double sine);

struct SideFinding {
  double sine = 0, expected = 0, if_swapped = 0;
  bool swapped = false;
  std::string refusal;  // neither of both
};
// Direction of the wave `seen` (as fit_antennas measures it) with the calibrated antennas.
SideFinding find_side(Side side, const Reflector& reflector, const AntennaGains& seen,
                      const AntennaGains& calibrated, std::span<const radar::AntennaPair> antennas,
                      double wavelength_m);
std::string to_text(Side side, const SideFinding& finding);

}  // namespace echofuse::acquire
