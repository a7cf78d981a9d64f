// SPDX-License-Identifier: MIT
// Features of a body from the radar's antennas: spatial lags c_d (data/lags.hpp) around the range
// measured by the SPD. The first features are the direction of maximum power (Bartlett beam:
// maximum of sum (A - d) Re(c_d exp(-i pi d u)) over the direction cosine u, for A antennas). The
// others are the lags, rotated into that direction. They describe the lateral spread of the body,
// independent of its position, just as the aligned profile describes its spread in range. Lags of
// vertical antenna pairs describe the spread in height and are not rotated.
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
  explicit ArrayView(const Axis& lags);  // no antennas are used if `lags` has count 0

  // Returns the number of features of a body; 0 if there are no antennas.
  std::size_t size() const;
  // Number of direction features, which precede the lags.
  static constexpr std::size_t of_direction = 2;
  std::size_t cost() const;  // number of multiply-adds per record
  // Writes size() features, computed from a record's lags above the background: the direction
  // cosine u; u times the range, m; the lags of the window around the body; and the lags of the
  // parts of this window. All lags are divided by the power of the window, and horizontal lags are
  // multiplied by exp(-i pi d u). All features are 0 if the power in the window is 0.
  void operator()(std::span<const float> lags, double range_m, std::span<float> out) const;
  // Changes the features to those that the same body would have if its direction cosine were larger
  // by `by`.
  static void turn(double by, double range_m, std::span<float> features);

 private:
  using Lags = std::vector<std::complex<double>>;
  void add(std::span<const float> bin, double weight, Lags& to) const;
  double direction_of(const Lags& sum) const;

  // Returns the number of lags that are used: at most `max_lag` horizontal and `max_lag` vertical
  // ones.
  std::size_t lags_of(std::size_t max_lag) const;

  std::size_t across_ = 0, up_ = 0, bins_ = 0, parts_ = 0;
  double first_m_ = 0, step_m_ = 1, part_m_ = 1;
};

}  // namespace echofuse::recon
