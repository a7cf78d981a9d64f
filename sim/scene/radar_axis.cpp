// SPDX-License-Identifier: MIT
#include "sim/scene/radar_axis.hpp"

#include <cmath>
#include <numbers>

#include "acquire/measurement/response.hpp"

namespace echofuse::sim {

double Psf::at_sine(double u, double sine) const {
  const double whole = std::round(u), order = std::abs(whole);
  if (std::abs(u - whole) < nearest)
    return order == 0 ? 1 : order == 1 ? first / 2 : order == 2 ? second / 2 : 0;
  return sine / (std::numbers::pi * u) * windowed()(u * u);
}

double Psf::at(double u) const {
  if (taps.empty()) return at_sine(u, std::sin(std::numbers::pi * u));
  const double place = zero + u * record::RadarResponse::taps_a_cell, whole = std::floor(place);
  if (!(place > -1 && place < static_cast<double>(taps.size()))) return 0;
  const auto tap = [&](double i) {
    return i >= 0 && i < static_cast<double>(taps.size()) ? taps[static_cast<std::size_t>(i)] : 0;
  };
  return record::catmull_rom({tap(whole - 1), tap(whole), tap(whole + 1), tap(whole + 2)},
                             place - whole);
}

}  // namespace echofuse::sim
