// SPDX-License-Identifier: MIT
// Rotation augmentation: creates training records with bodies at more azimuths than were recorded.
// If a body rotates about the SPD's vertical axis, the histogram does not change. The radar is b to
// the left of the SPD and measures the range R' with R'^2 = r^2 + b^2 + 2 b r sin(azimuth).
// Approximation: the profile shifts by the change of R' and keeps its form, although the body also
// turns slightly relative to the radar. The noise of the profile is reused. The lags of the
// antennas are rotated from the direction cosine (b + r sin(azimuth)) / R' of the recorded azimuth
// to that of the new azimuth. If there are antennas, a random bias is added to the radar's range.
// Otherwise the position would be learnt from shifts of centimetres, which differ between runs. If
// the detector has zones, no body is rotated, because it would appear in other zones.
#pragma once
#include <span>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"

namespace echofuse::recon {

// Records that show a body both in the view and in the depth map.
struct SeenBodies {
  Rows rows;
  std::vector<Place> places;  // position of the body in each of these rows
};
// Returns those of `rows` that show a body.
SeenBodies bodies_in(const Matrix& views, const Matrix& maps, const Rows& rows,
                     std::span<const float> background, const record::MapGrid& grid);

// Training bodies, rotated about the SPD. Keeps references to the arguments of the constructor.
class RotatedBodies {
 public:
  // `inputs` (see Alignment::with_correlations), `radar` (recorded power) and `array` (recorded
  // lags, unused if the alignment has no antennas) have one row per record. `rows`: records with a
  // body. `places`: positions of these bodies, in the same order.
  RotatedBodies(const Alignment& alignment, const Matrix& inputs, const Matrix& radar,
                const Matrix& array, const Rows& rows, const std::vector<Place>& places);
  // Sets the fraction of the bodies that rotate() rotates; the default is all bodies.
  void rotate_share(double share) { share_ = share; }

  // Returns how far the radar is to the left of the SPD, m (negative: to the right). The distance
  // is fitted to the displacement of the profiles as a function of azimuth. Returns 0 if the
  // standard error of this distance exceeds a tenth of the distance. If there are antennas, returns
  // 0 only if the standard error also exceeds 3 cm.
  double baseline_m() const { return baseline_m_; }
  bool rotates() const { return rotates_; }  // false: no body is rotated
  // Returns true if rotate() changes any record.
  bool changes() const { return rotates_ || has_array_; }
  // Returns the increase in radar range, m, that would result if the body of rows[k] moved to the
  // azimuth of the body of rows[as].
  double farther_m(std::size_t k, std::size_t as) const;
  // Writes the inputs of record rows[k], rotated to the azimuth of a random record, so that the
  // distribution of azimuths does not change. Returns the new position of the body.
  Place rotate(std::size_t k, Rng& rng, std::span<float> inputs) const;

 private:
  double slope_m(double& deviation_m) const;
  double displacement_gain() const;

  const Alignment& alignment_;
  const Matrix &inputs_, &radar_, &array_;
  const Rows& rows_;
  const std::vector<Place>& places_;
  double baseline_m_ = 0, share_ = 1;
  bool rotates_ = false, has_array_ = false;
};

// Bodies that are summed to form one record: indices of a body, and of the body that provides its
// azimuth.
struct BodySource {
  std::size_t k, as;
};
using BodySum = std::vector<BodySource>;
// Returns the views of sums of `bodies`, without the correlation. Row k of `observations` belongs
// to body k, and row i of `radar` to record i. `rotated` is null if no body is rotated.
Matrix summed_views(const std::vector<BodySum>& sums, const Alignment& alignment,
                    const Matrix& observations, const Matrix& radar, const SeenBodies& bodies,
                    const RotatedBodies* rotated);

}  // namespace echofuse::recon
