// SPDX-License-Identifier: MIT
#include "recon/method/rotation.hpp"

#include <algorithm>
#include <cmath>

#include "recon/method/method.hpp"
#include "recon/numbers/parallel.hpp"

namespace echofuse::recon {
namespace {

constexpr double significance = 10;  // minimum baseline, in standard deviations of its estimate
// Profile shift used to measure displacement_gain(), m. It is similar to the distances between the
// bodies of a data set.
constexpr double probe_m = 0.05;
constexpr std::size_t max_probed = 200;
// Required accuracy of the baseline estimate, m, if the antennas measure the direction of the body.
constexpr double min_deviation_m = 0.03;
constexpr double max_range_bias_m = 0.15;  // maximum random range bias that rotate() adds, m

double sine_of(const Place& place) {
  const auto tangent = double{place.tangent};
  return tangent / std::hypot(1.0, tangent);
}

double radar_range_m(double range_m, double baseline_m, double sine) {
  return std::sqrt(range_m * range_m + baseline_m * baseline_m + 2 * baseline_m * range_m * sine);
}

}  // namespace

SeenBodies bodies_in(const Matrix& views, const Matrix& maps, const Rows& rows,
                     std::span<const float> background, const record::MapGrid& grid) {
  SeenBodies out;
  for (const std::size_t row : rows)
    if (const auto place = place_of(maps.row(row), background, grid);
        place && shows_body(views.row(row)))
      out.rows.push_back(row), out.places.push_back(*place);
  return out;
}

RotatedBodies::RotatedBodies(const Alignment& alignment, const Matrix& inputs, const Matrix& radar,
                             const Matrix& array, const Rows& rows,
                             const std::vector<Place>& places)
    : alignment_(alignment),
      inputs_(inputs),
      radar_(radar),
      array_(array),
      rows_(rows),
      places_(places),
      has_array_(alignment.array_features() > 0) {
  if (!alignment.turns_bodies()) return;
  double deviation_m = 0;
  const double slope = slope_m(deviation_m), gain = displacement_gain();
  // False if all records are equal (slope 0/0), so that no body is rotated.
  rotates_ = std::abs(slope) > significance * deviation_m ||
             (has_array_ && deviation_m < min_deviation_m * gain);
  if (rotates_) baseline_m_ = slope / gain;
}

// Returns the slope of a least-squares line, fitted to displacement_m() as a function of the sine
// of the azimuth. To first order in b / r, the slope is the baseline b. `deviation_m`: standard
// error of the slope.
double RotatedBodies::slope_m(double& deviation_m) const {
  const auto n = static_cast<double>(rows_.size());
  double s = 0, d = 0, ss = 0, sd = 0, dd = 0;
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    const double sine = sine_of(places_[k]);
    const double displacement_m =
        alignment_.displacement_m(inputs_.row(rows_[k]).last(alignment_.size()));
    s += sine / n, d += displacement_m / n;
    ss += sine * sine / n, sd += sine * displacement_m / n;
    dd += displacement_m * displacement_m / n;
  }
  const double variance = ss - s * s, slope = (sd - s * d) / variance;
  deviation_m = std::sqrt(std::max(dd - d * d - slope * slope * variance, 0.0) / (variance * n));
  return slope;
}

// Returns the change of displacement_m() per metre of profile shift. It is below 1 if noise pulls
// the centroid towards the middle of the window.
double RotatedBodies::displacement_gain() const {
  const std::size_t every = 1 + rows_.size() / max_probed;
  double sum_m = 0, count = 0;
  std::vector<float> moved(inputs_.cols);
  for (std::size_t k = 0; k < rows_.size(); k += every, ++count) {
    const auto record = inputs_.row(rows_[k]);
    std::copy(record.begin(), record.end(), moved.begin());
    for (const double way_m : {probe_m, -probe_m}) {
      alignment_.move_profile(radar_.row(rows_[k]), way_m, moved);
      const std::span<const float> features(moved);
      sum_m += alignment_.displacement_m(features.last(alignment_.size())) * way_m / probe_m;
    }
  }
  return sum_m / (2 * probe_m * count);
}

double RotatedBodies::farther_m(std::size_t k, std::size_t as) const {
  const auto range_m = double{inputs_.row(rows_[k]).back()};
  return radar_range_m(range_m, baseline_m_, sine_of(places_[as])) -
         radar_range_m(range_m, baseline_m_, sine_of(places_[k]));
}

Place RotatedBodies::rotate(std::size_t k, Rng& rng, std::span<float> inputs) const {
  std::uniform_int_distribution<std::size_t> any(0, places_.size() - 1);
  const bool rotated = rotates_ && (share_ == 1 || std::bernoulli_distribution(share_)(rng));
  const double from = sine_of(places_[k]), to = rotated ? sine_of(places_[any(rng)]) : from;
  const auto record = inputs_.row(rows_[k]);
  std::copy(record.begin(), record.end(), inputs.begin());
  const auto range_m = double{record.back()};
  const double range_before_m = radar_range_m(range_m, baseline_m_, from);
  const double range_after_m = radar_range_m(range_m, baseline_m_, to);
  double farther_m = range_after_m - range_before_m;
  if (has_array_) {
    farther_m += std::uniform_real_distribution<double>(-max_range_bias_m, max_range_bias_m)(rng);
    alignment_.move_array(array_.row(rows_[k]), farther_m,
                          (baseline_m_ + range_m * to) / range_after_m -
                              (baseline_m_ + range_m * from) / range_before_m,
                          inputs);
  }
  alignment_.move_profile(radar_.row(rows_[k]), farther_m, inputs);
  const double cosine = std::sqrt(1 - to * to);
  return {static_cast<float>(to / cosine),
          static_cast<float>(double{places_[k].depth_m} * cosine / std::sqrt(1 - from * from))};
}

Matrix summed_views(const std::vector<BodySum>& sums, const Alignment& alignment,
                    const Matrix& observations, const Matrix& radar, const SeenBodies& bodies,
                    const RotatedBodies* rotated) {
  Matrix out(sums.size(), alignment.size());
  for_each_part(out.rows, [&](std::size_t i) {
    const auto first = observations.row(sums[i][0].k);
    std::vector<float> sum(first.begin(), first.end());
    // A real record contains the background only once.
    for (const BodySource& body : std::span(sums[i]).subspan(1))
      for (std::size_t c = 0; c < sum.size(); ++c)
        sum[c] = sum[c] + observations.row(body.k)[c] - alignment.background()[c];
    align(sum, alignment, out.row(i));
    if (!rotated || !shows_body(out.row(i))) return;
    std::vector<Alignment::MovedProfile> moved;
    for (const auto& [k, as] : sums[i])
      moved.push_back({radar.row(bodies.rows[k]), rotated->farther_m(k, as)});
    alignment.add_profiles(moved, out.row(i));
  });
  return out;
}

}  // namespace echofuse::recon
