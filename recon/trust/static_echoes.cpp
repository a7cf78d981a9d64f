// SPDX-License-Identifier: MIT
#include "recon/trust/static_echoes.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/axis.hpp"
#include "drivers/util/format.hpp"
#include "recon/data/shift.hpp"
#include "recon/method/constants.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// A bin is static if this fraction of its median is static, and if it has at least 2 % of the
// largest static value.
constexpr double min_share = 0.6, min_of_top = 0.02;
constexpr std::size_t min_bins = 6;
// The static echoes have changed if the rms deviation after the fit exceeds this fraction. In three
// simulated rooms it is below .03 with a range error of up to 10 cm, and above .06 with moved
// furniture, an open door or a bystander (2026-11-29).
constexpr double max_misfit = 0.04;
// Each block of records gives a difference, and their scatter gives the standard error.
constexpr std::size_t blocks = 5;
// With 100 records, the standard deviation is 2 mm in runs without a range error.
constexpr double min_difference_m = 0.008, clearly = 5;

using Part = std::vector<float>;

Matrix table_of(const Dataset& data, const Rows& rows, bool of_spd) {
  if (!of_spd) return take_rows(data.radar(), rows);
  Matrix out(0, data.spd().axis.count);
  for (const std::size_t row : rows) out.add_row(counts_of(data, row));
  return out;
}

SensorEchoes learn(const Matrix& table) {
  const Rows rows = all_rows(table.rows);
  const Part low = column_quantile(table, rows, method::background_quantile);
  SensorEchoes out{column_quantile(table, rows, 0.5), {}};
  for (std::size_t i = 0; i < low.size(); ++i) {
    const float median = out.median[i];
    out.share.push_back(median > 0 ? method::background_level(low[i], median) / median : 0);
  }
  return out;
}

// Returns the values moved towards the end of the axis. Beyond its ends, they are constant.
Part moved(const Part& values, double by_bins) {
  constexpr std::ptrdiff_t ends = 16;
  Part longer(ends, values.front());
  longer.insert(longer.end(), values.begin(), values.end());
  longer.insert(longer.end(), ends, values.back());
  const Part out = Shift(-by_bins).apply(longer);
  return {out.begin() + ends, out.end() - ends};
}

struct StaticFit {
  double shift_bins = 0, misfit = 1;
  bool found() const { return misfit < 1; }
};

Rows static_bins(const SensorEchoes& known) {
  float top = 0;
  for (std::size_t i = 0; i < known.median.size(); ++i)
    top = std::max(top, known.share[i] * known.median[i]);
  Rows out;
  for (std::size_t i = 0; i < known.median.size(); ++i)
    if (known.share[i] > min_share && known.share[i] * known.median[i] > min_of_top * top)
      out.push_back(i);
  return out;
}

// Fits gain and shift of the known static echoes by Gauss-Newton steps of at most `max_step` bins,
// from the shift `from_bins`.
StaticFit fit_from(const SensorEchoes& known, const Rows& bins, const Part& found, double from_bins,
                   double max_step) {
  constexpr int steps = 8;
  const double h = 0.1 * max_step;
  StaticFit out{from_bins, 1};
  for (int step = 0; step < steps; ++step) {
    const Part at = moved(known.median, out.shift_bins),
               after = moved(known.median, out.shift_bins + h),
               before = moved(known.median, out.shift_bins - h);
    double ss = 0, sd = 0, dd = 0, sy = 0, dy = 0, yy = 0;
    for (const std::size_t i : bins) {
      const double weight = 1 / double{known.median[i]}, y = found[i];
      const double s = at[i], d = (double{after[i]} - double{before[i]}) / (2 * h);
      ss += weight * s * s, sd += weight * s * d, dd += weight * d * d;
      sy += weight * s * y, dy += weight * d * y, yy += weight * y * y;
    }
    const double determinant = ss * dd - sd * sd;
    const double gain = (sy * dd - dy * sd) / determinant,
                 slope = (dy * ss - sy * sd) / determinant;
    if (!(determinant > 0 && gain > 0)) return {};
    out.misfit = std::sqrt(std::max(0., 1 - (gain * sy + slope * dy) / yy));
    out.shift_bins += std::clamp(slope / gain, -max_step, max_step);
  }
  return out;
}

// Returns the best fit from at most 21 whole shifts up to `max_m`.
StaticFit fit(const SensorEchoes& known, const Rows& bins, const Part& found, double step_m) {
  constexpr double max_m = 0.15;
  StaticFit best;
  const double max_shift = std::floor(max_m / step_m),
               apart = std::max(1., std::ceil(max_shift / 10));
  for (double k = -std::floor(max_shift / apart); k * apart <= max_shift; ++k)
    if (const StaticFit one = fit_from(known, bins, found, k * apart, apart / 2);
        one.misfit < best.misfit)
      best = one;
  return best;
}

}  // namespace

bool RangeDifference::found() const {
  return std::abs(difference_m) > std::max(min_difference_m, clearly * standard_error_m);
}

std::string RangeDifference::text() const {
  return format(
      "static echoes show that radar ranges are %.1f +- %.1f cm too %s compared with SPD ranges: "
      "check the mounts and cables, and measure the offsets again (or use --range-offset %.3f)",
      100 * std::abs(difference_m), 100 * standard_error_m, difference_m > 0 ? "long" : "short",
      difference_m);
}

StaticEchoes::StaticEchoes(const Dataset& data, const Rows& rows) {
  if (rows.size() < min_records || data.spd().cols == 0 || data.radar().cols == 0) return;
  spd_ = learn(table_of(data, rows, true));
  radar_ = learn(table_of(data, rows, false));
}

std::optional<RangeDifference> StaticEchoes::compare(const Dataset& data, const Rows& rows) const {
  if (!known() || rows.size() < min_records) return {};
  const Matrix counts = table_of(data, rows, true), power = table_of(data, rows, false);
  if (counts.cols != spd_.median.size() || power.cols != radar_.median.size()) return {};
  const Rows spd_bins = static_bins(spd_), radar_bins = static_bins(radar_);
  if (std::min(spd_bins.size(), radar_bins.size()) < min_bins) return {};
  const double spd_step_m = data.spd().axis.step / ps_per_m, radar_step_m = data.radar().axis.step;
  // Returns the difference that these rows show, and sets the larger misfit of the two sensors.
  const auto difference_m = [&](const Rows& some, double& misfit) {
    const StaticFit spd = fit(spd_, spd_bins, column_quantile(counts, some, 0.5), spd_step_m),
                    radar =
                        fit(radar_, radar_bins, column_quantile(power, some, 0.5), radar_step_m);
    misfit = spd.found() && radar.found() ? std::max(spd.misfit, radar.misfit) : 1;
    return radar.shift_bins * radar_step_m - spd.shift_bins * spd_step_m;
  };
  RangeDifference out;
  double misfit = 1;
  out.difference_m = difference_m(all_rows(rows.size()), misfit);
  if (misfit > max_misfit) return {};
  std::vector<double> parts;
  for (std::size_t b = 0; b < blocks; ++b) {
    Rows block;
    for (std::size_t i = b * rows.size() / blocks; i < (b + 1) * rows.size() / blocks; ++i)
      block.push_back(i);
    parts.push_back(difference_m(block, misfit));
    if (misfit == 1) return {};
  }
  out.standard_error_m = standard_deviation(parts) / std::sqrt(static_cast<double>(blocks - 1));
  return out;
}

void StaticEchoes::archive(Archive archive, const Layout& layout) {
  const auto sensor = [&](const std::string& name, SensorEchoes& of, std::size_t bins) {
    Matrix table(0, of.median.size());
    if (!of.median.empty()) table.add_row(of.median), table.add_row(of.share);
    archive.table(name, table, 2, bins);
    of.median.assign(table.row(0).begin(), table.row(0).end());
    of.share.assign(table.row(1).begin(), table.row(1).end());
  };
  sensor("spd", spd_, layout.spd.count), sensor("radar", radar_, layout.radar.count);
}

}  // namespace echofuse::recon
