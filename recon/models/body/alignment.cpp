// SPDX-License-Identifier: MIT
#include "recon/models/body/alignment.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/exit_code.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double background_quantile = 0.05;  // of the training records: nobody stands everywhere
constexpr float steadiness = 4;               // standard deviations of a Poisson count
constexpr double reach_m = 0.8;               // half the depth of a body with outstretched arms
constexpr int centroid_passes = 3;
constexpr double significance = 5;
constexpr double histogram_reach_m = 0.7, histogram_step_m = 0.04;
// Of the radar profile against the body: a target at x shifts it by b x / r.
constexpr double profile_from_m = -1.0, profile_to_m = 1.3, least_profile_step_m = 0.04;

// What is there in every record: per column the level that few records are below, less its distance
// to the median: where bodies come and go, nothing. A count that scatters like one of photons alone
// is all background: its median.
std::vector<float> background_of(std::span<const float> low, std::span<const float> median,
                                 bool poisson) {
  std::vector<float> out(low.size());
  for (std::size_t c = 0; c < out.size(); ++c) {
    const bool steady = median[c] - low[c] < steadiness * std::sqrt(poisson ? median[c] : 0);
    out[c] = steady ? median[c] : std::max(2 * low[c] - median[c], 0.f);
  }
  return out;
}

}  // namespace

Alignment::Alignment(const Layout& layout, const Matrix& raw_inputs, const Rows& rows) {
  if (layout.spd.count == 0)
    throw Error(ExitCode::usage, "aligning records needs the detector's histogram");
  set_axes(layout);
  const auto lows = column_quantile(raw_inputs, rows, background_quantile);
  const auto medians = column_quantile(raw_inputs, rows, 0.5);
  const std::span low(lows), median(medians);
  const std::size_t clicks = layout.spd.count, powers = layout.radar.count;
  spd_background_ = background_of(low.first(clicks), median.first(clicks), true);
  radar_background_ = background_of(low.last(powers), median.last(powers), false);
}

void Alignment::set_axes(const Layout& layout) {
  spd_first_m_ = layout.spd.at(0.5) / ps_per_m;
  spd_step_m_ = layout.spd.step / ps_per_m;
  if (layout.radar.count > 0)
    radar_first_m_ = layout.radar.start, radar_step_m_ = layout.radar.step;
  profile_step_m_ = std::max(radar_step_m_ / 2, least_profile_step_m);
}

std::size_t Alignment::histogram_bins() const {
  return static_cast<std::size_t>(std::lround(2 * histogram_reach_m / histogram_step_m));
}

std::size_t Alignment::profile_points() const {
  if (radar_background_.empty()) return 0;
  return 1 + static_cast<std::size_t>((profile_to_m - profile_from_m) / profile_step_m_);
}

Body Alignment::operator()(std::span<const float> raw_inputs, std::span<float> features) const {
  const std::size_t bins = spd_background_.size();
  std::vector<float> clicks(bins), power(radar_background_.size());
  for (std::size_t i = 0; i < bins; ++i) clicks[i] = raw_inputs[i] - spd_background_[i];
  std::vector<float> sorted = clicks;
  const float level = quantile(sorted, 0.5);
  for (float& v : clicks) v -= level;
  for (std::size_t i = 0; i < power.size(); ++i)
    power[i] = raw_inputs[bins + i] - radar_background_[i];
  std::fill(features.begin(), features.end(), 0.f);
  const Body body = find_body(clicks, raw_inputs.first(bins));
  if (!body.detected) return body;
  align_histogram(clicks, body.range_m, features.first(histogram_bins()));
  align_profile(power, body.range_m, features.subspan(histogram_bins(), profile_points()));
  features.back() = body.range_m;
  return body;
}

Matrix Alignment::operator()(const Matrix& raw_inputs) const {
  Matrix out(raw_inputs.rows, size());
  for (std::size_t i = 0; i < raw_inputs.rows; ++i) (*this)(raw_inputs.row(i), out.row(i));
  return out;
}

// `clicks`: above the background, which `counts` still has.
Body Alignment::find_body(std::span<const float> clicks, std::span<const float> counts) const {
  const auto bins = static_cast<double>(clicks.size());
  double from = 0, to = bins, clicks_in = 0, counts_in = 0, centre = 0;
  for (int pass = 0; pass <= centroid_passes; ++pass) {
    double moment = 0;
    clicks_in = counts_in = 0;
    for (auto i = static_cast<std::size_t>(from); i < static_cast<std::size_t>(to); ++i) {
      // At first over all bins, where a noise of both signs would pull the centroid anywhere.
      const double weight = pass == 0 ? std::max(clicks[i], 0.f) : clicks[i];
      clicks_in += weight, counts_in += double{counts[i]};
      moment += weight * static_cast<double>(i);
    }
    if (clicks_in <= 0) return {};
    centre = moment / clicks_in;
    from = std::clamp(centre - reach_m / spd_step_m_, 0.0, bins);
    to = std::clamp(centre + reach_m / spd_step_m_ + 1, 0.0, bins);
  }
  const auto range_m = static_cast<float>(spd_first_m_ + centre * spd_step_m_);
  return {clicks_in > significance * std::sqrt(counts_in) && range_m != 0, range_m};
}

// Clicks between two ranges are differences of the running sum, interpolated.
void Alignment::align_histogram(std::span<const float> clicks, float range_m,
                                std::span<float> out) const {
  std::vector<float> running(clicks.size() + 1);
  for (std::size_t i = 0; i < clicks.size(); ++i) running[i + 1] = running[i] + clicks[i];
  const auto up_to = [&](double at_m) {
    const double x = std::clamp((at_m - spd_first_m_) / spd_step_m_ + 0.5, 0.0,
                                static_cast<double>(clicks.size()));
    const auto i = std::min(static_cast<std::size_t>(x), clicks.size() - 1);
    const auto part = static_cast<float>(x - static_cast<double>(i));
    return running[i] + part * (running[i + 1] - running[i]);
  };
  const double start = double{range_m} - histogram_reach_m;
  const float first = up_to(start);
  float before = first;
  for (std::size_t j = 0; j < out.size(); ++j) {
    const float now = up_to(start + static_cast<double>(j + 1) * histogram_step_m);
    out[j] = now - before;
    before = now;
  }
  if (before - first > 0)
    for (float& v : out) v /= before - first;
}

// Of profiles as they are recorded, not of bins added up: a power profile has twice the bandwidth
// of its amplitude, which is c/2B wide: sampled at half of that (as the base condition is) it is
// whole, and the sinc series gives it between its points. sin(pi (a - i)) = (-1)^i sin(pi a) leaves
// one sine a point.
void Alignment::align_profile(std::span<const float> power, float range_m,
                              std::span<float> out) const {
  constexpr float nearly_on = 1e-4f;
  for (std::size_t j = 0; j < out.size(); ++j) {
    const auto a = static_cast<float>((double{range_m} + profile_from_m +
                                       static_cast<double>(j) * profile_step_m_ - radar_first_m_) /
                                      radar_step_m_);
    const float nearest = std::round(a);
    if (std::abs(a - nearest) < nearly_on) {
      const auto i = static_cast<std::ptrdiff_t>(nearest);
      out[j] = i >= 0 && i < std::ssize(power) ? power[static_cast<std::size_t>(i)] : 0;
      continue;
    }
    float sum = 0;
    for (std::size_t i = 0; i < power.size(); ++i) {
      const float term = power[i] / (a - static_cast<float>(i));
      sum += i % 2 == 0 ? term : -term;
    }
    out[j] = sum * std::sin(static_cast<float>(M_PI) * a) / static_cast<float>(M_PI);
  }
  float all = 0;
  for (const float v : out) all += std::max(v, 0.f);
  if (all > 0)
    for (float& v : out) v /= all;
}

double Alignment::displacement_m(std::span<const float> features) const {
  const auto profile = features.subspan(histogram_bins(), profile_points());
  double sum = 0, moment = 0;
  for (std::size_t j = 0; j < profile.size(); ++j) {
    const double square = double{profile[j]} * double{profile[j]};
    sum += square, moment += square * static_cast<double>(j);
  }
  return profile_from_m + (sum > 0 ? moment / sum : 0) * profile_step_m_;
}

double Alignment::radar_background_share(const Matrix& powers, const Rows& rows) const {
  double always = 0, all = 0;
  for (const float v : radar_background_) always += double{v};
  for (const std::size_t row : rows)
    for (const float v : powers.row(row)) all += double{v};
  return all > 0 ? always * static_cast<double>(rows.size()) / all : 0;
}

void Alignment::save(record::H5File& file) const {
  file.write("alignment/spd_background", spd_background_, {spd_background_.size()});
  file.write("alignment/radar_background", radar_background_, {radar_background_.size()});
}

void Alignment::load(const record::H5File& file, const Layout& layout) {
  set_axes(layout);
  spd_background_ = file.read<float>("alignment/spd_background", {layout.spd.count});
  radar_background_ = file.read<float>("alignment/radar_background", {layout.radar.count});
}

}  // namespace echofuse::recon
