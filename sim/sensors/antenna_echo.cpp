// SPDX-License-Identifier: MIT
// Echoes of static and moving scatterers at the antennas.
#include <Eigen/Dense>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "drivers/core/axis.hpp"
#include "sim/scene/draw.hpp"
#include "sim/scene/room.hpp"
#include "sim/sensors/antennas.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {

using record::Antennas;

namespace {

using Eigen::ArrayXf;
using Eigen::ArrayXXf;
using Eigen::Index;
using Eigen::MatrixXcf;
using Eigen::MatrixXf;
using EchoSamples = Eigen::Map<MatrixXcf>;  // row: antenna; column: range point

constexpr double pi = std::numbers::pi;
constexpr double slots_per_cell = 8;
double slot_of(double range_m, const RadarAxis& axis) {
  return std::floor(range_m / axis.resolution_m * slots_per_cell);
}

// Returns the responses at the points of an axis (columns) to echoes at the centres of range slots
// (rows).
MatrixXf responses(const RadarAxis& axis, const std::vector<double>& slots) {
  const RangeResponse response(axis);
  std::vector<double> psf;
  MatrixXf out(slots.size(), axis.count);
  for (std::size_t s = 0; s < slots.size(); ++s) {
    response.at((slots[s] + 0.5) / slots_per_cell, psf);
    out.row(static_cast<Index>(s)) =
        Eigen::Map<Eigen::RowVectorXd>(psf.data(), axis.count).cast<float>();
  }
  return out;
}

// Adds echoes to the samples. `slots` contains the sum of the echoes in each slot (columns) at each
// antenna (rows), and `response` contains the response of each range point (columns) to each slot
// (rows).
void add_echoes(const MatrixXcf& slots, const MatrixXf& response, EchoSamples& samples) {
  const Eigen::Map<const MatrixXf> from(reinterpret_cast<const float*>(slots.data()),
                                        2 * slots.rows(), slots.cols());
  Eigen::Map<MatrixXf>(reinterpret_cast<float*>(samples.data()), 2 * samples.rows(), samples.cols())
      .noalias() += from * response;
}

// Returns plane waves from directions u, v (columns) at the antennas (rows), with the phase and
// gain errors of the antennas. `ahead_turns` is the initial phase of each wave, turns.
MatrixXcf waves(const Antennas& antennas, const ArrayXf& u, const ArrayXf& v,
                const ArrayXf& amplitude, const ArrayXf& ahead_turns) {
  const auto n = static_cast<Index>(antennas.size());
  MatrixXf places(n, 2);
  ArrayXf phase(n);
  Eigen::VectorXf gain(n);
  for (Index m = 0; m < n; ++m) {
    const auto& a = antennas[static_cast<std::size_t>(m)];
    places.row(m) << static_cast<float>(a.x / 2), static_cast<float>(a.y / 2);
    phase[m] = static_cast<float>(a.phase_rad / (2 * pi));
    gain[m] = static_cast<float>(a.gain);
  }
  MatrixXf directions(2, u.size());
  directions << u.transpose().matrix(), v.transpose().matrix();
  ArrayXXf turns = (places * directions).array();
  turns.colwise() += phase;
  turns.rowwise() += ahead_turns.transpose();
  turns *= 2 * std::numbers::pi_v<float>;
  const ArrayXXf strength = (gain * amplitude.matrix().transpose()).array();
  MatrixXcf out(n, u.size());
  out.real() = (strength * turns.cos()).matrix();
  out.imag() = (strength * turns.sin()).matrix();
  return out;
}

// Returns the random phase of a static patch, turns. The phase depends only on the patch and the
// seed, so that objects in front of other patches do not change the phase.
float turns_of_patch(const Returns& returns, std::size_t k, std::uint64_t seed) {
  const auto range = std::bit_cast<std::uint64_t>(returns.range_m[k]);
  const auto x = std::bit_cast<std::uint32_t>(returns.place[k].x);
  const auto y = std::bit_cast<std::uint32_t>(returns.place[k].y);
  return static_cast<float>(mix(seed ^ mix(range ^ mix(x ^ mix(y)))) >> 40) * 0x1p-24f;
}

// Returns the spherical wave from a nearby point at each antenna.
MatrixXcf near_wave(const AntennaRadar& radar, const EchoCell& point) {
  const double z = point.range_m * std::sqrt(1 - point.x * point.x - point.y * point.y);
  const auto way_m = [&](double x, double y) {
    return std::hypot(point.range_m * point.x - x, point.range_m * point.y - y, z);
  };
  MatrixXcf out(radar.pairs.size(), 1);
  for (std::size_t m = 0; m < radar.pairs.size(); ++m) {
    const auto& p = radar.pairs[m];
    const double longer_m = way_m(p.tx_x, p.tx_y) + way_m(p.rx_x, p.rx_y) - 2 * point.range_m;
    out(static_cast<Index>(m), 0) = std::complex<float>(
        std::polar(radar.antennas[m].gain * std::sqrt(point.weight),
                   radar.antennas[m].phase_rad - 2 * pi * longer_m / radar.wavelength_m));
  }
  return out;
}

// Adds the echoes of the calibration reflector and of the leakage, which are modelled as points.
void add_points(const Returns& returns, const AntennaRadar& radar, EchoSamples& samples) {
  const RangeResponse response(radar.axis);
  std::vector<double> psf;
  for (const auto kind : {Returns::reflector, Returns::leakage}) {
    const EchoCell cell = cell_of_kind(returns, kind);
    if (cell.weight <= 0) continue;
    const auto one = [](double value) { return ArrayXf::Constant(1, static_cast<float>(value)); };
    response.at(cell.range_m / radar.axis.resolution_m, psf);
    const MatrixXcf wave =
        kind == Returns::reflector && !radar.pairs.empty()
            ? near_wave(radar, cell)
            : waves(radar.antennas, one(cell.x), one(cell.y), one(std::sqrt(cell.weight)), one(0));
    samples += wave * Eigen::Map<Eigen::RowVectorXd>(psf.data(), samples.cols()).cast<float>();
  }
}

// Adds the coherent echoes of the room and of objects. If the room is subtracted, its hidden
// patches have negative weights, which remove their echoes.
void add_still(const Returns& returns, const AntennaRadar& radar, EchoSamples& samples) {
  std::vector<std::size_t> patches;
  double first = INFINITY, last = 0;
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    if (returns.place[k].person != Returns::still || returns.range_m[k] <= 0) continue;
    patches.push_back(k);
    first = std::min(first, slot_of(returns.range_m[k], radar.axis));
    last = std::max(last, slot_of(returns.range_m[k], radar.axis));
  }
  if (patches.empty()) return;
  const auto count = static_cast<Index>(patches.size());
  ArrayXf u(count), v(count), amplitude(count), ahead(count);
  for (Index i = 0; i < count; ++i) {
    const std::size_t k = patches[static_cast<std::size_t>(i)];
    u[i] = returns.place[k].x, v[i] = returns.place[k].y;
    const double weight = returns.weight[k];
    amplitude[i] = static_cast<float>(std::copysign(std::sqrt(std::abs(weight)), weight));
    ahead[i] = turns_of_patch(returns, k, radar.still_seed);
  }
  const MatrixXcf wave = waves(radar.antennas, u, v, amplitude, ahead);
  std::vector<double> slots;
  for (double slot = first; slot <= last; ++slot) slots.push_back(slot);
  MatrixXcf sums = MatrixXcf::Zero(wave.rows(), static_cast<Index>(slots.size()));
  for (Index i = 0; i < count; ++i) {
    const double range_m = returns.range_m[patches[static_cast<std::size_t>(i)]];
    sums.col(static_cast<Index>(slot_of(range_m, radar.axis) - first)) += wave.col(i);
  }
  add_echoes(sums, responses(radar.axis, slots), samples);
}

}  // namespace

class AntennaEcho::Moving {
 public:
  virtual ~Moving() = default;
  virtual void add(double later_s, Rng& rng, EchoSamples& samples) = 0;
};

// Coherent echoes of moving people.
class AntennaEcho::Speckle : public Moving {
 public:
  Speckle(const Returns& returns, const AntennaRadar& radar, const Conditions& c, Rng& rng)
      : receivers_(radar.chirp_s > 0 ? radar.receivers : radar.antennas.size()),
        chirp_s_(radar.chirp_s),
        chirps_(static_cast<float>(radar.chirps)),
        cells_(echo_cells(returns, radar.axis.resolution_m / slots_per_cell, false)),
        motion_(c, cells_.people, rng) {
    std::vector<double> slots;
    for (const double range_m : cells_.slot_range_m) slots.push_back(slot_of(range_m, radar.axis));
    response_ = responses(radar.axis, slots);
    const auto count = static_cast<Index>(cells_.cells.size());
    ArrayXf u(count), v(count), amplitude(count), ahead(count);
    turns_per_mode_.setZero(count, static_cast<Index>(cells_.people * BodyMotion::modes));
    const auto axes = upright_axes();
    for (Index k = count; k-- > 0;) {
      const EchoCell& cell = cells_.cells[static_cast<std::size_t>(k)];
      u[k] = static_cast<float>(cell.x), v[k] = static_cast<float>(cell.y);
      // The echo is a complex Gaussian number: its power is exponentially distributed, and its
      // phase is uniformly distributed.
      amplitude[k] = static_cast<float>(std::sqrt(-cell.weight * std::log(1 - uniform(rng, 0, 1))));
      ahead[k] = static_cast<float>(uniform(rng, 0, 1));
      const auto person = static_cast<std::size_t>(cell.person);
      const auto range = BodyMotion::range_per_mode(cell.x, cell.y, cell.height_m, axes[person][0],
                                                    axes[person][1], c.target_scale);
      for (std::size_t i = 0; i < range.size(); ++i)
        turns_per_mode_(k, static_cast<Index>(person * range.size() + i)) =
            static_cast<float>(-2 * radar_carrier_hz / speed_of_light_m_s) * range[i];
    }
    waves_ = waves(radar.antennas, u, v, amplitude, ahead);
  }

  void add(double later_s, Rng& rng, EchoSamples& samples) override {
    motion_.advance(later_s, rng);
    if (cells_.cells.empty()) return;
    const auto by_modes = [&](const std::vector<BodyMotion::Modes>& modes) -> ArrayXf {
      return turns_per_mode_ *
             Eigen::Map<const Eigen::VectorXf>(modes.front().data(), turns_per_mode_.cols());
    };
    ArrayXf turns = by_modes(motion_.places());
    const ArrayXf speeds = chirp_s_ > 0 ? by_modes(motion_.speeds()) : ArrayXf();
    const auto antennas = static_cast<std::size_t>(waves_.rows());
    const std::size_t transmitters = (antennas + receivers_ - 1) / receivers_;
    MatrixXcf slots(waves_.rows(), response_.rows());
    for (std::size_t t = 0; t < transmitters; ++t) {
      const ArrayXf angle = 2 * std::numbers::pi_v<float> * turns;
      Eigen::VectorXcf turned(angle.size());
      turned.real() = angle.cos().matrix();
      turned.imag() = angle.sin().matrix();
      if (chirp_s_ > 0) {
        const auto apart = static_cast<float>(chirp_s_);
        lose_doppler(apart * static_cast<float>(transmitters) * speeds, turned);
        turns += apart * speeds;  // phase change until the next transmitter sends, turns
      }
      const auto first = static_cast<Index>(t * receivers_);
      const auto count = std::min(static_cast<Index>(receivers_), waves_.rows() - first);
      for (Index s = 0; s < slots.cols(); ++s) {
        const auto begin = static_cast<Index>(cells_.begin[static_cast<std::size_t>(s)]);
        const auto end = static_cast<Index>(cells_.begin[static_cast<std::size_t>(s) + 1]);
        slots.col(s).segment(first, count).noalias() =
            waves_.block(first, begin, count, end - begin) * turned.segment(begin, end - begin);
      }
    }
    add_echoes(slots, response_, samples);
  }

 private:
  // Multiplies each echo by the fraction of its amplitude in Doppler bin 0. `turns` is the phase
  // change between two chirps of the same transmitter, turns.
  void lose_doppler(const ArrayXf& turns, Eigen::VectorXcf& turned) const {
    for (Index k = 0; k < turns.size(); ++k) {
      const float half = std::numbers::pi_v<float> * turns[k], one = std::sin(half);
      if (std::abs(one) > 1e-4f) turned[k] *= std::sin(chirps_ * half) / (chirps_ * one);
    }
  }

  // Returns the axis about which each person twists: x and z relative to the radar, m. The axis is
  // vertical and passes through the centre of the visible patches.
  std::vector<std::array<double, 2>> upright_axes() const {
    std::vector<double> weight(cells_.people);
    std::vector<std::array<double, 2>> axes(cells_.people);
    for (const EchoCell& c : cells_.cells) {
      const auto person = static_cast<std::size_t>(c.person);
      const double z = std::sqrt(std::max(0.0, 1 - c.x * c.x - c.y * c.y));
      weight[person] += c.weight;
      axes[person][0] += c.weight * c.range_m * c.x;
      axes[person][1] += c.weight * c.range_m * z;
    }
    for (std::size_t p = 0; p < axes.size(); ++p)
      for (double& sum : axes[p]) sum /= weight[p];
    return axes;
  }

  std::size_t receivers_;
  double chirp_s_;
  float chirps_;
  EchoCells cells_;
  BodyMotion motion_;
  MatrixXf response_;  // response: slots (rows), range points (columns)
  MatrixXcf waves_;    // echoes without motion: antennas (rows), cells (columns)
  // Phase change in turns per unit of each mode: cells (rows); modes of person 0, person 1 ...
  // (columns).
  MatrixXf turns_per_mode_;
};

// Incoherent echoes of people and of the room. The samples of a frame are x = L q with the
// covariance L L^H. Over any `frames` consecutive frames, the mean of q q^H is the identity matrix.
class AntennaEcho::Expectation : public Moving {
 public:
  Expectation(const Returns& returns, const AntennaRadar& radar, const Conditions& c)
      : frames_(c.radar_frames) {
    const auto n = static_cast<Index>(radar.antennas.size());
    const Index points = radar.axis.count;
    const double slot_m = radar.axis.resolution_m / slots_per_cell;
    const EchoCells all = echo_cells(returns, slot_m, true);
    const auto slots = static_cast<Index>(all.slot_range_m.size());
    Eigen::MatrixXcd of_slots = Eigen::MatrixXcd::Zero(n * n, slots);
    Eigen::MatrixXd squares(slots, points);
    const RangeResponse response(radar.axis);
    std::vector<double> psf;
    for (Index s = 0; s < slots; ++s) {
      const auto slot = static_cast<std::size_t>(s);
      Eigen::Map<Eigen::MatrixXcd> sum(of_slots.col(s).data(), n, n);
      for (std::size_t k = all.begin[slot]; k < all.begin[slot + 1]; ++k) {
        const EchoCell& cell = all.cells[k];
        Eigen::VectorXcd wave(n);
        for (Index m = 0; m < n; ++m) {
          const auto& a = radar.antennas[static_cast<std::size_t>(m)];
          wave[m] = std::polar(a.gain, pi * (a.x * cell.x + a.y * cell.y) + a.phase_rad);
        }
        sum.noalias() += cell.weight * wave * wave.adjoint();
      }
      response.at(all.slot_range_m[slot] / radar.axis.resolution_m, psf);
      squares.row(s) = Eigen::Map<Eigen::ArrayXd>(psf.data(), points).square().transpose();
    }
    Eigen::MatrixXcd covariance = of_slots * squares;
    roots_.resize(n * points, n);
    for (Index i = 0; i < points; ++i) {
      Eigen::Map<Eigen::MatrixXcd> of_point(covariance.col(i).data(), n, n);
      take_root(of_point);
      roots_.middleRows(i * n, n) = of_point.cast<std::complex<float>>();
    }
  }

  void add(double, Rng&, EchoSamples& samples) override {
    // Phases that are quadratic in the frame number make successive frames behave like independent
    // looks (Chu, IEEE Trans. Inf. Theory 18, 531, 1972). The means of successive frames also
    // behave like independent looks.
    const std::int64_t f = frame_ % frames_, apart = frames_ / roots_.cols();
    Eigen::VectorXcf q(roots_.cols());
    for (Index a = 0; a < q.size(); ++a) {
      const auto half_turns = f * (f + frames_ % 2 + 2 * apart * a);
      q[a] =
          std::complex<float>(std::polar(1.0, pi * static_cast<double>(half_turns % (2 * frames_)) /
                                                  static_cast<double>(frames_)));
    }
    ++frame_;
    Eigen::Map<Eigen::VectorXcf>(samples.data(), samples.size()).noalias() += roots_ * q;
  }

 private:
  // Replaces a covariance matrix with its Cholesky factor L. If there are fewer sources than
  // antennas, some pivots contain only rounding errors; the columns of these pivots are set to 0.
  static void take_root(Eigen::Map<Eigen::MatrixXcd>& c) {
    const double trace = c.diagonal().real().sum();
    for (Index b = 0; b < c.cols(); ++b) {
      const Index below = c.rows() - b;
      c.col(b).tail(below) -= c.block(b, 0, below, b) * c.row(b).head(b).adjoint();
      const double pivot = c(b, b).real();
      c.col(b).tail(below) *= pivot > 1e-12 * trace ? 1 / std::sqrt(pivot) : 0;
    }
    c.triangularView<Eigen::StrictlyUpper>().setZero();
  }

  std::int64_t frames_, frame_ = 0;
  MatrixXcf roots_;  // matrices L of all range points, stacked vertically
};

AntennaEcho::AntennaEcho(const Returns& returns, const AntennaRadar& radar, const Conditions& c,
                         Rng& rng)
    : points_(radar.axis.count),
      antennas_(radar.antennas.size()),
      still_(radar.room.begin(), radar.room.end()) {
  const bool coherent = c.radar_sum == "coherent";
  still_.resize(samples());
  EchoSamples still(still_.data(), static_cast<Index>(antennas_), static_cast<Index>(points_));
  add_points(returns, radar, still);
  if (coherent) add_still(returns, radar, still);
  if (coherent)
    moving_ = std::make_unique<Speckle>(returns, radar, c, rng);
  else
    moving_ = std::make_unique<Expectation>(returns, radar, c);
}
AntennaEcho::~AntennaEcho() = default;
AntennaEcho::AntennaEcho(AntennaEcho&&) noexcept = default;
AntennaEcho& AntennaEcho::operator=(AntennaEcho&&) noexcept = default;

void AntennaEcho::frame(double later_s, Rng& rng, std::span<std::complex<float>> samples) {
  std::copy(still_.begin(), still_.end(), samples.begin());
  EchoSamples all(samples.data(), static_cast<Index>(antennas_), static_cast<Index>(points_));
  moving_->add(later_s, rng, all);
}

std::vector<std::complex<float>> room_echo(const AntennaRadar& radar, const Conditions& c) {
  std::vector<std::complex<float>> all(radar.antennas.size() * radar.axis.count);
  const Returns room = radar_returns(empty_room(*room_named(c.background)), c);
  EchoSamples samples(all.data(), static_cast<Index>(radar.antennas.size()),
                      static_cast<Index>(radar.axis.count));
  add_still(room, radar, samples);
  return all;
}

}  // namespace echofuse::sim
