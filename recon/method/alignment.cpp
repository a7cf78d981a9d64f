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

// Writes the background of each column: 2 x low quantile - median, or 0 if this is negative. If
// the counts of a column vary only by photon noise, the column contains no bodies, and its
// background is the median. `steadiness`: maximum variation of such a column, in Poisson standard
// deviations; 0 for values that are not counts.
void put_background(std::span<const float> low, std::span<const float> median, double steadiness,
                    std::span<float> out) {
  for (std::size_t c = 0; c < out.size(); ++c) {
    const bool steady = median[c] - low[c] <
                        static_cast<float>(steadiness) * std::sqrt(steadiness > 0 ? median[c] : 0);
    out[c] = steady ? median[c] : method::background_level(low[c], median[c]);
  }
}

void archive_constants(Archive archive) {
  for (const auto& [key, value] : {std::pair{"body_m", method::body_m},
                                   {"significance", method::significance},
                                   {"histogram_m", method::histogram_m},
                                   {"histogram_step_m", method::histogram_step_m},
                                   {"profile_from_m", method::profile_from_m},
                                   {"profile_to_m", method::profile_to_m},
                                   {"least_profile_step_m", method::min_profile_step_m},
                                   {"coarse_step_m", method::coarse_step_m},
                                   {"steps_a_resolution", method::steps_a_resolution},
                                   {"shift_from_m", method::shift_from_m},
                                   {"shift_to_m", method::shift_to_m},
                                   {"part_from_m", method::part_from_m},
                                   {"part_to_m", method::part_to_m},
                                   {"least_part_m", method::min_part_m}}) {
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
  background_.resize(layout.inputs());
  const auto low = parts(lows), median = parts(medians);
  const auto out = layout_.parts(std::span(background_));
  put_background(low.counts, median.counts, method::steadiness, out.counts);
  put_background(low.power, median.power, 0, out.power);
  if (array_.size() > 0) learn_array_background(observations, rows);
  put_background(low.zones, median.zones, method::steadiness, out.zones);
}

// Learns the lags of the background in each bin: averages the lags of the records with the least
// power, and scales the averages to the background power. Static echoes keep their directions;
// noise averages out.
void Alignment::learn_array_background(const Matrix& observations, const Rows& rows) {
  const auto background = layout_.parts(std::span(background_)).lags;
  const std::size_t values = layout_.array.values_per_bin();
  for (std::size_t at = 0; at < background.size(); at += values) {
    const auto lags_of = [&](std::size_t row) {
      return parts(observations.row(row)).lags.subspan(at, values);
    };
    std::vector<float> power;
    for (const std::size_t row : rows) power.push_back(lags_of(row)[0]);
    const float low = quantile(power, method::background_quantile), median = quantile(power, 0.5);
    const float level = method::background_level(low, median);
    if (!(level > 0)) continue;
    const auto lags = background.subspan(at, values);
    for (const std::size_t row : rows)
      for (std::size_t k = 0; k < values && lags_of(row)[0] <= low; ++k) lags[k] += lags_of(row)[k];
    const float sum = lags[0];
    for (float& v : lags) v *= level / sum;
  }
}

void Alignment::set_axes(const Layout& layout) {
  layout_ = layout;
  spd_first_m_ = layout.spd.at(0.5) / ps_per_m;
  spd_step_m_ = layout.spd.step / ps_per_m;
  if (layout.radar.count > 0)
    radar_first_m_ = layout.radar.start, radar_step_m_ = layout.radar.step;
  points_a_step_ = radar_step_m_ >= method::coarse_step_m ? 2 : 1;
  steps_a_point_ =
      static_cast<std::ptrdiff_t>(std::ceil(method::min_profile_step_m / radar_step_m_));
  profile_step_m_ =
      radar_step_m_ * static_cast<double>(steps_a_point_) / static_cast<double>(points_a_step_);
  array_ = ArrayView(layout.array);
  correlation_ = {};
  if (layout.radar.count > 0)
    correlation_ = ShiftCorrelation({-method::histogram_m + method::histogram_step_m / 2,
                                     method::histogram_step_m, histogram_bins()},
                                    {method::profile_from_m, profile_step_m_, profile_points()},
                                    resolution_m(), method::shift_from_m, method::shift_to_m);
}

std::size_t Alignment::cost() const {
  return (layout_.spd.count + layout_.zones_size()) * 4 + profile_points() * 2 * profile_taps +
         correlation_.cost() + array_.cost();
}

std::size_t Alignment::histogram_bins() const {
  return static_cast<std::size_t>(std::lround(2 * method::histogram_m / method::histogram_step_m));
}

std::size_t Alignment::zone_bins() const {
  return static_cast<std::size_t>(std::lround(2 * method::histogram_m / method::zone_step_m));
}

std::size_t Alignment::profile_points() const {
  if (layout_.radar.count == 0) return 0;
  return 1 + static_cast<std::size_t>((method::profile_to_m - method::profile_from_m) /
                                      profile_step_m_);
}

double Alignment::resolution_m() const { return method::steps_a_resolution * radar_step_m_; }

void Alignment::subtract_background(std::span<const float> observation, std::vector<float>& counts,
                                    std::vector<float>& power) const {
  const auto [all, recorded_power, lags, zones] = parts(observation);
  counts.resize(all.size());
  const auto background = parts(background_).counts;
  for (std::size_t i = 0; i < counts.size(); ++i) counts[i] = all[i] - background[i];
  subtract_median(counts);
  power = above_background(recorded_power);
}

Matrix Alignment::zone_counts(std::span<const float> observation) const {
  const auto recorded = parts(observation).zones, background = parts(background_).zones;
  Matrix out(recorded.size() / std::max(layout_.spd.count, 1u), layout_.spd.count);
  for (std::size_t i = 0; i < recorded.size(); ++i) out.values[i] = recorded[i] - background[i];
  for (std::size_t z = 0; z < out.rows; ++z) subtract_median(out.row(z));
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
  const auto background = parts(background_).lags;
  for (std::size_t i = 0; i < lags.size(); ++i) lags[i] -= background[i];
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
  background_.resize(layout.inputs());
  const auto [counts, power, lags, zones] = layout.parts(std::span(background_));
  const auto put = [&](const char* name, std::span<float> part) {
    std::vector<float> values(part.begin(), part.end());
    archive.values(name, values, part.size());
    std::ranges::copy(values, part.begin());
  };
  put("counts", counts), put("power", power), put("lags", lags);
  if (zones.empty()) return;
  double step_m = method::zone_step_m;
  archive.in("config").number("zone_step_m", step_m, step_m, step_m);
  put("zones", zones);
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
