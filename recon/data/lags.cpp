// SPDX-License-Identifier: MIT
#include "recon/data/lags.hpp"

#include <algorithm>
#include <cmath>
#include <set>

namespace echofuse::recon {
namespace {

constexpr double same_place = 0.01;  // half wavelengths

std::complex<float> response(const record::Antenna& a) {
  return std::polar(static_cast<float>(a.gain), static_cast<float>(a.phase_rad));
}

}  // namespace

SpatialLags::SpatialLags(const record::Antennas& antennas) {
  std::vector<std::size_t> counts(most_lags + 1);
  for (const auto& a : antennas)
    power_factors_.push_back(
        static_cast<float>(1 / (a.gain * a.gain * static_cast<double>(antennas.size()))));
  for (std::size_t m = 0; m < antennas.size(); ++m)
    for (std::size_t n = 0; n < antennas.size(); ++n) {
      const auto &a = antennas[m], &b = antennas[n];
      const double spacing = std::round(a.x - b.x);
      if (spacing < 1 || spacing >= static_cast<double>(counts.size()) ||
          std::abs(a.x - b.x - spacing) > same_place || std::abs(a.y - b.y) > same_place)
        continue;
      const auto lag = static_cast<std::size_t>(spacing);
      pairs_.push_back({m, n, lag, 1.f / (response(a) * std::conj(response(b)))});
      ++counts[lag];
      longest_ = std::max(longest_, lag);
    }
  for (Pair& p : pairs_) p.factor /= static_cast<float>(counts[p.lag]);
}

std::string SpatialLags::quantity() const {
  std::set<std::size_t> known;
  for (const Pair& p : pairs_) known.insert(p.lag);
  std::string out = "lags";
  if (known.size() < longest_)
    for (const std::size_t lag : known) out += ' ' + std::to_string(lag);
  return out;
}

void SpatialLags::operator()(const record::ArrayBin& bin, std::span<float> out) const {
  std::fill(out.begin(), out.end(), 0.f);
  for (std::size_t m = 0; m < power_factors_.size(); ++m)
    out[0] += power_factors_[m] * bin.covariance(m, m).real();
  for (const Pair& p : pairs_) {
    const std::complex<float> value = p.factor * bin.covariance(p.m, p.n);
    out[2 * p.lag - 1] += value.real(), out[2 * p.lag] += value.imag();
  }
}

void SpatialLags::operator()(std::span<const float> array, std::size_t antennas,
                             std::span<float> out) const {
  const std::size_t values = lag_values(longest_);
  for (std::size_t b = 0; (b + 1) * values <= out.size(); ++b)
    (*this)(record::bin_of(array, antennas, b), out.subspan(b * values, values));
}

void move_lags(std::span<float> lags, const Axis& axis, const Shift& shift) {
  const std::size_t values = lag_values(longest_lag(axis));
  std::vector<float> column(axis.count);
  for (std::size_t k = 0; k < values; ++k) {
    for (std::size_t b = 0; b < column.size(); ++b) column[b] = lags[b * values + k];
    const std::vector<float> moved = shift.apply(column);
    for (std::size_t b = 0; b < column.size(); ++b) lags[b * values + k] = moved[b];
  }
}

Axis lags_axis(const Axis& array, const SpatialLags& lags) {
  Axis out = array;
  out.quantity = lags.quantity();
  out.scale = static_cast<double>(lags.longest());
  if (lags.longest() == 0) out = {};
  return out;
}

}  // namespace echofuse::recon
