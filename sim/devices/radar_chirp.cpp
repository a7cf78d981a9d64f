// SPDX-License-Identifier: MIT
#include "sim/devices/radar_chirp.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "sim/wire/encode.hpp"

namespace echofuse::sim {
namespace {

// Register units of the front end: 2.7 GHz / `one` for frequencies, and `slope_units` * 2.7 GHz /
// `one` per microsecond for slopes.
constexpr std::int64_t one = 1 << 26, slope_units = 900;

std::int64_t slope_number(double slope_mhz_us) {
  return static_cast<std::int64_t>(slope_mhz_us * one / (2700.0 * slope_units));
}

}  // namespace

double Chirp::active_us() const { return chirps_per_frame * (idle_us + ramp_end_us); }

bool Chirp::possible() const {
  return antennas > 0 && chirps_per_frame > 0 && ramp_possible() && frame_period_ms >= 0.3 &&
         frame_period_ms <= 1342 && 1e-3 * active_us() < frame_period_ms;
}

bool Chirp::ramp_possible() const {
  if (samples == 0 || sample_rate_ksps <= 0 || slope_mhz_us <= 0) return false;
  const auto start = static_cast<std::int64_t>(start_ghz * one / 2.7);
  const auto ramp = std::llround(100 * ramp_end_us);
  // Allows the ramp to end half a time unit (5 ns) outside the band.
  const auto end = start + slope_number(slope_mhz_us) * slope_units * (2 * ramp - 1) / 200;
  const double sampled_us = adc_start_us + 1e3 * samples / sample_rate_ksps;
  return start >= 60 * one * 10 / 27 && end <= 64 * one * 10 / 27 &&
         sampled_us <= 0.01 * static_cast<double>(ramp) + 1e-6;
}

double Chirp::played_slope_mhz_us() const {
  return static_cast<double>(slope_number(slope_mhz_us) * slope_units) * 2700 / one;
}

double Chirp::firmware_step_m() const {
  return 3e8 * 1e3 * sample_rate_ksps / (2e12 * slope_mhz_us * std::bit_ceil(samples));
}

RadarAxis Chirp::axis(const Conditions& c) const {
  const double rate_hz = sample_rate_ksps * 1e3, slope_hz_s = played_slope_mhz_us() * 1e12;
  const unsigned bins = std::bit_ceil(samples);
  RadarAxis axis = radar_response(c);
  axis.count = antennas == 12 && bins == 1024 ? 1022 : bins;
  axis.step_m = speed_of_light_m_s * rate_hz / (2 * slope_hz_s * bins);
  axis.resolution_m = speed_of_light_m_s / (2 * slope_hz_s * samples / rate_hz);
  return axis;
}

double log2_level(double magnitude) { return std::log2(std::max(1.0, radar_gain * magnitude)); }

std::vector<std::uint16_t> range_profile_codes(const std::vector<double>& power, double mean_peak,
                                               unsigned antennas, const Conditions& conditions,
                                               Rng& rng) {
  std::vector<double> received = power;
  add_frame_noise(received, mean_peak, conditions, rng);
  std::vector<std::uint16_t> codes;
  codes.reserve(power.size());
  for (const double p : received)
    codes.push_back(log2_q8(antennas * log2_level(std::sqrt(p)), antennas));
  return codes;
}

double measured_range_bias_m(const std::vector<double>& power, double step_m, double target_m,
                             double window_m) {
  const double last = static_cast<double>(power.size()) - 2;
  const auto bin = [&](double x) {
    return static_cast<std::size_t>(std::clamp(std::round(x / step_m), 1.0, last));
  };
  const auto from = power.begin() + static_cast<std::ptrdiff_t>(bin(target_m - window_m / 2));
  const auto to = power.begin() + static_cast<std::ptrdiff_t>(bin(target_m + window_m / 2)) + 1;
  const auto peak = std::max_element(from, to);
  const double left = std::sqrt(peak[-1]), middle = std::sqrt(*peak), right = std::sqrt(peak[1]);
  const double curvature = left - 2 * middle + right;
  const double shift = curvature < 0 ? 0.5 * (left - right) / curvature : 0;
  return (static_cast<double>(peak - power.begin()) + shift) * step_m - target_m;
}

}  // namespace echofuse::sim
