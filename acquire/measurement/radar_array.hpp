// SPDX-License-Identifier: MIT
// Statistics that a slot keeps of the radar's virtual antennas (TLV 4 or 8 of TI's demo): for each
// range bin the second-order statistics of the complex samples x over the slot's frames. Any beam's
// power, its mean over looks, and the subtraction of what stands still are linear in them, and a
// phase calibration that is measured later can still be applied: nothing that an estimator of
// angles uses is lost (Van Trees, Optimum Array Processing, 2002, 2.5 and 7.1).
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

// A virtual antenna: where it stands in half wavelengths (right and up as seen from behind the
// radar; table antenna of the run file) and by what its samples are too strong and too far ahead.
struct Antenna {
  double x = 0, y = 0;
  double gain = 1, phase_rad = 0;

  bool operator==(const Antenna&) const = default;
};
using Antennas = std::vector<Antenna>;

inline constexpr std::size_t most_antennas = 12;

// One range bin, in this order: mean sample of each antenna; power of each antenna; mean of
// x_m conj(x_n) for m < n, row by row; mean of sum_m x_m(t) conj(x_m(t-1)) from a frame to the
// next. Complex numbers are real, imaginary. Units: the firmware's integers, squared where it is a
// power.
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

// 2 A + A + A (A - 1) + 2
std::size_t values_of_bin(std::size_t antennas);
ArrayBin bin_of(std::span<const float> array, std::size_t antennas, std::size_t bin);

// Power that comes from direction cosine u at v = 0 (Bartlett's beam):
//   sum_mn R_mn / (h_m conj(h_n)) exp(-i pi (x_m - x_n) u) / A^2,  h = gain exp(i phase).
// A wave of power P in each antenna gives P at its own direction.
double beam_power(const ArrayBin& bin, const Antennas& antennas, double u);
// Beams of the picture of power by range and direction.
inline constexpr std::size_t beams = 32;
constexpr double beam_cosine(std::size_t k) {
  return (2.0 * static_cast<double>(k) + 1) / beams - 1;
}

// Sums up frames: bins times antennas samples each, antennas fastest.
class ArrayStatistics {
 public:
  ArrayStatistics(std::size_t bins, std::size_t antennas);
  void add(std::span<const std::complex<float>> frame);
  // A frame of at most `lanes` bins: for each antenna `lanes` real parts, and so many imaginary
  // ones.
  void add_planes(const float* re, const float* im);
  // The frame before this one was lost: the two are no neighbours.
  void skip() { has_before_ = false; }
  std::size_t frames() const { return frames_; }
  // The array of a record, empty without a frame; starts afresh.
  std::vector<float> take();

 private:
  void add_block(std::size_t block, const float* re, const float* im);
  void count();

  std::size_t bins_, antennas_, frames_ = 0, pairs_ = 0;
  bool has_before_ = false;
  // By blocks of `lanes` bins, which lie side by side: sums, and planes of the frame before.
  std::vector<float> sums_, before_;
};

// As it is stored: for each bin f32 LE s = its power, then i16 LE round(32767 v) of each value in
// units of s (means: of sqrt(s)). Rounding is 2^-16 of the bin's power.
Bytes pack_array(std::span<const float> array, std::size_t antennas);
// Unpacks the statistics; returns the fault of the bytes, or "".
std::string unpack_array(ByteView bytes, std::size_t bins, std::size_t antennas,
                         std::vector<float>& array);

// name "array", quantity "covariance", unit "m", scale = antennas; bins as the range profile's, up
// to array_end_m: what stands farther is outside the room that maps show (depth_map.hpp).
inline constexpr double array_end_m = 8;
Axis array_axis(const Axis& radar, std::size_t antennas);
std::size_t antennas_of(const Axis& array);  // 0: not a number of antennas
double array_bytes(const Axis& array);       // bytes of a record, as stored

}  // namespace echofuse::record
