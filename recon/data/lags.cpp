// SPDX-License-Identifier: MIT
#include "recon/data/lags.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

namespace echofuse::recon {
namespace {

constexpr double same_place = 0.01;  // tolerance of antenna positions, in half wavelengths

std::complex<float> response(const record::Antenna& a) {
  return std::polar(static_cast<float>(a.gain), static_cast<float>(a.phase_rad));
}

// Returns the spacing of two antennas in whole half wavelengths, from their distance along and
// across a line. Returns 0 if the spacing is not a whole number or the antennas are not on one
// line.
std::size_t spacing_of(double along, double aside) {
  const double spacing = std::round(along);
  const bool lag = spacing >= 1 && spacing <= static_cast<double>(max_lags) &&
                   std::abs(along - spacing) <= same_place && std::abs(aside) <= same_place;
  return lag ? static_cast<std::size_t>(spacing) : 0;
}

}  // namespace

SpatialLags::SpatialLags(const record::Antennas& antennas) {
  for (const auto& a : antennas)
    power_factors_.push_back(
        static_cast<float>(1 / (a.gain * a.gain * static_cast<double>(antennas.size()))));
  std::map<std::size_t, std::size_t> counts;
  const auto add = [&](bool upwards) {
    std::size_t longest = 0;
    for (std::size_t m = 0; m < antennas.size(); ++m)
      for (std::size_t n = 0; n < antennas.size(); ++n) {
        const auto &a = antennas[m], &b = antennas[n];
        const double x = a.x - b.x, y = a.y - b.y;
        const std::size_t spacing = upwards ? spacing_of(y, x) : spacing_of(x, y);
        if (spacing == 0) continue;
        const std::size_t lag = across_ + spacing;
        pairs_.push_back({m, n, lag, 1.f / (response(a) * std::conj(response(b)))});
        ++counts[lag];
        longest = std::max(longest, spacing);
      }
    return longest;
  };
  across_ = add(false);
  if (across_ > 0) up_ = add(true);
  for (Pair& p : pairs_) p.factor /= static_cast<float>(counts[p.lag]);
}

std::string SpatialLags::quantity() const {
  std::set<std::size_t> known;
  for (const Pair& p : pairs_) known.insert(p.lag);
  std::string out = "lags";
  if (known.size() < longest())
    for (const std::size_t lag : known) out += ' ' + std::to_string(lag);
  return up_ > 0 ? out + ", " + std::to_string(up_) + " up" : out;
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
  const std::size_t values = lag_values(longest());
  for (std::size_t b = 0; (b + 1) * values <= out.size(); ++b)
    (*this)(record::bin_of(array, antennas, b), out.subspan(b * values, values));
}

Axis lags_axis(const Axis& array, const SpatialLags& lags) {
  Axis out = array;
  out.quantity = lags.quantity();
  out.scale = static_cast<double>(lags.longest());
  if (lags.longest() == 0) out = {};
  return out;
}

}  // namespace echofuse::recon
