// SPDX-License-Identifier: MIT
// Spatial lags of the radar's antennas. A record contains the covariance of the antennas
// (acquire/measurement/radar_array.hpp). The azimuth follows from the spatial correlation
//
//   c_d = mean of R_mn / (g_m g_n exp(i (p_m - p_n))) over horizontal pairs m, n with x_m - x_n = d
// with gains g and phases p of the antennas' calibration. The elevation follows from the same mean
// over vertical pairs. A scatterer of power P at direction cosine u gives c_d = P exp(i pi d u).
// The lags are linear in power, like the range profile; noise affects only c_0. A uniform line
// allows averaging over equal spacings (Van Trees, Optimum Array Processing, 2002, 6.3). Pairs that
// are neither horizontal nor vertical are not used.
#pragma once
#include <complex>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "drivers/core/axis.hpp"

namespace echofuse::recon {

// Largest lag that is used, in half wavelengths; supported boards have lags up to 7.
inline constexpr std::size_t max_lags = 16;

class SpatialLags {
 public:
  SpatialLags() = default;
  explicit SpatialLags(const record::Antennas& antennas);
  // Returns the number of lags, D. c_1..c_across belong to horizontal antenna pairs, and the
  // remaining lags to vertical pairs. D is 0 if there are no horizontal pairs.
  std::size_t longest() const { return across_ + up_; }
  // Returns the quantity of the lag axis: "lags" if all lags are horizontal, "lags, 3 up" (lags_up)
  // if three lags are vertical, or "lags 1 3" if antenna pairs with lag 2 are missing.
  std::string quantity() const;
  // Writes c_0, then the real and imaginary parts of c_1..c_D. c_d is 0 if no antenna pair has
  // spacing d.
  void operator()(const record::ArrayBin& bin, std::span<float> out) const;
  // Writes the lags of each range bin of a record's antenna data, until `out` is full.
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

inline std::size_t lag_values(std::size_t longest) { return 2 * longest + 1; }

// Returns the lag axis for a run's antenna axis. The count of the lag axis is 0 if the antennas
// cannot measure the azimuth.
Axis lags_axis(const Axis& array, const SpatialLags& lags);

}  // namespace echofuse::recon
