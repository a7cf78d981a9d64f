// SPDX-License-Identifier: MIT
// More training records of a place than were recorded. Turned about the SPD's vertical axis, a body
// leaves the histogram exactly as it is, and the radar, b to the left of the SPD, sees it at
// R'^2 = r^2 + b^2 + 2 b r sin(azimuth). That its profile moves by this and keeps its form is an
// approximation: the body also turns a little against the radar. The profile's noise is used again.
#pragma once
#include <span>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/models/body/body_frame.hpp"

namespace echofuse::recon {

// Refers to what it is made of.
class TurnedBodies {
 public:
  // inputs (Alignment::with_correlations) and the radar's power as recorded: a record a row; rows:
  // those of them with a body, places: where these stand, in the same order.
  TurnedBodies(const Alignment& alignment, const Matrix& inputs, const Matrix& radar,
               const Rows& rows, const std::vector<Place>& places);

  // How far the radar stands to the left of the SPD, metres (negative: to the right), as the
  // profiles' displacement follows the places. 0 if it cannot be told to a tenth: then nobody is
  // to be turned.
  double baseline_m() const { return baseline_m_; }
  // Writes the inputs of the record rows[k] turned to the azimuth of any of them, so that these
  // keep their distribution, and returns its place there.
  Place turn(std::size_t k, Rng& rng, std::span<float> inputs) const;

 private:
  double slope_m(double& deviation_m) const;
  double answer() const;

  const Alignment& alignment_;
  const Matrix &inputs_, &radar_;
  const Rows& rows_;
  const std::vector<Place>& places_;
  double baseline_m_ = 0;
};

}  // namespace echofuse::recon
