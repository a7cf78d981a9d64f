// SPDX-License-Identifier: MIT
#include "sim/sensors/radar_echo.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "drivers/core/axis.hpp"
#include "drivers/core/clones.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {
namespace {

constexpr double pi = std::numbers::pi;

constexpr int many_frames = 60;

// Computes sinc(u) for all u = cells[i] - cell, from the sines and cosines of pi cells[i] and of pi
// cell.
ECHOFUSE_CLONES void sincs(const double* cells, const double* sines, const double* cosines,
                           double cell, double sine, double cosine, double* __restrict out,
                           std::size_t count) {
  for (std::size_t i = 0; i < count; ++i)
    out[i] = (sines[i] * cosine - cosines[i] * sine) / (pi * (cells[i] - cell));
}
ECHOFUSE_CLONES void to_windowed(const double* cells, double cell, const Psf::Windowed& windowed,
                                 double* __restrict out, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const double u = cells[i] - cell;
    out[i] *= windowed(u * u);
  }
}

ECHOFUSE_CLONES void add_squared(double weight, const double* psf, double* __restrict power,
                                 std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) power[i] += weight * psf[i] * psf[i];
}

// Echoes on a range grid much finer than the resolution. Each echo is split linearly between its
// two neighbouring points, so the echoes of a whole room are processed as quickly as a few hundred
// points. The interpolation of the psf has an error of 5e-5 of its peak.
template <class Value>
class FineEcho {
 public:
  FineEcho(const Returns& returns, double resolution_m) : points_m_(resolution_m / per_cell) {
    const double farthest = returns.range_m.empty()
                                ? 0
                                : *std::max_element(returns.range_m.begin(), returns.range_m.end());
    values_.resize(static_cast<std::size_t>(std::max(0.0, farthest) / points_m_) + 2);
  }
  void add(double range_m, Value value) {
    if (range_m < 0) return;
    const double place = range_m / points_m_;
    const auto i = static_cast<std::size_t>(place);
    const double rest = place - static_cast<double>(i);
    values_[i] += (1 - rest) * value;
    values_[i + 1] += rest * value;
  }
  // Calls visit(value, psf) for each grid point with an echo. `psf` is the response of this echo at
  // all points of the axis.
  template <class Visit>
  void for_each(const RadarAxis& axis, Visit visit) const {
    const RangeResponse response(axis);
    std::vector<double> psf;
    for (std::size_t k = 0; k < values_.size(); ++k) {
      if (values_[k] == Value{}) continue;
      response.at(static_cast<double>(k) / per_cell, psf);
      visit(values_[k], psf);
    }
  }

 private:
  static constexpr double per_cell = 128;
  double points_m_;
  std::vector<Value> values_;
};

}  // namespace

RangeResponse::RangeResponse(const RadarAxis& axis)
    : psf_(axis.psf), cells_per_point_(axis.step_m / axis.resolution_m) {
  for (std::uint32_t i = 0; i < axis.count; ++i) {
    cells_.push_back((axis.start_m + i * axis.step_m) / axis.resolution_m);
    sines_.push_back(std::sin(pi * cells_.back()));
    cosines_.push_back(std::cos(pi * cells_.back()));
  }
}

void RangeResponse::at(double cell, std::vector<double>& psf) const {
  psf.resize(cells_.size());
  if (psf.empty()) return;
  if (!psf_.taps.empty()) {
    for (std::size_t i = 0; i < psf.size(); ++i) psf[i] = psf_.at(cells_[i] - cell);
    return;
  }
  // Derives sin(pi (u_i - u)) from the sines and cosines of both angles, because computing each
  // sine would dominate the run time.
  const double sine = std::sin(pi * cell), cosine = std::cos(pi * cell);
  sincs(cells_.data(), sines_.data(), cosines_.data(), cell, sine, cosine, psf.data(), psf.size());
  if (psf_.first != 0) to_windowed(cells_.data(), cell, psf_.windowed(), psf.data(), psf.size());
  // Recomputes the points where the formula is 0 / 0.
  for (int order = -2; order <= 2; ++order) {
    const double point = std::round((cell + order - cells_[0]) / cells_per_point_);
    if (!(point >= 0 && point < static_cast<double>(psf.size()))) continue;
    const auto i = static_cast<std::size_t>(point);
    const double u = cells_[i] - cell;
    if (std::abs(u - order) < Psf::nearest)
      psf[i] = psf_.at_sine(u, sines_[i] * cosine - cosines_[i] * sine);
  }
}

std::vector<double> radar_power(const Returns& returns, const RadarAxis& axis) {
  FineEcho<double> echo(returns, axis.resolution_m);
  for (std::size_t k = 0; k < returns.range_m.size(); ++k)
    echo.add(returns.range_m[k], returns.weight[k]);
  std::vector<double> power(axis.count);
  echo.for_each(axis, [&](double weight, const std::vector<double>& psf) {
    add_squared(weight, psf.data(), power.data(), psf.size());
  });
  return power;
}

double mean_peak_power(const RadarAxis& axis, const Conditions& c) {
  constexpr std::uint64_t scenes = 64, seed = 0;
  Conditions base;
  base.baseline_m = c.baseline_m;
  double sum = 0;
  for (std::uint64_t i = 0; i < scenes; ++i) {
    const Scene scene =
        make_scene(base, i % 4 == 0 ? SceneKind::person : SceneKind::letter, seed, i);
    const auto power = radar_power(radar_returns(scene, base), axis);
    sum += *std::max_element(power.begin(), power.end());
  }
  return sum / scenes;
}

double radar_noise_power(const Conditions& c, double mean_peak) {
  return std::pow(10, -c.radar_snr_db / 10) * mean_peak;
}

double profile_noise(const Conditions& c, double mean_peak, std::int64_t frames) {
  return radar_noise_power(c, mean_peak) * std::sqrt(many_frames / static_cast<double>(frames));
}

void add_profile_noise(std::vector<double>& power, double mean_peak, const Conditions& c,
                       std::int64_t frames, Rng& rng) {
  const double rms = profile_noise(c, mean_peak, frames);
  if (frames >= many_frames) {
    std::normal_distribution<double> noise(0, rms);
    for (double& p : power) p += noise(rng);
    return;
  }
  const auto looks = static_cast<double>(frames);
  std::gamma_distribution<double> noise(looks, rms / std::sqrt(looks));
  for (double& p : power) p += noise(rng) - rms * std::sqrt(looks);
}

void add_frame_noise(std::vector<double>& power, double mean_peak, const Conditions& c, Rng& rng) {
  std::exponential_distribution<double> noise(1 / profile_noise(c, mean_peak, 1));
  for (double& p : power) p += noise(rng);
}

}  // namespace echofuse::sim
