// SPDX-License-Identifier: MIT
#include "recon/models/body/alignment.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/core/clones.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double background_quantile = 0.05;  // of the training records: nobody stands everywhere
constexpr float steadiness = 4;               // standard deviations of a Poisson count
constexpr int centroid_passes = 3;
constexpr double significance = 5;
constexpr double histogram_step_m = 0.04, least_profile_step_m = 0.02;
constexpr double coarse_step_m = 0.08;  // of a radar whose profile is read halfway between as well
// As the base condition has. A chirp that is sampled once a resolution and then has a Blackman
// window is as wide.
constexpr double steps_a_resolution = 2;
constexpr std::size_t most_for_brightness = 4000;  // records

struct BinSums {
  double clicks = 0, counts = 0, moment = 0;
};

// Over bins [from, to), four sums side by side: each addition to one alone waits for the last.
// Bins with less than `least` clicks count as such.
ECHOFUSE_CLONES BinSums sum_bins(const float* clicks, const float* counts, std::size_t from,
                                 std::size_t to, float least) {
  constexpr std::size_t four = 4;
  using Floats [[gnu::vector_size(4 * four)]] = float;
  using Doubles [[gnu::vector_size(8 * four)]] = double;
  Doubles clicks_in{}, counts_in{}, moment{}, bin{0, 1, 2, 3};
  bin += static_cast<double>(from);
  std::size_t i = from;
  for (; i + four <= to; i += four, bin += double{four}) {
    Floats here, counted;
    std::memcpy(&here, clicks + i, sizeof here), std::memcpy(&counted, counts + i, sizeof counted);
    const Doubles weight = __builtin_convertvector(here > least ? here : Floats{} + least, Doubles);
    clicks_in += weight, moment += weight * bin;
    counts_in += __builtin_convertvector(counted, Doubles);
  }
  BinSums out;
  for (; i < to; ++i) {
    const double weight = double{std::max(clicks[i], least)};
    out.clicks += weight, out.moment += weight * static_cast<double>(i);
    out.counts += double{counts[i]};
  }
  for (std::size_t k = 0; k < four; ++k)
    out.clicks += clicks_in[k], out.counts += counts_in[k], out.moment += moment[k];
  return out;
}

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

Alignment::Alignment(const Layout& layout, const Matrix& raw_inputs, const Rows& rows,
                     Gains gains) {
  if (layout.spd.count == 0)
    throw Error(ExitCode::usage, "aligning records needs the detector's histogram");
  set_axes(layout);
  const auto lows = column_quantile(raw_inputs, rows, background_quantile);
  const auto medians = column_quantile(raw_inputs, rows, 0.5);
  const std::span low(lows), median(medians);
  const std::size_t clicks = layout.spd.count, powers = layout.radar.count;
  spd_background_ = background_of(low.first(clicks), median.first(clicks), true);
  radar_background_ =
      background_of(low.subspan(clicks, powers), median.subspan(clicks, powers), false);
  array_background_.resize(layout.inputs() - clicks - powers);
  if (array_.size() > 0) learn_array_background(raw_inputs, rows);
  if (gains == Gains::unknown || powers == 0) return;
  learn_brightness(raw_inputs, rows);
}

std::vector<float> Alignment::background() const {
  std::vector<float> out = spd_background_;
  out.insert(out.end(), radar_background_.begin(), radar_background_.end());
  out.insert(out.end(), array_background_.begin(), array_background_.end());
  return out;
}

void Alignment::set_background(std::span<const float> raw_inputs) {
  for (std::vector<float>* part : {&spd_background_, &radar_background_, &array_background_}) {
    std::copy_n(raw_inputs.begin(), part->size(), part->begin());
    raw_inputs = raw_inputs.subspan(part->size());
  }
}

void Alignment::learn_brightness(const Matrix& raw_inputs, const Rows& rows) {
  brightness_ = Brightness{};
  Matrix seen(0, 2);
  std::vector<float> features(size());
  const std::size_t every = 1 + rows.size() / most_for_brightness;
  for (std::size_t i = 0; i < rows.size(); i += every) {
    (*this)(raw_inputs.row(rows[i]), features);
    const auto brightness = brightness_of(std::span<const float>(features));
    if (Brightness::known(brightness)) seen.add_row(std::array{features.back(), brightness[0]});
  }
  if (seen.rows > 0) brightness_->fit(seen);
}

// Of each bin the lags of those records that have the least power there, as strong as the power
// that is always there: what stands still keeps its directions, and noise has none.
void Alignment::learn_array_background(const Matrix& raw_inputs, const Rows& rows) {
  const std::size_t first = raw_inputs.cols - array_background_.size();
  for (std::size_t at = 0; at < array_background_.size(); at += lag_values_) {
    std::vector<float> power;
    for (const std::size_t row : rows) power.push_back(raw_inputs.row(row)[first + at]);
    const float low = quantile(power, background_quantile), median = quantile(power, 0.5);
    const float level = std::max(2 * low - median, 0.f);
    if (!(level > 0)) continue;
    const auto lags = std::span(array_background_).subspan(at, lag_values_);
    for (const std::size_t row : rows)
      for (std::size_t k = 0; k < lags.size() && raw_inputs.row(row)[first + at] <= low; ++k)
        lags[k] += raw_inputs.row(row)[first + at + k];
    const float sum = lags[0];
    for (float& v : lags) v *= level / sum;
  }
}

void Alignment::set_axes(const Layout& layout) {
  spd_first_m_ = layout.spd.at(0.5) / ps_per_m;
  spd_step_m_ = layout.spd.step / ps_per_m;
  if (layout.radar.count > 0)
    radar_first_m_ = layout.radar.start, radar_step_m_ = layout.radar.step;
  points_a_step_ = radar_step_m_ >= coarse_step_m ? 2 : 1;
  steps_a_point_ = static_cast<std::ptrdiff_t>(std::ceil(least_profile_step_m / radar_step_m_));
  profile_step_m_ =
      radar_step_m_ * static_cast<double>(steps_a_point_) / static_cast<double>(points_a_step_);
  array_ = ArrayView(layout.array), lag_values_ = layout.lag_values();
  correlation_ = {};
  if (layout.radar.count > 0) set_window({});
}

void Alignment::set_window(const AlignmentWindow& window) {
  window_ = window;
  correlation_ = ShiftCorrelation(
      {-window_.histogram_m + histogram_step_m / 2, histogram_step_m, histogram_bins()},
      {window_.profile_from_m, profile_step_m_, points_with_radar()}, resolution_m());
}

Alignment Alignment::through(const AlignmentWindow& window) const {
  Alignment out = *this;
  out.brightness_.reset();
  out.window_ = window;
  if (profile_points() > 0) out.set_window(window);
  return out;
}

std::size_t Alignment::cost() const {
  return spd_background_.size() * 4 + profile_points() * 2 * profile_taps + correlation_.cost() +
         array_.cost();
}

std::size_t Alignment::histogram_bins() const {
  return static_cast<std::size_t>(std::lround(2 * window_.histogram_m / histogram_step_m));
}

std::size_t Alignment::profile_points() const {
  return radar_background_.empty() ? 0 : points_with_radar();
}

std::size_t Alignment::points_with_radar() const {
  return 1 + static_cast<std::size_t>((window_.profile_to_m - window_.profile_from_m) /
                                      profile_step_m_);
}

double Alignment::resolution_m() const { return steps_a_resolution * radar_step_m_; }

void Alignment::subtract_background(std::span<const float> raw_inputs, std::vector<float>& clicks,
                                    std::vector<float>& power) const {
  const std::size_t bins = spd_background_.size();
  clicks.resize(bins), power.resize(radar_background_.size());
  for (std::size_t i = 0; i < bins; ++i) clicks[i] = raw_inputs[i] - spd_background_[i];
  std::vector<float> sorted = clicks;
  const float level = quantile(sorted, 0.5);
  for (float& v : clicks) v -= level;
  for (std::size_t i = 0; i < power.size(); ++i)
    power[i] = raw_inputs[bins + i] - radar_background_[i];
}

Body Alignment::operator()(std::span<const float> raw_inputs, std::span<float> features) const {
  const std::size_t bins = spd_background_.size();
  std::vector<float> clicks, power;
  subtract_background(raw_inputs, clicks, power);
  std::fill(features.begin(), features.end(), 0.f);
  const Body body = find_body(clicks, raw_inputs.first(bins));
  if (!body.detected) return body;
  const float clicks_seen = align_histogram(clicks, body.range_m, features.first(histogram_bins()));
  const float power_seen = align_profile(power, double{body.range_m},
                                         features.subspan(histogram_bins(), profile_points()));
  if (brightness_)
    brightness_->write(clicks_seen, power_seen, body.range_m, brightness_of(features));
  view(raw_inputs.subspan(bins + power.size()), double{body.range_m}, array_of(features));
  features.back() = body.range_m;
  return body;
}

Matrix Alignment::operator()(const Matrix& raw_inputs) const {
  Matrix out(raw_inputs.rows, size());
  constexpr std::size_t part = 64;
  for_each_part((out.rows + part - 1) / part, [&](std::size_t k) {
    for (std::size_t i = k * part; i < std::min((k + 1) * part, out.rows); ++i)
      (*this)(raw_inputs.row(i), out.row(i));
  });
  return out;
}

// `clicks`: above the background, which `counts` still has.
Body Alignment::find_body(std::span<const float> clicks, std::span<const float> counts) const {
  constexpr float any = std::numeric_limits<float>::lowest();
  const auto bins = static_cast<double>(clicks.size());
  double from = 0, to = bins, centre = 0;
  BinSums in;
  for (int pass = 0; pass <= centroid_passes; ++pass) {
    // At first over all bins, where a noise of both signs would pull the centroid anywhere.
    in = sum_bins(clicks.data(), counts.data(), static_cast<std::size_t>(from),
                  static_cast<std::size_t>(to), pass == 0 ? 0.f : any);
    if (in.clicks <= 0) return {};
    centre = in.moment / in.clicks;
    from = std::clamp(centre - window_.body_m / spd_step_m_, 0.0, bins);
    to = std::clamp(centre + window_.body_m / spd_step_m_ + 1, 0.0, bins);
  }
  const auto range_m = static_cast<float>(spd_first_m_ + centre * spd_step_m_);
  return {in.clicks > significance * std::sqrt(in.counts) && range_m != 0, range_m};
}

// Clicks between two ranges are differences of the running sum, interpolated.
float Alignment::align_histogram(std::span<const float> clicks, float range_m,
                                 std::span<float> out) const {
  std::vector<float> running(clicks.size() + 1);
  for (std::size_t i = 0; i < clicks.size(); ++i) running[i + 1] = running[i] + clicks[i];
  // At a number of bins since the histogram's start.
  const auto up_to = [&, last = static_cast<double>(clicks.size())](double at) {
    const double x = std::clamp(at, 0.0, last);
    const auto i = std::min(static_cast<std::size_t>(x), clicks.size() - 1);
    const auto part = static_cast<float>(x - static_cast<double>(i));
    return running[i] + part * (running[i + 1] - running[i]);
  };
  const double start = (double{range_m} - window_.histogram_m - spd_first_m_) / spd_step_m_ + 0.5;
  const double step = histogram_step_m / spd_step_m_;
  const float first = up_to(start);
  float before = first;
  for (std::size_t j = 0; j < out.size(); ++j) {
    const float now = up_to(start + static_cast<double>(j + 1) * step);
    out[j] = now - before;
    before = now;
  }
  if (before - first > 0)
    for (float& v : out) v /= before - first;
  return before - first;
}

void Alignment::view(std::span<const float> raw_lags, double range_m, std::span<float> out) const {
  std::fill(out.begin(), out.end(), 0.f);
  if (out.empty() || raw_lags.empty()) return;
  std::vector<float> lags(raw_lags.begin(), raw_lags.end());
  for (std::size_t i = 0; i < lags.size(); ++i) lags[i] -= array_background_[i];
  array_(lags, range_m, out);
}

void Alignment::move_array(std::span<const float> raw_lags, double farther_m, double by_cosine,
                           std::span<float> inputs) const {
  const auto features = inputs.last(size());
  const auto range_m = double{features.back()};
  view(raw_lags, range_m - farther_m, array_of(features));
  ArrayView::turn(by_cosine, range_m, array_of(features));
}

double Alignment::direction_cosine(std::span<const float> features) const {
  return ArrayView::direction_cosine(array_of(features));
}

void Alignment::correlate(std::span<float> inputs) const {
  const auto features = inputs.last(size());
  correlation_(features.first(histogram_bins()),
               features.subspan(histogram_bins(), profile_points()),
               inputs.last(this->inputs()).first(correlation_.shifts()));
}

Matrix Alignment::with_correlations(const Matrix& aligned) const {
  Matrix out(aligned.rows, inputs());
  for (std::size_t i = 0; i < out.rows; ++i) {
    const auto features = aligned.row(i);
    std::copy(features.begin(), features.end(), out.row(i).last(features.size()).begin());
    if (shows_body(features)) correlate(out.row(i));
  }
  return out;
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
  if (brightness_) brightness_->save(file);
  if (array_.size() > 0)
    file.write("alignment/array_background", array_background_, {array_background_.size()});
}

void Alignment::load(const record::H5File& file, const Layout& layout) {
  set_axes(layout);
  spd_background_ = file.read<float>("alignment/spd_background", {layout.spd.count});
  brightness_.reset();
  if (Brightness::is_in(file)) brightness_.emplace().load(file);
  radar_background_ = file.read<float>("alignment/radar_background", {layout.radar.count});
  array_background_.resize(layout.inputs() - layout.spd.count - layout.radar.count);
  if (array_.size() > 0)
    array_background_ = file.read<float>("alignment/array_background", {array_background_.size()});
}

}  // namespace echofuse::recon
