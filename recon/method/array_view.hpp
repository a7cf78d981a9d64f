// SPDX-License-Identifier: MIT
// An ArrayView holds what the radar's antennas see of a body, from the spatial lags c_d
// (data/lags.hpp) about the range at which the SPD sees it. It gives the direction where most power
// comes from (the maximum of Bartlett's beam, sum of (A - d) Re(c_d exp(-i pi d u))), and the lags
// turned into that direction. The lags say how the body spreads about the direction, wherever it
// stands, as the aligned profile does along the range. Lags of antennas one above the other say how
// it spreads in height; they stay as they are.
#pragma once
#include <complex>
#include <span>
#include <vector>

#include "drivers/core/axis.hpp"
#include "recon/method/constants.hpp"

namespace echofuse::recon {

class ArrayView {
 public:
  ArrayView() = default;
  explicit ArrayView(const Axis& lags);  // a count of 0 means no antennas

  std::size_t size() const;                       // features of a body; 0 without antennas
  static constexpr std::size_t of_direction = 2;  // the number of features before the lags
  std::size_t cost() const;                       // multiply-adds
  // Fills size() features from a record's lags above the background. First come the direction
  // cosine u, and u times the range (metres). Then come the lags of the window about the body and
  // of parts of it, over the power of the window; those across are turned by exp(-i pi d u). All
  // are zero if the window has no power.
  void operator()(std::span<const float> lags, double range_m, std::span<float> out) const;
  // Turns the features as if the same body stood in another direction.
  static void turn(double by, double range_m, std::span<float> features);

 private:
  using Lags = std::vector<std::complex<double>>;
  void add(std::span<const float> bin, double weight, Lags& to) const;
  double direction_of(const Lags& sum) const;

  // Number of lags in use, at most `most` of each kind.
  std::size_t lags_of(std::size_t most) const;

  std::size_t across_ = 0, up_ = 0, bins_ = 0, parts_ = 0;
  double first_m_ = 0, step_m_ = 1, part_m_ = 1;
};

}  // namespace echofuse::recon
