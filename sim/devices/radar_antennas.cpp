// SPDX-License-Identifier: MIT
#include "sim/devices/radar_antennas.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "drivers/util/format.hpp"
#include "sim/sensors/gaussian.hpp"

namespace echofuse::sim {
namespace {

// Factor that converts amplitudes (mean scene: 1) to the 16-bit integers of the heat map, which
// saturate at 32 times the amplitude of the mean scene.
constexpr float sample_gain = 1 << 10;
// Index of the ISK transmitter that is not in the row of the other two.
constexpr unsigned above = 1;

constexpr double layout_hz = 62e9;  // antenna positions are in half wavelengths at this frequency

std::vector<AntennaRadar::TxRxPair> about_their_middle(std::vector<AntennaRadar::TxRxPair> pairs) {
  AntennaRadar::TxRxPair middle;
  const auto n = static_cast<double>(pairs.size());
  for (const auto& p : pairs) {
    middle.tx_x += p.tx_x / n, middle.tx_y += p.tx_y / n;
    middle.rx_x += p.rx_x / n, middle.rx_y += p.rx_y / n;
  }
  for (auto& p : pairs) {
    p.tx_x -= middle.tx_x, p.tx_y -= middle.tx_y;
    p.rx_x -= middle.rx_x, p.rx_y -= middle.rx_y;
  }
  return pairs;
}

Conditions with_all_antennas(Conditions c) {
  c.radar_antennas = 12;
  return c;
}

}  // namespace

RadarAntennas::RadarAntennas(const Conditions& conditions, std::uint64_t seed,
                             const std::string& board)
    : conditions_(conditions),
      seed_(seed),
      planar_(conditions.radar_antennas == 12 || board != "isk"),
      channels_(simulated_antennas(with_all_antennas(conditions), seed)) {
  using Places = std::array<std::array<double, 2>, transmitters + receivers>;
  constexpr Places isk{{{0, 0}, {2, -1}, {4, 0}, {0, 0}, {1, 0}, {2, 0}, {3, 0}}},
      aop{{{0, 0}, {2, 2}, {0, 2}, {1, 1}, {1, 0}, {0, 1}, {0, 0}}},
      ods{{{0, 0}, {2, 0}, {2, 2}, {0, 0}, {0, 1}, {1, 1}, {1, 0}}};
  const Places& places = !planar_ ? isk : board == "ods" ? ods : aop;
  constexpr double unit_m = speed_of_light_m_s / (2 * layout_hz);
  for (std::size_t m = 0; m < channels_.size(); ++m) {
    const auto &tx = places[m / receivers], &rx = places[transmitters + m % receivers];
    channels_[m].x = tx[0] + rx[0], channels_[m].y = tx[1] + rx[1];
    pairs_.push_back({unit_m * tx[0], unit_m * tx[1], unit_m * rx[0], unit_m * rx[1]});
  }
}

void RadarAntennas::start(const Chirp& chirp, double mean_peak) {
  axis_ = chirp.axis(conditions_);
  noise_power_ = radar_noise_power(conditions_, mean_peak);
  used_.clear();
  used_pairs_.clear();
  numbers_.clear();
  chirp_s_ = 1e-6 * (chirp.idle_us + chirp.ramp_end_us);
  receivers_used_ = static_cast<std::size_t>(std::popcount(chirp.receivers));
  chirps_ = chirp.chirps_per_frame /
            std::max<std::int64_t>(1, static_cast<std::int64_t>(chirp.transmitters.size()));
  std::size_t of_row = 0;
  const auto& tx = chirp.transmitters;
  for (const unsigned t : tx) {
    of_row += planar_ || t != above;
    for (std::size_t r = 0; r < receivers; ++r)
      if (chirp.receivers >> r & 1) {
        numbers_.push_back(t * receivers + r);
        used_.push_back(channels_[numbers_.back()]);
        used_pairs_.push_back(pairs_[numbers_.back()]);
      }
  }
  used_pairs_ = about_their_middle(used_pairs_);
  wavelength_m_ = speed_of_light_m_s /
                  (1e9 * chirp.start_ghz +
                   1e6 * chirp.played_slope_mhz_us() *
                       (chirp.adc_start_us + 500.0 * chirp.samples / chirp.sample_rate_ksps));
  // If the chirp uses no transmitter of the ISK row, the samples of all antennas are sent.
  if (of_row == 0) of_row = tx.size();
  sent_ = tx.empty() ? 0 : used_.size() / tx.size() * of_row;
  echo_.reset();
}

void RadarAntennas::sample_frame(const RenderedScene& rendered, double time_s, double gain,
                                 Rng& rng) {
  if (!echo_ || scene_ != rendered.index) {
    AntennaRadar radar{axis_, used_, seed_};
    radar.receivers = receivers_used_;
    radar.chirp_s = chirp_s_;
    radar.chirps = chirps_;
    radar.pairs = used_pairs_;
    radar.wavelength_m = wavelength_m_;
    echo_.emplace(rendered.radar, radar, conditions_, rng);
    scene_ = rendered.index;
    sampled_s_ = time_s;
  }
  samples_.resize(echo_->samples());
  echo_->frame(std::max(0.0, time_s - sampled_s_), rng, samples_);
  sampled_s_ = time_s;
  auto* parts = reinterpret_cast<float*>(samples_.data());
  const auto amplitude = static_cast<float>(std::sqrt(gain));
  for (std::size_t i = 0; i < 2 * samples_.size(); ++i) parts[i] *= amplitude;
  add_gaussian({parts, 2 * samples_.size()}, static_cast<float>(std::sqrt(noise_power_ / 2)), rng);
}

std::vector<std::uint16_t> RadarAntennas::profile_codes() const {
  const std::size_t n = used_.size();
  std::vector<std::uint16_t> codes;
  codes.reserve(samples_.size() / n);
  for (std::size_t i = 0; i < samples_.size(); i += n) {
    double sum = 0;
    for (std::size_t m = 0; m < n; ++m) sum += log2_level(double{std::abs(samples_[i + m])});
    codes.push_back(log2_q8(sum, static_cast<unsigned>(n)));
  }
  return codes;
}

RadarTlv RadarAntennas::tlv() const {
  std::vector<std::complex<float>> sent;
  for (std::size_t i = 0; i < samples_.size(); i += used_.size())
    for (std::size_t m = 0; m < sent_; ++m) sent.push_back(sample_gain * samples_[i + m]);
  return heat_map_tlv(planar_, sent);
}

std::string RadarAntennas::coefficients() const {
  const auto weakest =
      std::min_element(channels_.begin(), channels_.end(),
                       [](const auto& a, const auto& b) { return a.gain < b.gain; });
  std::string line;
  for (const auto& channel : channels_)
    for (const double part : {std::cos(channel.phase_rad), -std::sin(channel.phase_rad)})
      line += format(" %.5f", weakest->gain / channel.gain * part);
  return line;
}

}  // namespace echofuse::sim
