// SPDX-License-Identifier: MIT
// Radar profile relative to the range of a body.
#include <algorithm>
#include <array>
#include <cmath>

#include "recon/method/alignment.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double farthest_steps = 1e9;  // maximum distance from the first radar point, in steps

// Returns the weights of the points around a position, from `profile_taps` - 1 points before it to
// `profile_taps` points after it. The position is a fraction `part` of a step after a point. Only
// two sines and a cosine are computed, because the points are whole steps apart.
std::array<float, 2 * profile_taps> lanczos(double part) {
  struct Turn {
    double sine, cosine;
  };
  static const auto turns = [] {
    std::array<Turn, 2 * profile_taps> out;
    for (std::size_t k = 0; k < out.size(); ++k) {
      const double turn = M_PI * static_cast<double>(k) / static_cast<double>(profile_taps);
      out[k] = {std::sin(turn), std::cos(turn)};
    }
    return out;
  }();
  const double before = part + static_cast<double>(profile_taps - 1);
  const double first = M_PI * before / static_cast<double>(profile_taps);
  const double sine = std::sin(first), cosine = std::cos(first);
  double of_series = std::sin(M_PI * part) * (profile_taps % 2 ? 1 : -1);
  std::array<float, 2 * profile_taps> out;
  for (std::size_t k = 0; k < out.size(); ++k, of_series = -of_series) {
    const double x = before - static_cast<double>(k);
    const double of_window = sine * turns[k].cosine - cosine * turns[k].sine;
    out[k] = static_cast<float>(std::abs(x) < 1e-6
                                    ? 1
                                    : of_series * of_window * static_cast<double>(profile_taps) /
                                          (M_PI * M_PI * x * x));
  }
  return out;
}

}  // namespace

// Interpolates the recorded profile, without summing it into wider bins. The amplitude has
// resolution c/2B, and the power has twice the bandwidth of the amplitude. Steps of half this
// resolution therefore sample the power completely, and a sinc series interpolates it. A Lanczos
// window truncates the series. All points at the same fraction of a step have the same weights.
void Alignment::profile_about(double range_m, std::span<const float> power,
                              std::span<float> points) const {
  std::fill(points.begin(), points.end(), 0.f);
  add_profile(range_m, power, points);
  share_out(points);
}

void Alignment::add_profile(double range_m, std::span<const float> power,
                            std::span<float> out) const {
  std::vector<float> sums;  // interpolated powers of the points at the same fraction of a step
  for (std::ptrdiff_t kind = 0; kind < points_a_step_; ++kind) {
    const double metres =
        range_m + method::profile_from_m + static_cast<double>(kind) * profile_step_m_;
    const double a =
        std::clamp((metres - radar_first_m_) / radar_step_m_, -farthest_steps, farthest_steps);
    const auto weights = lanczos(a - std::floor(a));
    const auto first = static_cast<std::ptrdiff_t>(std::floor(a)) - profile_taps + 1;
    const auto count = (std::ssize(out) - kind + points_a_step_ - 1) / points_a_step_;
    sums.assign(static_cast<std::size_t>(count), 0.f);
    for (std::ptrdiff_t k = 0; k < 2 * profile_taps; ++k) {
      const float weight = weights[static_cast<std::size_t>(k)];
      // Limits j so that first + k + j * step is a recorded point.
      const std::ptrdiff_t at = first + k, step = steps_a_point_;
      const auto from = at < 0 ? (step - 1 - at) / step : 0;
      const auto to = std::min(count, (std::ssize(power) - at + step - 1) / step);
      for (auto j = from; j < to; ++j)
        sums[static_cast<std::size_t>(j)] +=
            weight * power[static_cast<std::size_t>(at + j * step)];
    }
    for (std::size_t j = 0; j < sums.size(); ++j)
      out[static_cast<std::size_t>(kind) + j * static_cast<std::size_t>(points_a_step_)] += sums[j];
  }
}

std::vector<float> Alignment::above_background(std::span<const float> recorded_power) const {
  std::vector<float> out(recorded_power.begin(), recorded_power.end());
  const auto background = parts(background_).power;
  for (std::size_t i = 0; i < out.size(); ++i) out[i] -= background[i];
  return out;
}

void Alignment::add_profiles(std::span<const MovedProfile> profiles, std::span<float> view) const {
  const AlignmentColumns at = columns(view);
  std::fill(at.profile.begin(), at.profile.end(), 0.f);
  for (const auto& [recorded_power, farther_m] : profiles)
    add_profile(double{at.range_m} - farther_m, above_background(recorded_power), at.profile);
  share_out(at.profile);
}

void Alignment::move_profile(std::span<const float> recorded_power, double farther_m,
                             std::span<float> view) const {
  const AlignmentColumns at = columns(view);
  profile_about(double{at.range_m} - farther_m, above_background(recorded_power), at.profile);
  correlate(at.histogram, at.profile, at.correlation);
}

double Alignment::displacement_m(std::span<const float> view) const {
  const auto profile = columns(view).profile;
  double sum = 0, moment = 0;
  for (std::size_t j = 0; j < profile.size(); ++j) {
    const double square = double{profile[j]} * double{profile[j]};
    sum += square, moment += square * static_cast<double>(j);
  }
  return method::profile_from_m + (sum > 0 ? moment / sum : 0) * profile_step_m_;
}

}  // namespace echofuse::recon
