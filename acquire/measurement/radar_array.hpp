// SPDX-License-Identifier: MIT
// Second-order statistics of the radar's virtual antennas in a slot (TLV 4 or 8 of TI's demo). They
// are computed for each range bin from the complex samples x of all frames of the slot. Beam power
// and static background subtraction are linear in these statistics, and a phase calibration can be
// applied later. Angle estimators need no other data (Van Trees, Optimum Array Processing, 2002,
// 2.5 and 7.1).
#pragma once
#include <cmath>
#include <complex>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/core/clones.hpp"

namespace echofuse::record {

// Virtual antenna, stored in the table `antenna` of a run. Its position (x, y) is in half
// wavelengths, to the right and up as seen from behind the radar. `gain` and `phase_rad` are the
// gain and phase errors of its samples.
struct Antenna {
  double x = 0, y = 0;
  double gain = 1, phase_rad = 0;

  bool plausible() const {
    return std::abs(x) < 1e3 && std::abs(y) < 1e3 && gain >= 1e-3 && gain <= 1e3 &&
           std::abs(phase_rad) < 1e3;
  }
  bool operator==(const Antenna&) const = default;
};
using Antennas = std::vector<Antenna>;

inline constexpr std::size_t max_antennas = 12;

// Statistics of one range bin. `values` contains, in this order: the mean sample of each antenna;
// the mean power of each antenna; the covariances, which are the means of x_m conj(x_n) for m < n,
// row by row; and the correlation of consecutive frames, which is the mean of sum_m x_m(t)
// conj(x_m(t-1)). A complex number has two values: real part, imaginary part. Samples are in the
// firmware's integer units, all other values in squares of these units.
struct ArrayBin {
  std::span<const float> values;
  std::size_t antennas = 0;

  std::complex<float> mean(std::size_t m) const { return pair(2 * m); }
  std::complex<float> covariance(std::size_t m, std::size_t n) const;  // E[x_m conj(x_n)]
  std::complex<float> lag() const { return pair(values.size() - 2); }
  float power() const;  // sum of the powers of all antennas

 private:
  std::complex<float> pair(std::size_t i) const { return {values[i], values[i + 1]}; }
};

// Returns the number of values in a bin if there are A antennas: 2 A + A + A (A - 1) + 2.
std::size_t values_of_bin(std::size_t antennas);
ArrayBin bin_of(std::span<const float> array, std::size_t antennas, std::size_t bin);

// Returns the power received from direction cosine u, with v = 0 (Bartlett beamformer):
//   sum_mn R_mn / (h_m conj(h_n)) exp(-i pi (x_m - x_n) u) / A^2,  h = gain exp(i phase).
// R_mn is the covariance of antennas m and n, x_m the position and h_m the error of antenna m, and
// A the number of antennas. For a plane wave with power P in each antenna, the result is P in the
// direction of the wave.
double beam_power(const ArrayBin& bin, const Antennas& antennas, double u);
// Number of beams of the range-direction image.
inline constexpr std::size_t beams = 32;
constexpr double beam_cosine(std::size_t k) {
  return (2.0 * static_cast<double>(k) + 1) / beams - 1;
}

// Accumulates frames. A frame has bins x antennas samples; the antenna index varies fastest.
class ArrayStatistics {
 public:
  ArrayStatistics(std::size_t bins, std::size_t antennas);
  void add(std::span<const std::complex<float>> frame);
  // Adds a frame of at most `lanes` bins. `re` contains the real parts of the samples and `im`
  // their imaginary parts, with `lanes` values for each antenna.
  void add_planes(const float* re, const float* im);
  // Marks a lost frame, so that the frames before and after it are not treated as consecutive.
  void skip() { has_before_ = false; }
  std::size_t frames() const { return frames_; }
  // Returns the statistics of all frames since the last call, or nothing if there were no frames.
  // Then resets the sums.
  std::vector<float> take();

 private:
  void add_block(std::size_t block, const float* re, const float* im);
  void count();

  std::size_t bins_, antennas_, frames_ = 0, pairs_ = 0;
  bool has_before_ = false;
  // Sums and the previous frame, both stored in blocks of `lanes` adjacent bins.
  std::vector<float> sums_, before_;
};

// Packs the statistics for storage. Each bin is stored as f32 LE s = ArrayBin::power(), followed by
// i16 LE round(32767 v / s) for each value v. For mean samples the divisor is sqrt(s). The rounding
// error is 2^-16 s.
Bytes pack_array(std::span<const float> array, std::size_t antennas);
// Unpacks the statistics. Returns an error message (e.g. "has 4 bytes, but ..."), or an empty
// string if the bytes are valid.
std::string unpack_array(ByteView bytes, std::size_t bins, std::size_t antennas,
                         std::vector<float>& array);

// The axis of the statistics has the name "array", the quantity "covariance" and the unit "m"; its
// scale is the number of antennas. It contains the bins of the range profile up to `array_end_m`;
// farther bins are outside the depth maps (depth_map.hpp).
inline constexpr double array_end_m = 8;
Axis array_axis(const Axis& radar, std::size_t antennas);
// Returns the number of antennas; 0 if array.scale is not between 1 and 12.
std::size_t antennas_of(const Axis& array);
double array_bytes(const Axis& array);  // number of bytes stored per record

}  // namespace echofuse::record
