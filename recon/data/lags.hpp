// SPDX-License-Identifier: MIT
// The estimator takes the radar's antennas as lags. A record keeps the covariance of the antennas
// (acquire/measurement/radar_array.hpp); an azimuth shows only in the spatial correlation
//
//   c_d = mean of R_mn / (g_m g_n exp(i (p_m - p_n))) over m, n side by side with x_m - x_n = d
//
// with gains g and phases p of the antennas' calibration. An elevation shows in the same of
// antennas one above the other. One scatterer of power P at direction cosine u makes c_d = P exp(i
// pi d u). The lags are linear in power, as the range profile is; noise adds to c_0 alone.
// Averaging equal spacings is what a uniform line allows (Van Trees, Optimum Array Processing,
// 2002, 6.3). Antennas that are neither side by side nor one above the other make no lag.
#pragma once
#include <complex>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "drivers/core/axis.hpp"
#include "recon/data/shift.hpp"
#include "recon/numbers/layout.hpp"

namespace echofuse::recon {

// Boards have 7 at most; antennas farther apart make no pair.
inline constexpr std::size_t most_lags = 16;

class SpatialLags {
 public:
  SpatialLags() = default;
  explicit SpatialLags(const record::Antennas& antennas);
  // D counts the lags of antennas side by side, c_1..c_across, and behind them those of antennas
  // one above the other. It is 0 if no two antennas are side by side.
  std::size_t longest() const { return across_ + up_; }
  // Quantity of such an axis: "lags", "lags, 3 up" (lags_up), or "lags 1 3" if no antennas are 2
  // apart.
  std::string quantity() const;
  // Writes c_0, then the real and imaginary parts of c_1..c_D; c_d is 0 where no two antennas are
  // that far apart.
  void operator()(const record::ArrayBin& bin, std::span<float> out) const;
  // Same for each bin of a record's array, as many bins as `out` has room for.
  void operator()(std::span<const float> array, std::size_t antennas, std::span<float> out) const;

 private:
  struct Pair {
    std::size_t m, n, lag;
    std::complex<float> factor;
  };
  std::size_t across_ = 0, up_ = 0;
  std::vector<float> power_factors_;
  std::vector<Pair> pairs_;
};

// The axis has such a quantity, and its scale is D.
inline std::size_t longest_lag(const Axis& lags) { return static_cast<std::size_t>(lags.scale); }
inline std::size_t lag_values(std::size_t longest) { return 2 * longest + 1; }
// Returns the number of values of a record.
inline std::size_t lag_columns(const Axis& lags) {
  return lags.count > 0 ? lags.count * lag_values(longest_lag(lags)) : 0;
}

// Returns a run's array axis in lags; its count is 0 if the array tells no azimuth.
Axis lags_axis(const Axis& array, const SpatialLags& lags);

// Moves a record's lags along the range.
void move_lags(std::span<float> lags, const Axis& axis, const Shift& shift);

}  // namespace echofuse::recon
