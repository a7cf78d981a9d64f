// SPDX-License-Identifier: MIT
#include "sim/sensors/radar_array.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numbers>
#include <random>
#include <variant>

#include "drivers/core/axis.hpp"
#include "sim/scene/clones.hpp"
#include "sim/sensors/array_cells.hpp"
#include "sim/sensors/body_motion.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {
namespace {

using Complex = std::complex<double>;
using Antennas = record::Antennas;

constexpr double pi = std::numbers::pi;
constexpr double slots_per_cell = 8;  // of range, in a resolution cell

// A wave from this direction at each antenna, as its channel records it.
std::vector<Complex> wave_at(const Antennas& antennas, double x, double y) {
  std::vector<Complex> wave;
  wave.reserve(antennas.size());
  for (const auto& a : antennas)
    wave.push_back(std::polar(a.gain, pi * (a.x * x + a.y * y) + a.phase_rad));
  return wave;
}

// Complex numbers of one point or cell, one for each antenna: all real parts, then all imaginary
// ones, both filled up to a multiple of four.
struct Layout {
  std::size_t antennas, padded, row;

  explicit Layout(std::size_t n) : antennas(n), padded((n + 3) / 4 * 4), row(2 * padded) {}
  void put(const std::vector<Complex>& wave, Complex amplitude, float* out) const {
    for (std::size_t m = 0; m < antennas; ++m) {
      const Complex value = amplitude * wave[m];
      out[m] += static_cast<float>(value.real());
      out[padded + m] += static_cast<float>(value.imag());
    }
  }
};

// exp(2 pi i t) of each; exact to 1e-5.
ECHOFUSE_CLONES void turn(const float* turns, float* re, float* im, std::size_t count) {
  constexpr float rounding = 12582912;  // 1.5 2^23: what is added to it loses its fraction
  for (std::size_t i = 0; i < count; ++i) {
    const float whole = (turns[i] + rounding) - rounding;
    const float x = (turns[i] - whole) * static_cast<float>(pi), q = x * x;  // half the angle
    const float s = x * (1 + q * (-1.f / 6 + q * (1.f / 120 + q * (-1.f / 5040 + q / 362880))));
    const float c =
        1 + q * (-0.5f + q * (1.f / 24 + q * (-1.f / 720 + q * (1.f / 40320 - q / 3628800))));
    re[i] = 1 - 2 * s * s;
    im[i] = 2 * s * c;
  }
}

// Adds (re + i im) times the row of each cell.
ECHOFUSE_CLONES void add_turned(const float* rows, const float* re, const float* im,
                                std::size_t cells, std::size_t padded, float* sum) {
  for (std::size_t k = 0; k < cells; ++k, rows += 2 * padded) {
    const float cosine = re[k], sine = im[k];
    for (std::size_t m = 0; m < padded; ++m) {
      sum[m] += cosine * rows[m] - sine * rows[padded + m];
      sum[padded + m] += cosine * rows[padded + m] + sine * rows[m];
    }
  }
}

// Adds the row to each point's, times the point's response. Eight numbers at a time, which stay in
// a register: rows are a multiple of eight.
ECHOFUSE_CLONES void spread(const float* __restrict response, std::size_t points, const float* row,
                            std::size_t size, float* __restrict out) {
  constexpr std::size_t block = 8;
  for (std::size_t first = 0; first < size; first += block) {
    float part[block];
    for (std::size_t m = 0; m < block; ++m) part[m] = row[first + m];
    float* to = out + first;
    for (std::size_t i = 0; i < points; ++i, to += size)
      for (std::size_t m = 0; m < block; ++m) to[m] += response[i] * part[m];
  }
}

// The points that an echo reaches with more than -80 dB; of a sinc, all.
struct Reached {
  std::size_t first = 0;
  std::vector<float> response;

  void spread_to(float* points, const float* row, std::size_t size) const {
    spread(response.data(), response.size(), row, size, points + first * size);
  }
};
Reached reached_from(double range_m, const RangeResponse& response, const RadarAxis& axis) {
  constexpr float least = 1e-4f;
  Reached out;
  response.at(range_m / axis.resolution_m,
              [&](std::size_t, double psf) { out.response.push_back(static_cast<float>(psf)); });
  const auto counts = [](float psf) { return std::abs(psf) > least; };
  auto& all = out.response;
  all.erase(std::find_if(all.rbegin(), all.rend(), counts).base(), all.end());
  const auto begin = std::find_if(all.begin(), all.end(), counts);
  out.first = static_cast<std::size_t>(begin - all.begin());
  all.erase(all.begin(), begin);
  return out;
}

Complex gaussian(double power, Rng& rng) {
  std::normal_distribution<double> part(0, std::sqrt(power / 2));
  const double re = part(rng);
  return {re, part(rng)};
}

// The same for the same patch, whatever stands before others.
float turns_of_patch(const Returns& returns, std::size_t k, std::uint64_t seed) {
  const auto range = std::bit_cast<std::uint64_t>(returns.range_m[k]);
  const auto x = std::bit_cast<std::uint32_t>(returns.place[k].x);
  const auto y = std::bit_cast<std::uint32_t>(returns.place[k].y);
  return static_cast<float>(mix(seed ^ mix(range ^ mix(x ^ mix(y)))) >> 40) * 0x1p-24f;
}

// Adds one wave after the other, fast.
class Waves {
 public:
  Waves(const Antennas& antennas, const Layout& layout)
      : layout_(layout), turns_(layout.padded), re_(layout.padded), im_(layout.padded) {
    for (const auto& a : antennas)
      channels_.push_back({static_cast<float>(a.x / 2), static_cast<float>(a.y / 2),
                           static_cast<float>(a.phase_rad / (2 * pi)), static_cast<float>(a.gain)});
  }
  void add(float x, float y, float amplitude, float ahead_turns, float* out) {
    for (std::size_t m = 0; m < channels_.size(); ++m) {
      const auto& c = channels_[m];
      turns_[m] = c[0] * x + c[1] * y + c[2] + ahead_turns;
    }
    turn(turns_.data(), re_.data(), im_.data(), turns_.size());
    for (std::size_t m = 0; m < channels_.size(); ++m) {
      out[m] += amplitude * channels_[m][3] * re_[m];
      out[layout_.padded + m] += amplitude * channels_[m][3] * im_[m];
    }
  }

 private:
  Layout layout_;
  std::vector<std::array<float, 4>> channels_;
  std::vector<float> turns_, re_, im_;
};

// What stands still: points, and if coherent the room and objects.
std::vector<float> still_echo(const Returns& returns, const RadarAxis& axis,
                              const Antennas& antennas, bool room, std::uint64_t seed) {
  const Layout layout(antennas.size());
  const RangeResponse response(axis);
  std::vector<float> out(axis.count * layout.row);
  const auto put = [&](double range_m, const float* row) {
    reached_from(range_m, response, axis).spread_to(out.data(), row, layout.row);
  };
  for (const auto kind : {Returns::reflector, Returns::leakage})
    if (const ArrayCell cell = one_cell_of(returns, kind); cell.weight > 0) {
      std::vector<float> row(layout.row);
      layout.put(wave_at(antennas, cell.x, cell.y), std::sqrt(cell.weight), row.data());
      put(cell.range_m, row.data());
    }
  if (!room) return out;
  const double width = axis.resolution_m / (2 * slots_per_cell);
  std::vector<float> slots;
  Waves waves(antennas, layout);
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    const auto& place = returns.place[k];
    if (place.person != Returns::still || returns.range_m[k] <= 0) continue;
    const auto slot = static_cast<std::size_t>(returns.range_m[k] / width);
    slots.resize(std::max(slots.size(), (slot + 1) * layout.row));
    waves.add(place.x, place.y, static_cast<float>(std::sqrt(returns.weight[k])),
              turns_of_patch(returns, k, seed), &slots[slot * layout.row]);
  }
  for (std::size_t slot = 0; slot < slots.size() / layout.row; ++slot) {
    const float* row = &slots[slot * layout.row];
    if (std::any_of(row, row + layout.row, [](float value) { return value != 0; }))
      put((static_cast<double>(slot) + 0.5) * width, row);
  }
  return out;
}

// People, coherent.
class Speckle {
 public:
  Speckle(const Returns& returns, const RadarAxis& axis, const Antennas& antennas,
          const Conditions& c, Rng& rng)
      : layout_(antennas.size()) {
    const ArrayCells all =
        cells_of(returns, {axis.resolution_m / slots_per_cell}, Echoes::of_people);
    motion_ = BodyMotion(c, all.people, rng);
    const RangeResponse response(axis);
    for (const double range_m : all.slot_range_m)
      slots_.push_back(reached_from(range_m, response, axis));
    rows_.resize(all.cells.size() * layout_.row);
    const auto axes = axes_of(all);
    const double turns_per_m = -2 * c.radar_carrier_hz / speed_of_light_m_s;
    slot_begin_.assign(all.slot_range_m.size() + 1, all.cells.size());
    for (std::size_t k = all.cells.size(); k-- > 0;) {
      const ArrayCell& cell = all.cells[k];
      slot_begin_[cell.slot] = k;
      layout_.put(wave_at(antennas, cell.x, cell.y), gaussian(cell.weight, rng),
                  &rows_[k * layout_.row]);
      const auto& [axis_x, axis_z] = axes[static_cast<std::size_t>(cell.person)];
      auto modes =
          BodyMotion::range_per_mode(cell.x, cell.y, cell.height_m, axis_x, axis_z, c.target_scale);
      for (float& mode : modes) mode *= static_cast<float>(turns_per_m);
      cells_.push_back({modes, static_cast<std::size_t>(cell.person)});
    }
    std::reverse(cells_.begin(), cells_.end());
    turns_.resize(cells_.size());
    re_.resize(cells_.size());
    im_.resize(cells_.size());
  }

  void add(double later_s, Rng& rng, float* out) {
    motion_.advance(later_s, rng);
    for (std::size_t k = 0; k < cells_.size(); ++k) {
      const auto& now = motion_.of(cells_[k].person);
      const auto& per_mode = cells_[k].turns_per_mode;
      turns_[k] = 0;
      for (std::size_t i = 0; i < now.size(); ++i) turns_[k] += now[i] * per_mode[i];
    }
    turn(turns_.data(), re_.data(), im_.data(), turns_.size());
    std::vector<float> sum(layout_.row);
    for (std::size_t slot = 0; slot + 1 < slot_begin_.size(); ++slot) {
      std::fill(sum.begin(), sum.end(), 0.0f);
      const std::size_t k = slot_begin_[slot];
      add_turned(&rows_[k * layout_.row], &re_[k], &im_[k], slot_begin_[slot + 1] - k,
                 layout_.padded, sum.data());
      slots_[slot].spread_to(out, sum.data(), layout_.row);
    }
  }

 private:
  struct Cell {
    BodyMotion::Modes turns_per_mode;
    std::size_t person;
  };
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
  BodyMotion motion_;
  std::vector<Reached> slots_;
  std::vector<Cell> cells_;
  std::vector<std::size_t> slot_begin_;  // and the end
  std::vector<float> rows_, turns_, re_, im_;
};

// People and the room, incoherent: x = L q with L L^H the covariance and q over any `frames` frames
// orthonormal.
class Expectation {
 public:
  Expectation(const Returns& returns, const RadarAxis& axis, const Antennas& antennas,
              const Conditions& c)
      : layout_(antennas.size()), points_(axis.count), frames_(c.radar_frames) {
    const std::size_t n = antennas.size();
    const ArrayCells all =
        cells_of(returns, {axis.resolution_m / slots_per_cell}, Echoes::of_people_and_room);
    std::vector<Complex> of_slots(all.slot_range_m.size() * n * n);
    for (const ArrayCell& cell : all.cells) {
      const auto wave = wave_at(antennas, cell.x, cell.y);
      Complex* out = &of_slots[cell.slot * n * n];
      for (std::size_t a = 0; a < n; ++a)
        for (std::size_t b = 0; b <= a; ++b)
          out[a * n + b] += cell.weight * wave[a] * std::conj(wave[b]);
    }
    std::vector<Complex> covariance(points_ * n * n);
    const RangeResponse response(axis);
    for (std::size_t slot = 0; slot < all.slot_range_m.size(); ++slot) {
      const Reached reached = reached_from(all.slot_range_m[slot], response, axis);
      Complex* out = &covariance[reached.first * n * n];
      for (const double psf : reached.response)
        for (std::size_t e = 0; e < n * n; ++e) *out++ += psf * psf * of_slots[slot * n * n + e];
    }
    for (std::size_t i = 0; i < points_; ++i) add_root({&covariance[i * n * n], n * n});
  }

  void add(float* out) {
    // Quadratic phases: successive frames, and their mean, are as of independent looks (Chu, IEEE
    // Trans. Inf. Theory 18, 531, 1972).
    std::vector<Complex> q(layout_.antennas);
    const std::int64_t f = frame_ % frames_;
    const std::int64_t apart = frames_ / static_cast<std::int64_t>(q.size());
    for (std::size_t a = 0; a < q.size(); ++a) {
      const auto half_turns = f * (f + frames_ % 2 + 2 * apart * static_cast<std::int64_t>(a));
      q[a] = std::polar(
          1.0, pi * static_cast<double>(half_turns % (2 * frames_)) / static_cast<double>(frames_));
    }
    ++frame_;
    const Complex* root = roots_.data();
    for (std::size_t i = 0; i < points_; ++i, out += layout_.row)
      for (std::size_t a = 0; a < q.size(); ++a) {
        double re = 0, im = 0;
        for (std::size_t b = 0; b <= a; ++b, ++root) {
          re += root->real() * q[b].real() - root->imag() * q[b].imag();
          im += root->real() * q[b].imag() + root->imag() * q[b].real();
        }
        out[a] += static_cast<float>(re);
        out[layout_.padded + a] += static_cast<float>(im);
      }
  }

 private:
  // Cholesky's, row by row up to the diagonal. A covariance of fewer sources than antennas has
  // pivots that are nothing but rounding: their columns are 0.
  void add_root(std::span<Complex> c) {
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
    for (std::size_t a = 0; a < n; ++a) roots_.insert(roots_.end(), &c[a * n], &c[a * n] + a + 1);
  }

  Layout layout_;
  std::size_t points_;
  std::int64_t frames_, frame_ = 0;
  std::vector<Complex> roots_;
};

}  // namespace

struct ArrayEcho::State {
  Layout layout;
  std::vector<float> still, now;
  std::variant<Speckle, Expectation> moving;
};

ArrayEcho::ArrayEcho(const Returns& returns, const RadarAxis& axis, const Antennas& antennas,
                     const Conditions& c, std::uint64_t still_seed, Rng& rng) {
  const bool coherent = c.radar_sum == "coherent";
  using Moving = std::variant<Speckle, Expectation>;
  state_ =
      std::make_unique<State>(State{Layout(antennas.size()),
                                    still_echo(returns, axis, antennas, coherent, still_seed),
                                    {},
                                    coherent ? Moving(Speckle(returns, axis, antennas, c, rng))
                                             : Moving(Expectation(returns, axis, antennas, c))});
}
ArrayEcho::~ArrayEcho() = default;
ArrayEcho::ArrayEcho(ArrayEcho&&) noexcept = default;
ArrayEcho& ArrayEcho::operator=(ArrayEcho&&) noexcept = default;

std::size_t ArrayEcho::samples() const {
  return state_->still.size() / state_->layout.row * state_->layout.antennas;
}

void ArrayEcho::frame(double later_s, Rng& rng, std::span<std::complex<float>> samples) {
  const Layout& layout = state_->layout;
  auto& now = state_->now;
  now = state_->still;
  if (auto* speckle = std::get_if<Speckle>(&state_->moving))
    speckle->add(later_s, rng, now.data());
  else
    std::get<Expectation>(state_->moving).add(now.data());
  const float* row = now.data();
  for (std::size_t i = 0; i < samples.size(); i += layout.antennas, row += layout.row)
    for (std::size_t m = 0; m < layout.antennas; ++m)
      samples[i + m] = {row[m], row[layout.padded + m]};
}

}  // namespace echofuse::sim
