// SPDX-License-Identifier: MIT
#include "sim/sensors/radar_array.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <variant>

#include "drivers/core/axis.hpp"
#include "drivers/core/clones.hpp"
#include "sim/scene/draw.hpp"
#include "sim/scene/room.hpp"
#include "sim/sensors/array_cells.hpp"
#include "sim/sensors/array_kernels.hpp"
#include "sim/sensors/array_parts.hpp"
#include "sim/sensors/body_motion.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/range_nodes.hpp"

namespace echofuse::sim {
namespace {

using Complex = std::complex<double>;

constexpr double pi = std::numbers::pi;

// People, coherent.
class Speckle {
 public:
  Speckle(const Returns& returns, const ArrayRadar& radar, const Conditions& c, Rng& rng)
      : layout_(radar.antennas.size()),
        receivers_(radar.chirp_s > 0 ? radar.receivers : layout_.antennas),
        chirp_s_(radar.chirp_s),
        chirps_(radar.chirps),
        carriers_(radar.carriers_hz.size()) {
    const ArrayCells all = cells_of(returns, {slot_of_cells_m(radar)}, Echoes::of_people);
    motion_ = BodyMotion(c, all.people, rng);
    cells_ = all.cells.size();
    if (cells_ == 0) return;
    for (const double range_m : all.slot_range_m) slots_.push_back(slot_of(range_m, radar.axis));
    range_.emplace(radar.axis, slots_.front(), slots_.back());
    slot_begin_.assign(slots_.size() + 1, cells_);
    rows_.resize(cells_ * layout_.row);
    turns_per_mode_.resize(all.people * BodyMotion::modes * cells_);
    turns_of_carriers_.resize(cells_ * carriers_);
    turns_.resize(cells_), re_.resize(cells_), im_.resize(cells_);
    const auto axes = axes_of(all);
    Waves waves(radar.antennas, layout_);
    for (std::size_t k = cells_; k-- > 0;) {
      const ArrayCell& cell = all.cells[k];
      slot_begin_[cell.slot] = k;
      // A complex Gaussian number has an exponential power and any phase.
      const double power = -cell.weight * std::log(1 - uniform(rng, 0, 1));
      waves.add(static_cast<float>(cell.x), static_cast<float>(cell.y),
                static_cast<float>(std::sqrt(power)), static_cast<float>(uniform(rng, 0, 1)),
                &rows_[k * layout_.row]);
      set_motion(k, cell, axes[static_cast<std::size_t>(cell.person)], c);
      for (std::size_t i = 0; i < carriers_; ++i)
        turns_of_carriers_[k * carriers_ + i] =
            static_cast<float>(turns_of_carrier(cell.range_m, radar.carriers_hz[i]));
    }
    for (const double carrier_hz : radar.carriers_hz)
      faster_.push_back(static_cast<float>(1 + carrier_hz / c.radar_carrier_hz));
  }

  void set_carrier(std::size_t carrier) { carrier_ = carrier; }

  std::size_t state_size() const { return range_ ? range_->count() * layout_.row : 0; }

  void advance(double later_s, Rng& rng, std::span<float> nodes) {
    motion_.advance(later_s, rng);
    std::fill(nodes.begin(), nodes.end(), 0.f);
    if (cells_ == 0) return;
    by_modes(
        [&](std::size_t person) -> auto& { return motion_.of(person); }, turns_);
    if (chirp_s_ > 0)
      by_modes(
          [&](std::size_t person) -> auto& { return motion_.speeds_of(person); }, speeds_);
    if (carriers_ > 1) turn_to_carrier();
    const std::size_t transmitters = (layout_.antennas + receivers_ - 1) / receivers_;
    for (std::size_t t = 0; t < transmitters; ++t) {
      turn(turns_.data(), re_.data(), im_.data(), cells_);
      if (chirp_s_ > 0) {
        const auto apart = static_cast<float>(chirp_s_);
        lose_doppler(speeds_.data(), apart * static_cast<float>(transmitters), chirps_, re_.data(),
                     im_.data(), cells_);
        add_scaled(apart, speeds_.data(), cells_, turns_.data());  // until the next one sends
      }
      const std::size_t first = t * receivers_;
      add_cells(first, std::min(first + receivers_, layout_.antennas), nodes);
    }
  }

  void add(std::size_t block, std::span<const float> nodes, float* planes) const {
    if (range_) range_->respond(block, nodes.data(), layout_.row, planes);
  }

 private:
  // sum of what each mode, of each person, makes of each cell
  template <class Of>
  void by_modes(Of of, std::vector<float>& cells) const {
    cells.assign(cells_, 0.f);
    for (std::size_t i = 0; i < turns_per_mode_.size() / cells_; ++i)
      add_scaled(of(i / BodyMotion::modes)[i % BodyMotion::modes], &turns_per_mode_[i * cells_],
                 cells_, cells.data());
  }

  // Half a resolution's eighth (RangeNodes); with carriers so that the phases within a cell differ
  // by 1 rad at most from one carrier to the next.
  static double slot_of_cells_m(const ArrayRadar& radar) {
    const double slot_m = radar.axis.resolution_m / RangeNodes::slots_per_cell;
    if (radar.carriers_hz.size() < 2) return slot_m;
    const double step_hz = radar.carriers_hz[1] - radar.carriers_hz[0];
    return std::min(slot_m, speed_of_light_m_s / (4 * pi * std::max(step_hz, 1.0)));
  }

  void turn_to_carrier() {
    for (std::size_t k = 0; k < cells_; ++k)
      turns_[k] = turns_[k] * faster_[carrier_] + turns_of_carriers_[k * carriers_ + carrier_];
    for (float& speed : speeds_) speed *= faster_[carrier_];
  }

  // As seen by antennas first..end-1.
  void add_cells(std::size_t first, std::size_t end, std::span<float> nodes) const {
    std::vector<float> sum(layout_.row);
    for (std::size_t s = 0; s < slots_.size(); ++s) {
      std::fill(sum.begin(), sum.end(), 0.f);
      const std::size_t k = slot_begin_[s];
      add_turned(&rows_[k * layout_.row], &re_[k], &im_[k], slot_begin_[s + 1] - k, layout_.padded,
                 sum.data());
      for (std::size_t m = 0; m < layout_.antennas; ++m)
        if (m < first || m >= end) sum[m] = sum[layout_.padded + m] = 0;
      range_->share(slots_[s], sum.data(), layout_.row, nodes.data());
    }
  }

  void set_motion(std::size_t k, const ArrayCell& cell, const std::array<double, 2>& axis,
                  const Conditions& c) {
    const double turns_per_m = -2 * c.radar_carrier_hz / speed_of_light_m_s;
    const auto range =
        BodyMotion::range_per_mode(cell.x, cell.y, cell.height_m, axis[0], axis[1], c.target_scale);
    for (std::size_t i = 0; i < range.size(); ++i)
      turns_per_mode_[(static_cast<std::size_t>(cell.person) * range.size() + i) * cells_ + k] =
          static_cast<float>(turns_per_m) * range[i];
  }
  // Where each person's upright axis stands: the centre of what the radar sees.
  static std::vector<std::array<double, 2>> axes_of(const ArrayCells& all) {
    std::vector<std::array<double, 3>> sums(all.people);
    for (const ArrayCell& c : all.cells) {
      auto& sum = sums[static_cast<std::size_t>(c.person)];
      const double z = std::sqrt(std::max(0.0, 1 - c.x * c.x - c.y * c.y));
      sum[0] += c.weight;
      sum[1] += c.weight * c.range_m * c.x;
      sum[2] += c.weight * c.range_m * z;
    }
    std::vector<std::array<double, 2>> axes;
    for (const auto& [weight, x, z] : sums) axes.push_back({x / weight, z / weight});
    return axes;
  }

  Layout layout_;
  std::size_t receivers_;
  double chirp_s_;
  std::int64_t chirps_;
  std::size_t carriers_, carrier_ = 0;
  BodyMotion motion_;
  std::size_t cells_ = 0;
  std::vector<std::size_t> slots_, slot_begin_;  // numbers; first cells, and the end
  std::optional<RangeNodes> range_;
  // Of each cell: its row, and for each mode of each person by how much it turns.
  std::vector<float> rows_, turns_per_mode_, turns_, speeds_, re_, im_;
  // Of each cell and carrier: by how much it is ahead. Of each carrier: by how much faster it
  // turns.
  std::vector<float> turns_of_carriers_, faster_;
};

// People and the room, incoherent: x = L q with L L^H the covariance and q over any `frames` frames
// orthonormal.
class Expectation {
 public:
  Expectation(const Returns& returns, const ArrayRadar& radar, const Conditions& c)
      : layout_(radar.antennas.size()),
        frames_(c.radar_frames * static_cast<std::int64_t>(radar.carriers_hz.size())) {
    const std::size_t n = layout_.antennas;
    const double slot_m = radar.axis.resolution_m / RangeNodes::slots_per_cell;
    const ArrayCells all = cells_of(returns, {slot_m}, Echoes::of_people_and_room);
    std::vector<Complex> of_slots(all.slot_range_m.size() * n * n);
    for (const ArrayCell& cell : all.cells) {
      const auto wave = wave_at(radar.antennas, cell.x, cell.y);
      Complex* out = &of_slots[cell.slot * n * n];
      for (std::size_t a = 0; a < n; ++a)
        for (std::size_t b = 0; b <= a; ++b)
          out[a * n + b] += cell.weight * wave[a] * std::conj(wave[b]);
    }
    std::vector<Complex> covariance(radar.axis.count * n * n);
    const RangeResponse response(radar.axis);
    std::vector<double> psf;
    for (std::size_t slot = 0; slot < all.slot_range_m.size(); ++slot) {
      response.at(all.slot_range_m[slot] / radar.axis.resolution_m, psf);
      for (std::size_t i = 0; i < psf.size(); ++i) {
        if (std::abs(psf[i]) < 1e-4) continue;
        for (std::size_t e = 0; e < n * n; ++e)
          covariance[i * n * n + e] += psf[i] * psf[i] * of_slots[slot * n * n + e];
      }
    }
    roots_.resize(blocks_of(radar.axis) * root_size());
    for (std::size_t i = 0; i < radar.axis.count; ++i)
      put_root({&covariance[i * n * n], n * n}, &roots_[i / lanes * root_size() + i % lanes]);
  }

  std::size_t state_size() const { return 2 * layout_.antennas; }

  void advance(std::span<float> q) {
    // Quadratic phases: successive frames, and their mean, are as of independent looks (Chu, IEEE
    // Trans. Inf. Theory 18, 531, 1972).
    const std::size_t n = layout_.antennas;
    const std::int64_t f = frame_ % frames_;
    const std::int64_t apart = frames_ / static_cast<std::int64_t>(n);
    for (std::size_t a = 0; a < n; ++a) {
      const auto half_turns = f * (f + frames_ % 2 + 2 * apart * static_cast<std::int64_t>(a));
      const auto wave = std::polar(
          1.0, pi * static_cast<double>(half_turns % (2 * frames_)) / static_cast<double>(frames_));
      q[a] = static_cast<float>(wave.real());
      q[n + a] = static_cast<float>(wave.imag());
    }
    ++frame_;
  }

  void add(std::size_t block, std::span<const float> q, float* planes) const {
    multiply_root(&roots_[block * root_size()], q.data(), layout_.antennas, layout_.padded, planes);
  }

 private:
  std::size_t root_size() const { return layout_.antennas * (layout_.antennas + 1) * lanes; }

  // Cholesky's. A covariance of fewer sources than antennas has pivots that are nothing but
  // rounding: their columns are 0.
  void put_root(std::span<Complex> c, float* out) const {
    const std::size_t n = layout_.antennas;
    double trace = 0;
    for (std::size_t a = 0; a < n; ++a) trace += c[a * n + a].real();
    for (std::size_t b = 0; b < n; ++b) {
      for (std::size_t a = b; a < n; ++a)
        for (std::size_t k = 0; k < b; ++k) c[a * n + b] -= c[a * n + k] * std::conj(c[b * n + k]);
      const double pivot = c[b * n + b].real();
      const double scale = pivot > 1e-12 * trace ? 1 / std::sqrt(pivot) : 0;
      for (std::size_t a = b; a < n; ++a) c[a * n + b] *= scale;
    }
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = 0; b <= a; ++b, out += 2 * lanes) {
        out[0] = static_cast<float>(c[a * n + b].real());
        out[lanes] = static_cast<float>(c[a * n + b].imag());
      }
  }

  Layout layout_;
  std::int64_t frames_, frame_ = 0;
  std::vector<float> roots_;  // by blocks (array_kernels.hpp)
};

}  // namespace

struct ArrayEcho::State {
  Layout layout;
  std::size_t points, blocks;
  std::vector<float> still;  // planes of all blocks, for each carrier
  std::variant<Speckle, Expectation> moving;
  std::vector<float> now, planes;  // of frame()
  std::vector<std::complex<float>> drift{};
  std::size_t carrier = 0;
};

ArrayEcho::ArrayEcho(const Returns& returns, const ArrayRadar& radar, const Conditions& c,
                     Rng& rng) {
  const Layout layout(radar.antennas.size());
  const std::size_t blocks = blocks_of(radar.axis);
  std::vector<float> still(radar.room.begin(), radar.room.end());
  still.resize(radar.carriers_hz.size() * blocks * layout.planes());
  add_points(returns, radar, still);
  const bool coherent = c.radar_sum == "coherent";
  if (coherent) add_still(returns, radar, still);
  using Moving = std::variant<Speckle, Expectation>;
  state_ = std::make_unique<State>(State{
      layout,
      radar.axis.count,
      blocks,
      std::move(still),
      coherent ? Moving(Speckle(returns, radar, c, rng)) : Moving(Expectation(returns, radar, c)),
      {},
      std::vector<float>(layout.planes())});
  state_->now.resize(state_size());
}
ArrayEcho::~ArrayEcho() = default;
ArrayEcho::ArrayEcho(ArrayEcho&&) noexcept = default;
ArrayEcho& ArrayEcho::operator=(ArrayEcho&&) noexcept = default;

std::size_t ArrayEcho::samples() const { return state_->points * state_->layout.antennas; }
std::size_t ArrayEcho::blocks() const { return state_->blocks; }
std::size_t ArrayEcho::planes_size() const { return state_->layout.planes(); }
std::size_t ArrayEcho::imaginary_plane() const { return state_->layout.padded * lanes; }
std::size_t ArrayEcho::state_size() const {
  return std::visit([](const auto& moving) { return moving.state_size(); }, state_->moving);
}

void ArrayEcho::advance(double later_s, Rng& rng, std::span<float> state) {
  if (auto* speckle = std::get_if<Speckle>(&state_->moving))
    speckle->advance(later_s, rng, state);
  else
    std::get<Expectation>(state_->moving).advance(state);
}

void ArrayEcho::look(std::size_t block, std::span<const float> state,
                     std::span<float> planes) const {
  const std::size_t at = (state_->carrier * state_->blocks + block) * planes.size();
  const auto still = state_->still.begin() + static_cast<std::ptrdiff_t>(at);
  std::copy_n(still, planes.size(), planes.begin());
  std::visit([&](const auto& moving) { moving.add(block, state, planes.data()); }, state_->moving);
  const auto& drift = state_->drift;
  for (std::size_t m = 0; m < drift.size(); ++m)
    turn_planes(drift[m].real(), drift[m].imag(), &planes[m * lanes],
                &planes[imaginary_plane() + m * lanes]);
}

void ArrayEcho::set_carrier(std::size_t carrier) {
  state_->carrier = carrier;
  if (auto* speckle = std::get_if<Speckle>(&state_->moving)) speckle->set_carrier(carrier);
}

void ArrayEcho::set_drift(std::span<const double> phases) {
  state_->drift.clear();
  for (const double phase : phases) state_->drift.emplace_back(std::polar(1.0, phase));
}

void ArrayEcho::frame(double later_s, Rng& rng, std::span<std::complex<float>> samples) {
  const std::size_t n = state_->layout.antennas;
  const auto& planes = state_->planes;
  advance(later_s, rng, state_->now);
  for (std::size_t i = 0; i < state_->points; ++i) {
    if (i % lanes == 0) look(i / lanes, state_->now, state_->planes);
    for (std::size_t m = 0; m < n; ++m)
      samples[i * n + m] = {planes[m * lanes + i % lanes],
                            planes[imaginary_plane() + m * lanes + i % lanes]};
  }
}

std::vector<float> room_echo(const ArrayRadar& radar, const Conditions& c) {
  std::vector<float> planes(radar.carriers_hz.size() * blocks_of(radar.axis) *
                            Layout(radar.antennas.size()).planes());
  add_still(radar_returns(empty_room(*room_named(c.background)), c), radar, planes);
  return planes;
}

}  // namespace echofuse::sim
