// SPDX-License-Identifier: MIT
// What the radar's antennas see of a body, from the spatial lags c_d (data/lags.hpp) about the
// range at which the SPD sees it: the direction where most power comes from (the maximum of
// Bartlett's beam, sum of (A - d) Re(c_d exp(-i pi d u))), and the lags turned into that direction.
// These say how the body spreads about it, wherever it stands, as the aligned profile does along
// the range. Lags of antennas one above the other say how it spreads in height; they stay as they
// are.
#pragma once
#include <complex>
#include <span>
#include <vector>

#include "drivers/core/axis.hpp"
#include "recon/method/config.hpp"

namespace echofuse::recon {

class ArrayView {
 public:
  ArrayView() = default;
  ArrayView(const Axis& lags, const MethodConfig& config);  // count 0: none

  std::size_t size() const;                       // features of a body; 0 without antennas
  static constexpr std::size_t of_direction = 2;  // the first of them
  std::size_t cost() const;                       // multiply-adds
  // Fills size() features from a record's lags above the background: direction cosine u, u times
  // the range (metres), then of the window about the body and of parts of it the lags, those across
  // turned by exp(-i pi d u), over the power of the window. All zero if that has no power.
  void operator()(std::span<const float> lags, double range_m, std::span<float> out) const;
  // As of the same body in another direction.
  static void turn(double by, double range_m, std::span<float> features);
  static double direction_cosine(std::span<const float> features) { return double{features[0]}; }

 private:
  using Lags = std::vector<std::complex<double>>;
  void add(std::span<const float> bin, double weight, Lags& to) const;
  double direction_of(const Lags& sum) const;

  std::size_t lags_of(std::size_t most) const;  // how many, at most so many of each kind

  MethodConfig config_;
  std::size_t across_ = 0, up_ = 0, bins_ = 0, parts_ = 0;
  double first_m_ = 0, step_m_ = 1, part_m_ = 1;
};

}  // namespace echofuse::recon
