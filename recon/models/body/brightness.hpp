// SPDX-License-Identifier: MIT
// How strong the radar sees a body against the SPD, which tells its side as long as no gain
// changes: the radar's power falls with the fourth power of its own distance (radar equation,
// Skolnik, Introduction to Radar Systems, 1.2), so at the SPD's range r by 4 b / r^2 a metre to the
// right, while the SPD's clicks stay. Bodies differ by more than that, so it helps a shift's
// reading and does not replace it.
#pragma once
#include <cstddef>
#include <span>

#include "acquire/record/h5.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// unknown: laser power, exposure and radar gain may differ between runs. stable: they do not.
enum class Gains : bool { unknown, stable };

class Brightness {
 public:
  // What a record says of it: value, and 1. Both are 0 where it is not known.
  static constexpr std::size_t features = 2;

  // Learns what is usual at a range; a row: range (m), value of write() before that.
  void fit(const Matrix& range_and_value);
  // Of clicks and power around a body there, both above what is always there.
  void write(float clicks, float power, float range_m, std::span<float> out) const;
  static bool known(std::span<const float> brightness) { return brightness[1] != 0; }
  static void forget(std::span<float> brightness) { brightness[0] = brightness[1] = 0; }
  // Of a body that the radar now sees so many times as strongly.
  static void strengthen(std::span<float> brightness, double times);

  void save(record::H5File& file) const;  // as "alignment/brightness"
  static bool is_in(const record::H5File& file) { return file.has("alignment/brightness"); }
  void load(const record::H5File& file);

 private:
  double level_ = 0, slope_ = 0;  // of the logarithm, over that of the range in metres
};

}  // namespace echofuse::recon
