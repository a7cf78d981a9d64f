// SPDX-License-Identifier: MIT
// Statistics of the radar's virtual antennas per slot (TLV 4 or 8 of TI's demo): second-order
// statistics of the complex samples x over the slot's frames, for each range bin. Beam power, its
// mean over looks, and static background subtraction are linear in them. A later phase calibration
// can still be applied. Angle estimators need no other data (Van Trees, Optimum Array Processing,
// 2002, 2.5 and 7.1).
#pragma once
#include <complex>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/bytes.hpp"
#include "drivers/core/clones.hpp"

namespace echofuse::record {

// Virtual antenna with the gain and phase error of its samples. Position in half wavelengths, right
// and up as seen from behind the radar (table antenna of the run file).
struct Antenna {
  double x = 0, y = 0;
  double gain = 1, phase_rad = 0;

  bool operator==(const Antenna&) const = default;
};
using Antennas = std::vector<Antenna>;

inline constexpr std::size_t most_antennas = 12;

// Values of one range bin, in this order: mean sample of each antenna; power of each antenna;
// covariance, mean of x_m conj(x_n) for m < n, row by row; correlation of consecutive frames, mean
// of sum_m x_m(t) conj(x_m(t-1)). A complex number is a pair: real part, imaginary part. Samples
// are in the firmware's integer units, and all other values in their squares.
struct ArrayBin {
  std::span<const float> values;
  std::size_t antennas = 0;

  std::complex<float> mean(std::size_t m) const { return pair(2 * m); }
  std::complex<float> covariance(std::size_t m, std::size_t n) const;  // E[x_m conj(x_n)]
  std::complex<float> lag() const { return pair(values.size() - 2); }
  float power() const;  // mean over all antennas

 private:
  std::complex<float> pair(std::size_t i) const { return {values[i], values[i + 1]}; }
};

// Returns 2 A + A + A (A - 1) + 2.
std::size_t values_of_bin(std::size_t antennas);
ArrayBin bin_of(std::span<const float> array, std::size_t antennas, std::size_t bin);

// Returns the power from direction cosine u at v = 0 (Bartlett beamformer):
//   sum_mn R_mn / (h_m conj(h_n)) exp(-i pi (x_m - x_n) u) / A^2,  h = gain exp(i phase).
// A wave with power P in each antenna gives P in its own direction.
double beam_power(const ArrayBin& bin, const Antennas& antennas, double u);
// Number of beams of the range-direction image.
inline constexpr std::size_t beams = 32;
constexpr double beam_cosine(std::size_t k) {
  return (2.0 * static_cast<double>(k) + 1) / beams - 1;
}

// Accumulates frames of bins times antennas samples, antennas fastest.
class ArrayStatistics {
 public:
  ArrayStatistics(std::size_t bins, std::size_t antennas);
  void add(std::span<const std::complex<float>> frame);
  // Adds a frame of at most `lanes` bins: for each antenna `lanes` real parts, then `lanes`
  // imaginary parts.
  void add_planes(const float* re, const float* im);
  // Marks a lost frame: the frames before and after it are not consecutive.
  void skip() { has_before_ = false; }
  std::size_t frames() const { return frames_; }
  // Returns the array of a record, empty without frames, and resets the sums.
  std::vector<float> take();

 private:
  void add_block(std::size_t block, const float* re, const float* im);
  void count();

  std::size_t bins_, antennas_, frames_ = 0, pairs_ = 0;
  bool has_before_ = false;
  // Sums and previous frame, in blocks of `lanes` adjacent bins.
  std::vector<float> sums_, before_;
};

// Packs the array for storage. Each bin has f32 LE s = its power, then i16 LE round(32767 v) of
// each value v in units of s (means: of sqrt(s)). The rounding error is 2^-16 of the bin's power.
Bytes pack_array(std::span<const float> array, std::size_t antennas);
// Unpacks the statistics. Returns the fault of the bytes, or an empty string.
std::string unpack_array(ByteView bytes, std::size_t bins, std::size_t antennas,
                         std::vector<float>& array);

// name "array", quantity "covariance", unit "m", scale = antennas; bins of the range profile up to
// array_end_m, because farther bins are outside the maps' room (depth_map.hpp).
inline constexpr double array_end_m = 8;
Axis array_axis(const Axis& radar, std::size_t antennas);
std::size_t antennas_of(const Axis& array);  // 0: not a valid number of antennas
double array_bytes(const Axis& array);       // stored bytes per record

}  // namespace echofuse::record
