// SPDX-License-Identifier: MIT
#include "acquire/calibrate/antenna_side.hpp"

#include <cmath>
#include <complex>
#include <numbers>

#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

double degrees(double sine) { return std::asin(sine) * 180 / std::numbers::pi; }

// Returns the difference between the sines of two directions. Sines that differ by 2 are
// equivalent, because a phase of 2 pi between antennas half a wavelength apart is ambiguous.
double apart(double sine, double other) { return std::abs(std::remainder(sine - other, 2)); }

}  // namespace

SidePlace place_at(Side side, const Reflector& r, double sine) {
  const double moved = side == Side::right ? r.baseline_m : -r.baseline_m;
  // Lateral position of the moved reflector relative to the radar, in m.
  const double x = r.distance_m * std::tan(std::asin(sine)) + moved;
  const double range = std::hypot(r.distance_m, x);
  return {x - r.baseline_m, range, x / range};
}

SideFinding find_side(Side side, const Reflector& reflector, const AntennaGains& seen,
                      const AntennaGains& calibrated, std::span<const radar::AntennaPair> antennas,
                      double wavelength_m) {
  const SidePlace place = place_at(side, reflector, calibrated.sine);
  SideFinding out;
  out.expected = place.sine;
  out.if_swapped = std::remainder(2 * calibrated.sine - place.sine, 2);
  constexpr double step = 0.005;
  double best = 0;
  for (double u = -1 + step; u < 1; u += step) {
    const auto phases = steering_phases(
        antennas, {place.range_m * u, 0, place.range_m * std::sqrt(1 - u * u)}, wavelength_m);
    std::complex<double> sum;
    for (std::size_t m = 0; m < phases.size(); ++m)
      sum += std::polar(1.0, seen.phase_rad[m] - calibrated.phase_rad[m] - phases[m]);
    if (std::abs(sum) > best) best = std::abs(sum), out.sine = u;
  }
  constexpr double near = 0.12;  // tolerated difference between the sines
  const double off = apart(out.sine, out.expected), off_swapped = apart(out.sine, out.if_swapped);
  out.swapped = off_swapped < off;
  if (std::min(off, off_swapped) > near)
    out.refusal = format(
        "echo at %+.0f degrees (expected %+.0f, or %+.0f if the antenna order is "
        "reversed): check the reflector's position",
        degrees(out.sine), degrees(out.expected), degrees(out.if_swapped));
  return out;
}

std::string to_text(Side side, const SideFinding& f) {
  if (!f.refusal.empty()) return "array  rejected: " + f.refusal + "\n";
  return format("array  echo on the %s at %+.0f degrees (expected %+.0f): ",
                side == Side::right ? "right" : "left", degrees(f.sine), degrees(f.expected)) +
         (f.swapped ? "the antenna order is reversed; turn the board upside down "
                      "or correct radar.board, then calibrate again\n"
                    : "the antenna order is correct\n");
}

}  // namespace echofuse::acquire
