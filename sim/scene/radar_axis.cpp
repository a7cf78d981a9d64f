// SPDX-License-Identifier: MIT
#include "sim/scene/radar_axis.hpp"

#include <cmath>
#include <numbers>

namespace echofuse::sim {

double Psf::at_sine(double u, double sine) const {
  const double whole = std::round(u), order = std::abs(whole);
  if (std::abs(u - whole) < nearest)
    return order == 0 ? 1 : order == 1 ? first / 2 : order == 2 ? second / 2 : 0;
  return sine / (std::numbers::pi * u) * windowed()(u * u);
}

double Psf::at(double u) const {
  return measured.known() ? measured.amplitude(u) : at_sine(u, std::sin(std::numbers::pi * u));
}

}  // namespace echofuse::sim
