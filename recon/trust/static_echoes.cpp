// SPDX-License-Identifier: MIT
#include "recon/trust/static_echoes.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "acquire/measurement/response.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/util/format.hpp"
#include "recon/method/constants.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// A bin is static if this fraction of its median is static, and if it has at least 2 % of the
// largest static value.
constexpr double min_share = 0.6, min_of_top = 0.02;
constexpr std::size_t min_bins = 6;
// The static echoes have changed if the rms deviation after the fit exceeds this fraction. With a
// range error of 2 cm it is at most .03; with moved furniture, an open door or a bystander, at
// least .06 (recon/RESULTS.md).
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

Part medians(const Matrix& table) { return column_quantile(table, all_rows(table.rows), 0.5); }

SensorEchoes learn(const Matrix& table) {
  const Part low = column_quantile(table, all_rows(table.rows), method::background_quantile);
  SensorEchoes out{medians(table), {}};
  for (std::size_t i = 0; i < low.size(); ++i) {
    const float median = out.median[i];
    out.share.push_back(median > 0 ? std::clamp((2 * low[i] - median) / median, 0.F, 1.F) : 0);
  }
  return out;
}

double value_at(std::span<const float> values, double bin) {
  const auto last = static_cast<std::ptrdiff_t>(values.size()) - 1;
  const double low = std::floor(bin);
  std::array<double, 4> near{};
  for (std::ptrdiff_t k = 0; k < 4; ++k)
    near[static_cast<std::size_t>(k)] = values[static_cast<std::size_t>(
        std::clamp(static_cast<std::ptrdiff_t>(low) + k - 1, std::ptrdiff_t{0}, last))];
  return record::catmull_rom(near, bin - low);
}

struct StaticFit {
  double shift_bins = 0, misfit = 1;
};

// Fits gain and shift of the known static echoes by Gauss-Newton steps. Returns the misfit 1 if
// there are too few static bins.
StaticFit fit(const SensorEchoes& known, const Part& found) {
  constexpr int steps = 20;  // at most half a bin each
  constexpr double h = 0.05, max_step = 0.5;
  float top = 0;
  for (std::size_t i = 0; i < known.median.size(); ++i)
    top = std::max(top, known.share[i] * known.median[i]);
  Rows bins;
  for (std::size_t i = 0; i < known.median.size(); ++i)
    if (known.share[i] > min_share && known.share[i] * known.median[i] > min_of_top * top)
      bins.push_back(i);
  StaticFit out;
  if (bins.size() < min_bins) return out;
  for (int step = 0; step < steps; ++step) {
    double ss = 0, sd = 0, dd = 0, sy = 0, dy = 0, yy = 0;
    for (const std::size_t i : bins) {
      const double weight = 1 / double{known.median[i]}, y = found[i];
      const double at = static_cast<double>(i) - out.shift_bins;
      const double s = value_at(known.median, at),
                   d = (value_at(known.median, at - h) - value_at(known.median, at + h)) / (2 * h);
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
  const StaticFit spd = fit(spd_, medians(counts)), radar = fit(radar_, medians(power));
  if (!(std::max(spd.misfit, radar.misfit) < max_misfit)) return {};
  const double spd_step_m = data.spd().axis.step / ps_per_m, radar_step_m = data.radar().axis.step;
  const auto difference = [&](const StaticFit& of_radar, const StaticFit& of_spd) {
    return of_radar.shift_bins * radar_step_m - of_spd.shift_bins * spd_step_m;
  };
  std::vector<double> parts;
  for (std::size_t b = 0; b < blocks; ++b) {
    Rows block;
    for (std::size_t i = b * rows.size() / blocks; i < (b + 1) * rows.size() / blocks; ++i)
      block.push_back(i);
    parts.push_back(difference(fit(radar_, column_quantile(power, block, 0.5)),
                               fit(spd_, column_quantile(counts, block, 0.5))));
  }
  return RangeDifference{difference(radar, spd),
                         standard_deviation(parts) / std::sqrt(static_cast<double>(blocks))};
}

void StaticEchoes::archive(Archive archive) {
  const auto sensor = [&](const std::string& name, SensorEchoes& of) {
    Matrix table(0, of.median.size());
    if (!of.median.empty()) table.add_row(of.median), table.add_row(of.share);
    archive.table(name, table, 2, Archive::any);
    of.median.assign(table.row(0).begin(), table.row(0).end());
    of.share.assign(table.row(1).begin(), table.row(1).end());
  };
  sensor("spd", spd_), sensor("radar", radar_);
}

}  // namespace echofuse::recon
