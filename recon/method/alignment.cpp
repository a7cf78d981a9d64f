// SPDX-License-Identifier: MIT
#include "recon/method/alignment.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/util/exit_code.hpp"
#include "recon/numbers/row_product.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Returns the background of each column: 2 x low quantile - median, or 0 if this is negative. If
// the counts of a column vary only by photon noise, the column contains no bodies, and its
// background is the median. `steadiness`: maximum variation of such a column, in Poisson standard
// deviations; 0 for values that are not counts.
std::vector<float> background_of(std::span<const float> low, std::span<const float> median,
                                 double steadiness) {
  std::vector<float> out(low.size());
  for (std::size_t c = 0; c < out.size(); ++c) {
    const bool steady = median[c] - low[c] <
                        static_cast<float>(steadiness) * std::sqrt(steadiness > 0 ? median[c] : 0);
    out[c] = steady ? median[c] : std::max(2 * low[c] - median[c], 0.f);
  }
  return out;
}

void archive_constants(Archive archive) {
  for (const auto& [key, value] : {std::pair{"body_m", method::body_m},
                                   {"significance", method::significance},
                                   {"histogram_m", method::histogram_m},
                                   {"histogram_step_m", method::histogram_step_m},
                                   {"profile_from_m", method::profile_from_m},
                                   {"profile_to_m", method::profile_to_m},
                                   {"least_profile_step_m", method::least_profile_step_m},
                                   {"coarse_step_m", method::coarse_step_m},
                                   {"steps_a_resolution", method::steps_a_resolution},
                                   {"shift_from_m", method::shift_from_m},
                                   {"shift_to_m", method::shift_to_m},
                                   {"part_from_m", method::part_from_m},
                                   {"part_to_m", method::part_to_m},
                                   {"least_part_m", method::least_part_m}}) {
    double number = value;
    archive.number(key, number, value, value);
  }
  for (const auto& [key, value] : {std::pair{"centroid_passes", method::centroid_passes},
                                   {"lags_of_parts", method::lags_of_parts},
                                   {"directions", method::directions},
                                   {"refinements", method::refinements}}) {
    int number = value;
    archive.count(key, number, value, value);
  }
}

}  // namespace

Alignment::Alignment(const Layout& layout, const Matrix& observations, const Rows& rows) {
  if (layout.spd.count == 0)
    throw Error(ExitCode::usage,
                "aligning records needs the detector's histogram; add spd to the inputs");
  set_axes(layout);
  const auto lows = column_quantile(observations, rows, method::background_quantile);
  const auto medians = column_quantile(observations, rows, 0.5);
  const std::span low(lows), median(medians);
  const std::size_t bins = layout.spd.count, points = layout.radar.count;
  counts_background_ = background_of(low.first(bins), median.first(bins), method::steadiness);
  power_background_ = background_of(low.subspan(bins, points), median.subspan(bins, points), 0);
  lags_background_.resize(layout.lag_count());
  if (array_.size() > 0) learn_array_background(observations, rows);
  zones_background_ = background_of(low.last(layout.zone_count()), median.last(layout.zone_count()),
                                    method::steadiness);
}

// Learns the lags of the background in each bin: averages the lags of the records with the least
// power, and scales the averages to the background power. Static echoes keep their directions;
// noise averages out.
void Alignment::learn_array_background(const Matrix& observations, const Rows& rows) {
  const std::size_t first = counts_background_.size() + power_background_.size();
  for (std::size_t at = 0; at < lags_background_.size(); at += lag_values_) {
    std::vector<float> power;
    for (const std::size_t row : rows) power.push_back(observations.row(row)[first + at]);
    const float low = quantile(power, method::background_quantile), median = quantile(power, 0.5);
    const float level = std::max(2 * low - median, 0.f);
    if (!(level > 0)) continue;
    const auto lags = std::span(lags_background_).subspan(at, lag_values_);
    for (const std::size_t row : rows)
      for (std::size_t k = 0; k < lags.size() && observations.row(row)[first + at] <= low; ++k)
        lags[k] += observations.row(row)[first + at + k];
    const float sum = lags[0];
    for (float& v : lags) v *= level / sum;
  }
}

std::vector<float> Alignment::background() const {
  std::vector<float> out = counts_background_;
  out.insert(out.end(), power_background_.begin(), power_background_.end());
  out.insert(out.end(), lags_background_.begin(), lags_background_.end());
  out.insert(out.end(), zones_background_.begin(), zones_background_.end());
  return out;
}

void Alignment::set_background(std::span<const float> observation) {
  for (std::vector<float>* part :
       {&counts_background_, &power_background_, &lags_background_, &zones_background_}) {
    std::copy_n(observation.begin(), part->size(), part->begin());
    observation = observation.subspan(part->size());
  }
}

void Alignment::set_axes(const Layout& layout) {
  spd_first_m_ = layout.spd.at(0.5) / ps_per_m;
  spd_step_m_ = layout.spd.step / ps_per_m;
  if (layout.radar.count > 0)
    radar_first_m_ = layout.radar.start, radar_step_m_ = layout.radar.step;
  points_a_step_ = radar_step_m_ >= method::coarse_step_m ? 2 : 1;
  steps_a_point_ =
      static_cast<std::ptrdiff_t>(std::ceil(method::least_profile_step_m / radar_step_m_));
  profile_step_m_ =
      radar_step_m_ * static_cast<double>(steps_a_point_) / static_cast<double>(points_a_step_);
  array_ = ArrayView(layout.array), lag_values_ = layout.lag_values(), zones_ = layout.zones;
  correlation_ = {};
  if (layout.radar.count > 0)
    correlation_ = ShiftCorrelation({-method::histogram_m + method::histogram_step_m / 2,
                                     method::histogram_step_m, histogram_bins()},
                                    {method::profile_from_m, profile_step_m_, points_with_radar()},
                                    resolution_m(), method::shift_from_m, method::shift_to_m);
}

std::size_t Alignment::cost() const {
  return (counts_background_.size() + zones_background_.size()) * 4 +
         profile_points() * 2 * profile_taps + correlation_.cost() + array_.cost();
}

std::size_t Alignment::histogram_bins() const {
  return static_cast<std::size_t>(std::lround(2 * method::histogram_m / method::histogram_step_m));
}

std::size_t Alignment::zone_bins() const {
  return static_cast<std::size_t>(std::lround(2 * method::histogram_m / method::zone_step_m));
}

std::size_t Alignment::profile_points() const {
  return power_background_.empty() ? 0 : points_with_radar();
}

std::size_t Alignment::points_with_radar() const {
  return 1 + static_cast<std::size_t>((method::profile_to_m - method::profile_from_m) /
                                      profile_step_m_);
}

double Alignment::resolution_m() const { return method::steps_a_resolution * radar_step_m_; }

void Alignment::subtract_background(std::span<const float> observation, std::vector<float>& counts,
                                    std::vector<float>& power) const {
  const std::size_t bins = counts_background_.size();
  counts.resize(bins), power.resize(power_background_.size());
  for (std::size_t i = 0; i < bins; ++i) counts[i] = observation[i] - counts_background_[i];
  subtract_median(counts);
  for (std::size_t i = 0; i < power.size(); ++i)
    power[i] = observation[bins + i] - power_background_[i];
}

Matrix Alignment::zone_counts(std::span<const float> observation) const {
  Matrix out(zones_, zones_ > 0 ? counts_background_.size() : 0);
  const auto recorded = observation.last(out.values.size());
  for (std::size_t i = 0; i < recorded.size(); ++i)
    out.values[i] = recorded[i] - zones_background_[i];
  for (std::size_t z = 0; z < zones_; ++z) subtract_median(out.row(z));
  return out;
}

void Alignment::correlate(std::span<const float> histogram, std::span<const float> profile,
                          std::span<float> out) const {
  if (!out.empty()) correlation_(histogram, profile, out);
}

void Alignment::antennas_about(double range_m, std::span<const float> recorded_lags,
                               std::span<float> out) const {
  std::fill(out.begin(), out.end(), 0.f);
  if (out.empty() || recorded_lags.empty()) return;
  std::vector<float> lags(recorded_lags.begin(), recorded_lags.end());
  for (std::size_t i = 0; i < lags.size(); ++i) lags[i] -= lags_background_[i];
  array_(lags, range_m, out);
}

void Alignment::move_array(std::span<const float> recorded_lags, double farther_m, double by_cosine,
                           std::span<float> view) const {
  const AlignmentColumns at = columns(view);
  const auto range_m = double{at.range_m};
  antennas_about(range_m - farther_m, recorded_lags, at.antennas);
  ArrayView::turn(by_cosine, range_m, at.antennas);
}

void Alignment::archive(Archive archive, const Layout& layout) {
  archive_constants(archive.in("config"));
  if (archive.reading()) set_axes(layout);
  archive.values("counts", counts_background_, layout.spd.count);
  archive.values("power", power_background_, layout.radar.count);
  archive.values("lags", lags_background_, layout.lag_count());
  if (layout.zones == 0) return;
  double step_m = method::zone_step_m;
  archive.in("config").number("zone_step_m", step_m, step_m, step_m);
  archive.values("zones", zones_background_, layout.zone_count());
}

namespace {

// Each histogram bin is divided into this number of parts, because its clicks are spread over its
// width.
constexpr int parts = 4;

double power_of(double in_resolutions) {
  const double x = M_PI * in_resolutions;
  const double amplitude = std::abs(x) < 1e-6 ? 1 : std::sin(x) / x;
  return amplitude * amplitude;
}

}  // namespace

ShiftCorrelation::ShiftCorrelation(const Points& histogram, const Points& profile,
                                   double resolution_m, double shift_from_m, double shift_to_m) {
  const auto near = static_cast<std::ptrdiff_t>(std::floor(shift_from_m / profile.step_m));
  const auto far = static_cast<std::ptrdiff_t>(std::ceil(shift_to_m / profile.step_m));
  shifts_ = static_cast<std::size_t>(far - near) + 1;
  blur_ = Matrix(histogram.count, profile.count + shifts_ - 1);
  for (std::size_t i = 0; i < blur_.rows; ++i)
    for (std::size_t g = 0; g < blur_.cols; ++g) {
      const double at_m =
          profile.first_m + (static_cast<double>(g) - static_cast<double>(far)) * profile.step_m;
      const double bin_m = histogram.first_m + static_cast<double>(i) * histogram.step_m;
      double sum = 0;
      for (int k = 0; k < parts; ++k)
        sum +=
            power_of((at_m - bin_m - ((k + 0.5) / parts - 0.5) * histogram.step_m) / resolution_m);
      blur_.row(i)[g] = static_cast<float>(sum / parts);
    }
}

std::size_t ShiftCorrelation::cost() const {
  return blur_.values.size() + (blur_.cols - shifts_ + 1) * shifts_;
}

void ShiftCorrelation::operator()(std::span<const float> histogram, std::span<const float> profile,
                                  std::span<float> out) const {
  std::vector<float> expected(blur_.cols), squares(blur_.cols + 1);
  add_row_products(1, blur_.cols, histogram.size(), histogram.data(), blur_.values.data(),
                   expected.data());
  for (std::size_t g = 0; g < expected.size(); ++g)
    squares[g + 1] = squares[g] + expected[g] * expected[g];
  std::fill(out.begin(), out.end(), 0.f);
  float own = 0;
  for (std::size_t j = 0; j < profile.size(); ++j) {
    own += profile[j] * profile[j];
    for (std::size_t s = 0; s < shifts_; ++s) out[s] += expected[s + j] * profile[j];
  }
  for (std::size_t s = 0; s < shifts_; ++s) {
    const float norm = std::sqrt(own * (squares[s + profile.size()] - squares[s]));
    out[s] = norm > 0 ? out[s] / norm : 0;
  }
}

}  // namespace echofuse::recon
