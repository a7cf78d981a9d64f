// SPDX-License-Identifier: MIT
#include "acquire/calibrate/reflector.hpp"

#include <cmath>
#include <numbers>

#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

using Position = std::array<double, 3>;

Position place_of(const Reflector& r) {
  return {r.mounting == Mounting::detector ? r.baseline_m : 0, 0, r.distance_m};
}

double implausibility(double offset_m) {
  constexpr double too_short = 3;
  return offset_m < 0 ? -too_short * offset_m : offset_m;
}

Position middle_of(std::span<const radar::AntennaPair> antennas,
                   radar::AntennaPlace radar::AntennaPair::*end) {
  Position sum{};
  for (const auto& a : antennas) {
    sum[0] += (a.*end).x / static_cast<double>(antennas.size());
    sum[1] += (a.*end).y / static_cast<double>(antennas.size());
  }
  return sum;
}

}  // namespace

const char* name_of(Mounting mounting) {
  return mounting == Mounting::detector ? "detector" : "each";
}

double Reflector::range_m(Sensor sensor) const {
  return sensor == Sensor::radar && mounting == Mounting::detector
             ? std::hypot(distance_m, baseline_m)
             : distance_m;
}

double Reflector::error_m(Sensor sensor) const {
  if (sensor != Sensor::radar) return distance_error_m;
  const double range = range_m(sensor), across = place_of(*this)[0];
  const double along = distance_m / range * distance_error_m;
  const double aside = across / range * std::hypot(baseline_error_m, distance_error_m);
  return std::hypot(along, aside, distance_error_m * distance_error_m / (2 * range));
}

Reflector Reflector::other() const {
  Reflector out = *this;
  out.mounting = mounting == Mounting::detector ? Mounting::each : Mounting::detector;
  return out;
}

std::string other_mounting(const Reflector& reflector, double measured_m, double window_m) {
  const Reflector other = reflector.other();
  const double offset_m = measured_m - reflector.range_m(Sensor::radar),
               other_m = measured_m - other.range_m(Sensor::radar);
  if (std::abs(other_m) > window_m / 2 ||
      std::abs(offset_m - other_m) < 3 * reflector.error_m(Sensor::radar) ||
      implausibility(offset_m) <= implausibility(other_m))
    return {};
  return format(
      "the peak at %.3f m fits --reflector %s (true range %.3f m, offset %+.1f mm) better "
      "than --reflector %s (true range %.3f m, offset %+.1f mm); check whether the reflector is in "
      "front of the %s",
      measured_m, name_of(other.mounting), other.range_m(Sensor::radar), 1e3 * other_m,
      name_of(reflector.mounting), reflector.range_m(Sensor::radar), 1e3 * offset_m,
      other.mounting == Mounting::detector ? "detector" : "radar");
}

std::vector<double> steering_phases(std::span<const radar::AntennaPair> antennas,
                                    const Position& place, double wavelength_m) {
  const Position tx = middle_of(antennas, &radar::AntennaPair::tx),
                 rx = middle_of(antennas, &radar::AntennaPair::rx);
  const auto way_m = [&](const radar::AntennaPlace& from, const Position& middle) {
    return std::hypot(place[0] - (from.x - middle[0]) * radar::half_wavelength_m,
                      place[1] - (from.y - middle[1]) * radar::half_wavelength_m, place[2]);
  };
  std::vector<double> phases;
  for (const auto& a : antennas)
    phases.push_back(-2 * std::numbers::pi / wavelength_m * (way_m(a.tx, tx) + way_m(a.rx, rx)));
  for (std::size_t m = phases.size(); m-- > 0;) phases[m] -= phases[0];
  return phases;
}

Steering steering_of(const Reflector& r, std::span<const radar::AntennaPair> antennas,
                     double wavelength_m) {
  const Position place = place_of(r);
  Steering out;
  out.sine = place[0] / std::hypot(place[0], place[2]);
  out.phase_rad = steering_phases(antennas, place, wavelength_m);
  std::vector<double> variances(antennas.size());
  const Position errors{r.mounting == Mounting::detector
                            ? std::hypot(r.baseline_error_m, r.distance_error_m)
                            : r.distance_error_m,
                        r.distance_error_m, r.distance_error_m};
  for (std::size_t axis = 0; axis < place.size(); ++axis) {
    Position moved = place;
    moved[axis] += errors[axis];
    const auto phases = steering_phases(antennas, moved, wavelength_m);
    for (std::size_t m = 0; m < phases.size(); ++m)
      variances[m] += std::pow(phases[m] - out.phase_rad[m], 2);
  }
  for (const double v : variances) out.error_rad.push_back(std::sqrt(v));
  return out;
}

}  // namespace echofuse::acquire
