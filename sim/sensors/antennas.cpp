// SPDX-License-Identifier: MIT
#include "sim/sensors/antennas.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "drivers/core/clones.hpp"
#include "sim/sensors/gaussian.hpp"

namespace echofuse::sim {

using record::Antennas;

Antennas antennas_in_layout(std::size_t count) {
  Antennas antennas(count);
  if (count <= 8) {
    for (std::size_t m = 0; m < count; ++m) antennas[m].x = static_cast<double>(m);
    return antennas;
  }
  constexpr std::array<std::array<double, 2>, 3> transmitters{{{0, 0}, {2, 2}, {0, 2}}};
  constexpr std::array<std::array<double, 2>, 4> receivers{{{1, 1}, {1, 0}, {0, 1}, {0, 0}}};
  for (std::size_t m = 0; m < count; ++m) {
    const auto &t = transmitters[m / 4 % 3], &r = receivers[m % 4];
    antennas[m].x = t[0] + r[0];
    antennas[m].y = t[1] + r[1];
  }
  return antennas;
}

Antennas simulated_antennas(const Conditions& c, std::uint64_t seed) {
  Antennas antennas = antennas_in_layout(static_cast<std::size_t>(c.radar_antennas));
  Rng rng = make_rng(seed, 0);
  std::normal_distribution<double> unit;
  for (auto& a : antennas) {
    a.phase_rad = c.radar_phase_error_rad * unit(rng);
    a.gain = std::pow(10, c.radar_gain_error_db * unit(rng) / 20);
  }
  return antennas;
}

Antennas stated_antennas(const Antennas& antennas, const Conditions& c) {
  return c.radar_array_calibrated ? antennas : antennas_in_layout(antennas.size());
}

namespace {

constexpr double pi = std::numbers::pi;
constexpr double sway_rate = 2;       // natural frequency of sway and twist, rad/s
constexpr double breath_rate = 0.25;  // frequency of breathing, Hz
// Heights of the head and the chest of an average person, and half the height of the moving part of
// the chest, m.
constexpr double head_m = 1.65, chest_m = 1.25, chest_half_m = 0.3;

}  // namespace

BodyMotion::BodyMotion(const Conditions& c, std::size_t people, Rng& rng)
    : rms_{c.radar_sway_m, c.radar_sway_m, c.radar_twist_deg * pi / 180},
      breath_m_(c.radar_breath_m),
      oscillators_(people),
      breath_phase_(people),
      places_(people),
      speeds_(people) {
  std::normal_distribution<double> unit;
  std::uniform_real_distribution<double> phase(0, 2 * pi);
  for (std::size_t p = 0; p < people; ++p) {
    for (Oscillator& o : oscillators_[p]) o = {unit(rng), unit(rng)};
    breath_phase_[p] = phase(rng);
  }
  set_modes();
}

// Advances all motions by time_s; exact for any time step. With t = sway_rate * time_s, the mean of
// (position, speed) is exp(-t) [[1 + t, t], [-t, 1 - t]] times the previous value. The random terms
// restore the stationary covariance, which is the identity matrix.
void BodyMotion::advance(double time_s, Rng& rng) {
  const double t = sway_rate * time_s, decay = std::exp(-t);
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
  for (std::size_t p = 0; p < places_.size(); ++p) {
    for (std::size_t i = 0; i < swaying; ++i) {
      places_[p][i] = static_cast<float>(rms_[i] * oscillators_[p][i].place);
      speeds_[p][i] = static_cast<float>(rms_[i] * sway_rate * oscillators_[p][i].speed);
    }
    const double turning = 2 * pi * breath_rate, angle = turning * time_s_ + breath_phase_[p];
    places_[p][swaying] = static_cast<float>(breath_m_ * std::sin(angle));
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

namespace {

using Eigen::Index;
using Eigen::MatrixXcf;
using Eigen::MatrixXf;

void add_patch(EchoCell& cell, const Returns& returns, std::size_t k) {
  const Returns::PatchOrigin& p = returns.place[k];
  const double w = returns.weight[k];
  cell.weight += w;
  cell.range_m += w * returns.range_m[k];
  cell.x += w * p.x;
  cell.y += w * p.y;
  cell.height_m += w * p.height_m;
  cell.person = p.person;
}

void divide(EchoCell& cell) {
  for (double* sum : {&cell.range_m, &cell.x, &cell.y, &cell.height_m}) *sum /= cell.weight;
}

}  // namespace

EchoCell cell_of_kind(const Returns& returns, std::int32_t kind) {
  EchoCell cell;
  for (std::size_t k = 0; k < returns.place.size(); ++k)
    if (returns.place[k].person == kind) add_patch(cell, returns, k);
  if (cell.weight > 0) divide(cell);
  return cell;
}

EchoCells echo_cells(const Returns& returns, double slot_m, bool with_room) {
  constexpr double cosine = 0.03, height_m = 0.1;
  EchoCells out;
  std::vector<std::size_t> patches;
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    const std::int32_t person = returns.place[k].person;
    if ((person >= 0 || (person == Returns::still && with_room)) && returns.weight[k] > 0 &&
        returns.range_m[k] > 0)
      patches.push_back(k);
  }
  if (patches.empty()) return out;
  // Numbers the cells by range, person, height and direction within the bounding box of all
  // patches, so that the cells of a slot have consecutive numbers.
  Eigen::Array4Xi keys(4, static_cast<Index>(patches.size()));
  for (Index i = 0; i < keys.cols(); ++i) {
    const std::size_t k = patches[static_cast<std::size_t>(i)];
    const Returns::PatchOrigin& p = returns.place[k];
    keys.col(i) << static_cast<int>(std::floor(returns.range_m[k] / slot_m)), p.person,
        static_cast<int>(std::floor(p.height_m / height_m)),
        static_cast<int>(std::floor(p.x / cosine));
  }
  const Eigen::Array4i low = keys.rowwise().minCoeff();
  const Eigen::Array4i span = keys.rowwise().maxCoeff() - low + 1;
  const auto number = [&](Index i) {
    std::size_t n = 0;
    for (Index d = 0; d < 4; ++d)
      n = n * static_cast<std::size_t>(span[d]) + static_cast<std::size_t>(keys(d, i) - low[d]);
    return n;
  };
  std::size_t box = 1;
  for (const int edge : span) box *= static_cast<std::size_t>(edge);
  constexpr std::uint32_t none = UINT32_MAX;
  std::vector<std::uint32_t> cell_at(box, none);
  for (Index i = 0; i < keys.cols(); ++i) cell_at[number(i)] = 0;
  std::uint32_t cells = 0;
  for (std::uint32_t& cell : cell_at)
    if (cell != none) cell = cells++;
  out.cells.resize(cells);
  for (Index i = 0; i < keys.cols(); ++i)
    add_patch(out.cells[cell_at[number(i)]], returns, patches[static_cast<std::size_t>(i)]);
  double weight = 0, slot_before = -1;
  for (std::size_t k = 0; k < out.cells.size(); ++k) {
    EchoCell& cell = out.cells[k];
    divide(cell);
    out.people = std::max(out.people, static_cast<std::size_t>(cell.person + 1));
    const double slot = std::floor(cell.range_m / slot_m);
    if (slot != slot_before) {
      if (k > 0) out.slot_range_m.back() /= weight;
      out.slot_range_m.push_back(0);
      out.begin.push_back(k);
      weight = 0;
    }
    slot_before = slot;
    out.slot_range_m.back() += cell.weight * cell.range_m;
    weight += cell.weight;
  }
  out.slot_range_m.back() /= weight;
  out.begin.push_back(out.cells.size());
  return out;
}

AntennaRecord antenna_record(const Returns& returns, const AntennaRadar& radar,
                             std::size_t kept_bins, const Conditions& c, double noise_power,
                             Rng& rng) {
  const std::size_t antennas = radar.antennas.size(), points = radar.axis.count;
  const auto frames = static_cast<std::size_t>(c.radar_frames);
  const double later_s = c.window_s / static_cast<double>(frames);
  const auto rms = static_cast<float>(std::sqrt(noise_power / 2));
  AntennaEcho echo(returns, radar, c, rng);
  // The memory is reused for the next record, because allocating it would take half as long as this
  // simulation.
  thread_local std::vector<std::complex<float>> samples;
  samples.resize(frames * echo.samples());
  for (std::size_t f = 0; f < frames; ++f)
    echo.frame(later_s, rng, std::span(samples).subspan(f * echo.samples(), echo.samples()));
  GaussianNoise noise(rng);
  AntennaRecord out;
  out.array.reserve(kept_bins * record::values_of_bin(antennas));
  const auto n = static_cast<Index>(antennas);
  // Samples of one frame in the layout expected by ArrayStatistics::add_planes().
  Eigen::Array<float, lanes, Eigen::Dynamic> planes(lanes, 2 * n);
  const std::span re(planes.data(), lanes * antennas), im(re.data() + re.size(), re.size());
  // Range points are processed in blocks, so that the statistics of a block stay in the cache
  // during all frames.
  for (std::size_t first = 0; first < points; first += lanes) {
    const std::size_t bins = std::min(lanes, points - first);
    const auto rows = static_cast<Index>(bins);
    record::ArrayStatistics sums(bins, antennas);
    planes.setZero();
    for (std::size_t f = 0; f < frames; ++f) {
      const Eigen::Map<const MatrixXcf> block(&samples[f * echo.samples() + first * antennas], n,
                                              rows);
      planes.topLeftCorner(rows, n) = block.real().transpose();
      planes.topRightCorner(rows, n) = block.imag().transpose();
      noise.add(re, rms);
      noise.add(im, rms);
      sums.add_planes(re.data(), im.data());
    }
    const auto array = sums.take();
    for (std::size_t i = 0; i < bins; ++i) {
      const auto bin = record::bin_of(array, antennas, i);
      out.power.push_back(double{bin.power()} / static_cast<double>(antennas));
      if (first + i < kept_bins)
        out.array.insert(out.array.end(), bin.values.begin(), bin.values.end());
    }
  }
  return out;
}

}  // namespace echofuse::sim
