// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>

namespace echofuse::sim {

enum class Psf : std::uint8_t { sinc, blackman };

// The points lie at start + i*step, and the response to one scatterer at R is psf((R_i - R) /
// resolution).
struct RadarAxis {
  double start_m = 0;
  double step_m = 0.25;
  std::uint32_t count = 29;
  double resolution_m = 0.5;  // c / 2B: the sinc's first null
  Psf psf = Psf::sinc;
};

}  // namespace echofuse::sim
