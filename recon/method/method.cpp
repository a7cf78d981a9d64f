// SPDX-License-Identifier: MIT
// From a record to a depth map. Lai et al. (Chin. Opt. Lett. 22, 022701, 2024) concatenate the
// detector's histogram and the radar's profile of a scene I, and learn the inverse:
//
//   H = [H_spd, H_radar] = F(I)      I = F^-1(H), a network
//
// We split F^-1 into a part given by geometry and a part that is learnt (equation numbers are
// ours). The detector counts N_i photons in the bin at range r_i, B_i of them background; the
// radar measures the power p(R) at range R. The body is at x (right of the detector) and z (in
// front of it), at range r from the detector and R from the radar, which is b to the left.
//
//   (1) n_i = N_i - B_i - median      counts above the background; p likewise, without median
//   (2) r = sum n_i r_i / sum n_i     range of the body, over |r_i - r| < body_m
//   (3) h(d) = n(r + d) / sum n       histogram about r, independent of laser power and exposure;
//                                     of zones: h_k(d) = n_k(r + d) / sum n
//   (4) g(d) = p(r + d) / sum p       profile about r, independent of the radar's gain
//   (5) R^2 = r^2 + b^2 + 2 b x,      the difference between the ranges of radar and detector
//       R - r = b x / r + O(b^2)      distinguishes left and right
//   (6) c(s) = <h * psf, g(. + s)> / (|h * psf| |g|)     estimator of R - r, over shifts s; psf:
//                                     the radar's response to a point
//   (7) u = argmax sum (A - d) Re(c_d e^-i pi d u)       direction for A antennas (Bartlett), from
//                                     their spatial correlation c_d at d half wavelengths
//   (8) x, z - r = place network      (c, h, h_k, g, antennas, r)
//   (9) mask, depth = mean + coefficients x components   in a frame that moves with the body
//  (10) map = z + depth / mask where mask > threshold, else the background
#include "recon/method/method.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "recon/method/bin_sums.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

using Values = Eigen::Map<Eigen::ArrayXf>;
using ConstValues = Eigen::Map<const Eigen::ArrayXf>;

Values values(std::span<float> v) { return {v.data(), std::ssize(v)}; }
ConstValues values(std::span<const float> v) { return {v.data(), std::ssize(v)}; }

// The median of a Poisson distribution is lower than its mean by at most ln 2.
constexpr double median_bias = std::numbers::ln2;

// Equation (2): returns the range of the body in metres; 0 if its counts are below `significance`
// standard deviations of all counts. The body's counts exclude the mean count of the other bins, at
// most `median_bias`, because the median in (1) may be too low by this value. `counts`: counts
// above the background, in bins at scene.spd_ranges(); `all`: counts including the background.
float detected_range_m(std::span<const float> counts, std::span<const float> all,
                       const Alignment& scene) {
  const auto [first_m, step_m] = scene.spd_ranges();
  const auto bins = static_cast<double>(counts.size());
  double from = 0, to = bins, centre = 0, width = bins;
  BinSums in;
  for (int pass = 0; pass <= method::centroid_passes; ++pass) {
    // The first pass includes all bins. It ignores negative counts, because noise of both signs
    // would displace the centroid.
    const auto first = static_cast<std::size_t>(from), last = static_cast<std::size_t>(to);
    in = bin_sums(counts, all, first, last, pass == 0 ? Negative::left_out : Negative::counted);
    width = static_cast<double>(last - first);
    if (in.counts <= 0) return 0;
    centre = in.moment / in.counts;
    from = std::clamp(centre - method::body_m / step_m, 0.0, bins);
    to = std::clamp(centre + method::body_m / step_m + 1, 0.0, bins);
  }
  const double outside =
      bin_sums(counts, all, 0, counts.size(), Negative::counted).counts - in.counts;
  const double level = std::clamp(outside / std::max(bins - width, 1.), 0., median_bias);
  const bool detected = in.counts - level * width > method::significance * std::sqrt(in.all);
  return detected ? static_cast<float>(first_m + centre * step_m) : 0;
}

// Equation (3): writes the counts in bins of width `bin_m` around `range_m`, and returns their sum.
// Counts between two edges are differences of the interpolated cumulative sum.
float counts_about(float range_m, std::span<const float> counts, const Alignment& scene,
                   double bin_m, std::span<float> out) {
  std::vector<float> running(counts.size() + 1);
  for (std::size_t i = 0; i < counts.size(); ++i) running[i + 1] = running[i] + counts[i];
  const auto up_to = [&, last = static_cast<double>(counts.size())](double bin) {
    const double x = std::clamp(bin, 0.0, last);
    const auto i = std::min(static_cast<std::size_t>(x), counts.size() - 1);
    return running[i] +
           static_cast<float>(x - static_cast<double>(i)) * (running[i + 1] - running[i]);
  };
  const auto [first_m, step_m] = scene.spd_ranges();
  const double start = (double{range_m} - method::histogram_m - first_m) / step_m + 0.5;
  const double step = bin_m / step_m;
  const float first = up_to(start);
  float before = first;
  for (std::size_t j = 0; j < out.size(); ++j) {
    const float now = up_to(start + static_cast<double>(j + 1) * step);
    out[j] = now - before;
    before = now;
  }
  return before - first;
}

// Applies equation (3) to the sum over the zones and to each zone.
void histograms_about(float range_m, std::span<const float> counts, const Matrix& of_zones,
                      const Alignment& scene, const AlignmentColumns& at) {
  const float sum = counts_about(range_m, counts, scene, method::histogram_step_m, at.histogram);
  if (sum > 0) values(at.histogram) /= sum;
  for (std::size_t z = 0; z < of_zones.rows; ++z)
    counts_about(range_m, of_zones.row(z), scene, method::zone_step_m,
                 at.zones.subspan(z * scene.zone_bins(), scene.zone_bins()));
  if (sum > 0) values(at.zones) /= sum;
}

}  // namespace

// Step 1. The values are, in this order, the histogram H_spd and the range profile H_radar of Lai
// et al., the lags of the antennas, and H_spd of each zone.
Matrix observe(const Dataset& data, const Rows& rows, const Features& sensors) {
  const Layout layout = sensors.layout();
  Matrix out(rows.size(), layout.inputs());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto to = layout.parts(out.row(i));
    const auto copy = [&](const Column& column, std::span<float> part) {
      std::copy_n(column.row(rows[i]).begin(), part.size(), part.begin());
    };
    if (!to.counts.empty()) std::ranges::copy(counts_of(data, rows[i]), to.counts.begin());
    copy(data.radar(), to.power), copy(data.array(), to.lags), copy(data.spd(), to.zones);
  }
  return out;
}

// Step 2 for one record. Numbers in parentheses refer to the equations at the top of this file.
void align(std::span<const float> observation, const Alignment& scene, std::span<float> view) {
  const AlignmentColumns at = scene.columns(view);
  values(view) = 0;
  std::vector<float> counts, power;
  scene.subtract_background(observation, counts, power);                                    // (1)
  const float range_m = detected_range_m(counts, observation.first(counts.size()), scene);  // (2)
  if (range_m == 0) return;
  const Matrix of_zones = scene.zone_counts(observation);
  histograms_about(range_m, counts, of_zones, scene, at);     // (3)
  scene.profile_about(double{range_m}, power, at.profile);    // (4)
  scene.correlate(at.histogram, at.profile, at.correlation);  // equations (5) and (6)
  scene.antennas_about(double{range_m}, scene.parts(observation).lags, at.antennas);  // (7)
  at.range_m = range_m;
}

Matrix align(const Matrix& observations, const Alignment& scene) {
  Matrix out(observations.rows, scene.inputs());
  for_each_part(out.rows, [&](std::size_t i) { align(observations.row(i), scene, out.row(i)); });
  return out;
}

void standardise(std::span<float> view, const BodyModel& model) {
  values(view) = (values(view) - values(std::span<const float>(model.centre))) /
                 values(std::span<const float>(model.deviation));
}

BodyViews body_views(const Matrix& views, const BodyModel& model) {
  BodyViews out;
  for (std::size_t i = 0; i < views.rows; ++i)
    if (shows_body(views.row(i))) out.rows.push_back(i);
  out.views = take_rows(views, out.rows);
  for (std::size_t i = 0; i < out.views.rows; ++i) standardise(out.views.row(i), model);
  return out;
}

float range_of(std::span<const float> standard_view, const BodyModel& model) {
  return standard_view.back() * model.deviation.back() + model.centre.back();
}

// Step 3, equation (8). The networks estimate two lengths in metres: the lateral position of the
// body at its range, and its mean depth minus that range (usually negative). A Place contains x / z
// and z.
std::vector<Place> place(const Matrix& standard_views, const BodyModel& model) {
  // [m x 2]: lateral position (positive to the right) and depth minus range, m
  const Matrix found = model.place.predict(standard_views);
  const float nearest_m = model.nearest_m;
  std::vector<Place> out;
  for (std::size_t i = 0; i < found.rows; ++i) {
    const float range_m = range_of(standard_views.row(i), model);
    out.push_back({found.row(i)[0] / std::max(range_m, nearest_m),
                   std::max(range_m + found.row(i)[1], nearest_m)});
  }
  return out;
}

// Step 4, equation (9). The networks estimate coefficients in units of the standard deviation of
// the strongest component (unit_of), separately for masks and depths.
Shapes shape(const Matrix& standard_views, const BodyModel& model) {
  const Matrix found =
      model.has_shapes ? model.shape.predict(standard_views) : Matrix(standard_views.rows, 0);
  const auto compose = [&](const Components& components, std::size_t first) {
    Matrix amounts(found.rows, components.basis.rows);
    for (std::size_t i = 0; i < amounts.rows; ++i)
      for (std::size_t k = 0; k < amounts.cols; ++k)
        amounts.row(i)[k] = found.row(i)[first + k] * unit_of(components);
    return from_coordinates(components, amounts);
  };
  return {compose(model.masks, 0), compose(model.depths, model.masks.basis.rows)};
}

// Step 5: applies equation (10) to each body.
void draw(const std::vector<Place>& places, const Shapes& shapes, const BodyModel& model,
          const Rows& rows, Matrix& maps, SoftMaps* soft) {
  for_each_part(rows.size(), [&](std::size_t i) {
    const auto mask = shapes.masks.row(i), depth = shapes.depths.row(i);
    model.frame.draw(mask, depth, places[i], model.threshold, maps.row(rows[i]));
    if (soft)
      model.frame.draw_soft(mask, depth, places[i], soft->foreground_probability.row(rows[i]),
                            soft->depth.row(rows[i]));
  });
}

Matrix reconstruct(const Matrix& views, const BodyModel& model, SoftMaps* soft) {
  Matrix maps = repeated_row(model.background, views.rows);
  if (soft) *soft = {Matrix(maps.rows, maps.cols), maps};
  const BodyViews bodies = body_views(views, model);
  if (!bodies.rows.empty())
    draw(place(bodies.views, model), shape(bodies.views, model), model, bodies.rows, maps, soft);
  return maps;
}

}  // namespace echofuse::recon
