// SPDX-License-Identifier: MIT
// How people move who stand still. They sway about their ankles as an inverted pendulum (Morasso et
// al., PLoS ONE 14, e0213870, 2019), by some millimetres at the centre of pressure (Prieto et al.,
// IEEE Trans. Biomed. Eng. 43, 956, 1996), twist about an upright axis and breathe. At 60 GHz
// 2.5 mm are a whole turn of the echo's phase.
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "drivers/core/random.hpp"

namespace echofuse::sim {

struct Conditions;

class BodyMotion {
 public:
  // Sway to the right and away from the radar (m, at head height), twist (rad), breath (m).
  static constexpr std::size_t modes = 4;
  using Modes = std::array<float, modes>;

  // Each person's is random and stationary from the start: sway and twist are oscillators with
  // critical damping, driven by white noise, covariance (1 + wt) exp(-wt), w = 2 per second, so
  // that the head goes at 1 cm/s; breath is a sine of 0.25 Hz.
  BodyMotion() = default;
  BodyMotion(const Conditions& conditions, std::size_t people, Rng& rng);
  void advance(double time_s, Rng& rng);
  const Modes& of(std::size_t person) const { return modes_[person]; }
  const Modes& speeds_of(std::size_t person) const { return speeds_[person]; }  // per second

  // By how much the range of a patch grows per unit of each mode: direction cosines x/R and y/R,
  // height above the floor, and where the person's axis stands (m, seen from the radar).
  static Modes range_per_mode(double x, double y, double height_m, double axis_x_m, double axis_z_m,
                              double body_scale);

 private:
  struct Oscillator {
    double place = 0, speed = 0;  // of unit variance; speed in units of w
  };
  void set_modes();

  static constexpr std::size_t swaying = 3;
  std::array<double, swaying> rms_{};
  double breath_m_ = 0, time_s_ = 0;
  std::vector<std::array<Oscillator, swaying>> oscillators_;
  std::vector<double> breath_phase_;
  std::vector<Modes> modes_, speeds_;
};

}  // namespace echofuse::sim
