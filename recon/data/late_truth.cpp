// SPDX-License-Identifier: MIT
#include "recon/data/late_truth.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_pairs = 30;
constexpr double least_correlation = 0.3;
// Minimum difference between two correlation coefficients, in standard errors of their Fisher
// z-transforms.
constexpr double clear = 5;

// Returns the mean bin index, weighted by the counts above the median. NaN if no count exceeds the
// median.
double mean_bin(std::vector<float> over) {
  subtract_median(over);
  double sum = 0, weight = 0;
  for (std::size_t i = 0; i < over.size(); ++i) {
    const double n = std::max(over[i], 0.f);
    sum += n * static_cast<double>(i), weight += n;
  }
  return weight > 0 ? sum / weight : NAN;
}

// Returns the mean depth of the pixels with a return. NaN if no pixel has a return.
double mean_depth(std::span<const float> map) {
  double sum = 0, pixels = 0;
  for (const float z : map)
    if (z > 0) sum += double{z}, ++pixels;
  return pixels > 0 ? sum / pixels : NAN;
}

// Returns the warning for one run, or an empty string. `range` (bins) and `depth` (m) have one
// value per row of the data.
std::string late_truth_of(const Dataset& data, const Source& run, const std::vector<double>& range,
                          const std::vector<double>& depth) {
  // Uses a row only if its own map and the maps of both neighbouring records are known. All three
  // correlations are then computed from the same rows.
  std::vector<double> ranges;
  std::vector<std::vector<double>> depths(3);
  for (std::size_t row = run.first + 1; row + 1 < run.first + run.count; ++row) {
    const auto follows = [&](std::size_t i) { return data.index[i] + 1 == data.index[i + 1]; };
    if (!follows(row - 1) || !follows(row) || std::isnan(range[row]) ||
        std::isnan(depth[row - 1] + depth[row] + depth[row + 1]))
      continue;
    ranges.push_back(range[row]);
    for (std::size_t k = 0; k < 3; ++k) depths[k].push_back(depth[row + k - 1]);
  }
  if (ranges.size() < least_pairs) return {};
  const double before = correlation(ranges, depths[0]), own = correlation(ranges, depths[1]),
               after = correlation(ranges, depths[2]), best = std::max(before, after);
  const double error = std::sqrt(2 / static_cast<double>(ranges.size() - 3));
  if (best < least_correlation || fisher_z(best) - fisher_z(own) < clear * error) return {};
  return printable(run.path) +
         format(
             ": histogram ranges fit the depth maps of the %s records (correlation %.2f) "
             "better than those of their own records (%.2f): the maps are one record %s; shift "
             "them by one record",
             after > before ? "next" : "previous", best, own, after > before ? "late" : "early");
}

}  // namespace

std::string late_truth(const Dataset& data) {
  if (data.spd().axis.count == 0 || data.depth().cols == 0) return {};
  std::vector<double> range(data.size(), NAN), depth(data.size(), NAN);
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (data.has(row, Sensor::spd) && data.doubt_of(row, Inputs::spd, false).empty())
      range[row] = mean_bin(data.counts(row));
    if (data.sound_depth(row)) depth[row] = mean_depth(data.depth().row(row));
  }
  std::string out;
  for (const Source& run : data.sources)
    if (const std::string line = late_truth_of(data, run, range, depth); !line.empty())
      out += (out.empty() ? "" : "\n") + line;
  return out;
}

}  // namespace echofuse::recon
