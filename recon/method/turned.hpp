// SPDX-License-Identifier: MIT
// Turning makes more training records of a place than were recorded. Turned about the SPD's
// vertical axis, a body leaves the histogram exactly as it is, and the radar, b to the left of the
// SPD, sees it at R'^2 = r^2 + b^2 + 2 b r sin(azimuth). It is an approximation that the body's
// profile moves by this and keeps its form: the body also turns a little against the radar. The
// profile's noise is used again. The lags of the radar's antennas turn along: in cosines of
// direction from (b + r sin) / R' of one azimuth to that of the other. With antennas the ranges of
// the two sensors also get a random bias against each other, each time anew, so that the place is
// not learnt from a shift of centimetres which the next run need not have. A detector with zones
// would see a turned body in other zones: with zones no body is turned.
#pragma once
#include <span>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"

namespace echofuse::recon {

// The object keeps references to its arguments.
class TurnedBodies {
 public:
  // `inputs` (Alignment::with_correlations), `radar` (the recorded power) and `array` (the recorded
  // lags, not used if the alignment has none) have a record a row. `rows` are the rows with a body;
  // `places` are where these bodies stand, in the same order.
  TurnedBodies(const Alignment& alignment, const Matrix& inputs, const Matrix& radar,
               const Matrix& array, const Rows& rows, const std::vector<Place>& places);
  // turn() turns this share of the bodies that it is asked for; the default is all.
  void turn_share(double share) { share_ = share; }

  // Distance of the radar to the left of the SPD, in metres (negative: right), fitted to the
  // profiles' displacement by place. 0 if not known to a tenth or, with antennas, to 3 cm.
  double baseline_m() const { return baseline_m_; }
  bool turns() const { return turns_; }  // if false, no body is turned
  // True if turn() changes anything.
  bool changes() const { return turns_ || has_array_; }
  // Returns how much farther away the radar would see the body of rows[k] in the azimuth of
  // rows[as], in metres.
  double farther_m(std::size_t k, std::size_t as) const;
  // Writes the inputs of the record rows[k], turned to the azimuth of a random one of the records,
  // so that the azimuths keep their distribution. Returns its place there.
  Place turn(std::size_t k, Rng& rng, std::span<float> inputs) const;

 private:
  double slope_m(double& deviation_m) const;
  double answer() const;

  const Alignment& alignment_;
  const Matrix &inputs_, &radar_, &array_;
  const Rows& rows_;
  const std::vector<Place>& places_;
  double baseline_m_ = 0, share_ = 1;
  bool turns_ = false, has_array_ = false;
};

}  // namespace echofuse::recon
