// SPDX-License-Identifier: MIT
// More training records of a place than were recorded. Turned about the SPD's vertical axis, a body
// leaves the histogram exactly as it is, and the radar, b to the left of the SPD, sees it at
// R'^2 = r^2 + b^2 + 2 b r sin(azimuth). That its profile moves by this and keeps its form is an
// approximation: the body also turns a little against the radar. The profile's noise is used again.
// What the radar's antennas see turns along: in cosines of direction from (b + r sin) / R' of one
// azimuth to that of the other. With antennas the ranges of the two sensors also get a random bias
// against each other, each time anew, so that the place is not learnt from a shift of centimetres
// which the next run need not have.
#pragma once
#include <span>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"

namespace echofuse::recon {

// Refers to what it is made of.
class TurnedBodies {
 public:
  // inputs (Alignment::with_correlations), the radar's power and its lags (not looked at if the
  // alignment has none) as recorded: a record a row; rows: those of them with a body, places: where
  // these stand, in the same order.
  TurnedBodies(const Alignment& alignment, const Matrix& inputs, const Matrix& radar,
               const Matrix& array, const Rows& rows, const std::vector<Place>& places);
  // Of the bodies that turn() is asked for, as many are turned; all unless said.
  void turn_share(double share) { share_ = share; }

  // How far the radar stands to the left of the SPD, metres (negative: to the right), as the
  // profiles' displacement follows the places. 0 if it cannot be told to a tenth, or with antennas,
  // which need no baseline, to 3 cm.
  double baseline_m() const { return baseline_m_; }
  bool turns() const { return turns_; }  // else nobody is to be turned
  // turn() does anything at all.
  bool changes() const { return turns_ || has_array_; }
  // How much farther the radar would see the body of rows[k] in the azimuth of that of rows[as].
  double farther_m(std::size_t k, std::size_t as) const;
  // Writes the inputs of the record rows[k] turned to the azimuth of any of them, so that these
  // keep their distribution, and returns its place there.
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
