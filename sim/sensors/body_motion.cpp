// SPDX-License-Identifier: MIT
#include "sim/sensors/body_motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double rate = 2;            // 1/s, of sway and twist
constexpr double breath_rate = 0.25;  // Hz
// Of a person of middle height
constexpr double head_m = 1.65, chest_m = 1.25, chest_half_m = 0.3;

}  // namespace

BodyMotion::BodyMotion(const Conditions& c, std::size_t people, Rng& rng)
    : rms_{c.radar_sway_m, c.radar_sway_m, c.radar_twist_deg * pi / 180},
      breath_m_(c.radar_breath_m),
      oscillators_(people),
      breath_phase_(people),
      modes_(people),
      speeds_(people) {
  std::normal_distribution<double> unit;
  std::uniform_real_distribution<double> phase(0, 2 * pi);
  for (std::size_t p = 0; p < people; ++p) {
    for (Oscillator& o : oscillators_[p]) o = {unit(rng), unit(rng)};
    breath_phase_[p] = phase(rng);
  }
  set_modes();
}

// Exact for any step: mean exp(-wt) [[1 + wt, wt], [-wt, 1 - wt]] of place and speed, and the
// covariance that is missing to the stationary one, which is the identity.
void BodyMotion::advance(double time_s, Rng& rng) {
  const double t = rate * time_s, decay = std::exp(-t);
  const double a = decay * (1 + t), b = decay * t, d = decay * (1 - t);
  const double placed = std::sqrt(std::max(0.0, 1 - a * a - b * b));
  const double shared = placed > 0 ? (a * b - b * d) / placed : 0;
  const double free = std::sqrt(std::max(0.0, 1 - b * b - d * d - shared * shared));
  std::normal_distribution<double> unit;
  for (auto& person : oscillators_)
    for (Oscillator& o : person) {
      const double first = unit(rng), second = unit(rng);
      o = {a * o.place + b * o.speed + placed * first,
           -b * o.place + d * o.speed + shared * first + free * second};
    }
  time_s_ += time_s;
  set_modes();
}

void BodyMotion::set_modes() {
  for (std::size_t p = 0; p < modes_.size(); ++p) {
    for (std::size_t i = 0; i < swaying; ++i) {
      modes_[p][i] = static_cast<float>(rms_[i] * oscillators_[p][i].place);
      speeds_[p][i] = static_cast<float>(rms_[i] * rate * oscillators_[p][i].speed);
    }
    const double turning = 2 * pi * breath_rate, angle = turning * time_s_ + breath_phase_[p];
    modes_[p][swaying] = static_cast<float>(breath_m_ * std::sin(angle));
    speeds_[p][swaying] = static_cast<float>(breath_m_ * turning * std::cos(angle));
  }
}

BodyMotion::Modes BodyMotion::range_per_mode(double x, double y, double height_m, double axis_x_m,
                                             double axis_z_m, double body_scale) {
  const double z = std::sqrt(std::max(0.0, 1 - x * x - y * y));
  const double lever = height_m / (head_m * body_scale);
  const double from_chest = std::abs(height_m / body_scale - chest_m) / chest_half_m;
  const double chest = from_chest < 1 ? (1 + std::cos(pi * from_chest)) / 2 : 0;
  return {static_cast<float>(lever * x), static_cast<float>(lever * z),
          static_cast<float>(z * axis_x_m - x * axis_z_m), static_cast<float>(-chest)};
}

}  // namespace echofuse::sim
