// SPDX-License-Identifier: MIT
// Scenes and helpers for tests of the simulated radar antennas.
#pragma once
#include <complex>
#include <utility>

#include "../catch.hpp"
#include "scenes.hpp"
#include "sim/sensors/antennas.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {

inline constexpr double pi = std::numbers::pi;
using Complex = std::complex<double>;
using Samples = std::vector<std::complex<float>>;

inline Conditions of_sum(const char* sum) {
  Conditions c;
  c.radar_antennas = 8;
  c.radar_sum = sum;
  return c;
}

inline Returns points(std::initializer_list<Returns::PatchOrigin> places,
                      std::vector<double> ranges, std::vector<double> weights) {
  return {.range_m = std::move(ranges), .weight = std::move(weights), .place = places};
}

inline void check_near(Complex a, Complex b, double margin) {
  INFO(a << " " << b);
  CHECK(std::abs(a - b) < margin);
}

inline Returns a_person(const Conditions& c, std::uint64_t index) {
  return radar_returns(make_scene(c, SceneKind::person, 5, index), c);
}

inline std::size_t peak_of(const Returns& returns, Conditions c) {
  c.radar_sum = "incoherent";
  const auto power = radar_power(returns, radar_response(c));
  return static_cast<std::size_t>(std::max_element(power.begin(), power.end()) - power.begin());
}

}  // namespace echofuse::sim
