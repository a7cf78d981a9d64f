// SPDX-License-Identifier: MIT
#include "recon/data/late_truth.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t min_pairs = 20;
constexpr int max_lag = 5;
constexpr std::size_t lags = 2 * max_lag + 1;
constexpr double min_correlation = 0.3;
// Minimum evidence for a lag, in standard errors: of the difference between two correlation
// coefficients (Fisher's z-transforms), and of the residuals of a block.
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

// Mean range of the histogram (bins) and mean depth of the map (m) of each row; NaN if unknown.
struct Means {
  std::vector<double> range, depth;
};

// Rows [begin, end) of one run, and the means of all rows.
struct Run {
  const Dataset& data;
  const Means& means;
  std::size_t begin, end;

  // Returns the depth of the map `lag` records after the row; NaN if unknown.
  double depth(std::size_t row, int lag) const {
    const std::size_t of = row + static_cast<std::size_t>(lag);
    const bool known =
        of >= begin && of < end && data.records[row].index + lag == data.records[of].index;
    return known ? means.depth[of] : NAN;
  }
};

// Correlation of the ranges of a block with the own maps and with those `lag` records later,
// computed from the same rows, and the difference in standard errors.
struct Comparison {
  double own = 0, other = 0, errors = 0;

  Comparison(const Run& run, std::size_t begin, std::size_t end, int lag) {
    std::vector<double> ranges, nears, fars;
    for (std::size_t row = begin; row < end; ++row) {
      const double near = run.depth(row, 0), far = run.depth(row, lag);
      if (std::isnan(run.means.range[row] + near + far)) continue;
      ranges.push_back(run.means.range[row]), nears.push_back(near), fars.push_back(far);
    }
    if (ranges.size() < min_pairs) return;
    own = correlation(ranges, nears), other = correlation(ranges, fars);
    errors =
        (fisher_z(other) - fisher_z(own)) / std::sqrt(2 / static_cast<double>(ranges.size() - 3));
  }
};

// Line through the ranges as a function of the depths, and the squared correlation (0 if negative).
struct Line {
  double slope = 0, offset = 0, variance = 0, explained = 0;
};

// `lag`: of each row of the run.
Line fit(const Run& run, const std::vector<int>& lag, std::size_t begin, std::size_t end) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (std::size_t row = begin; row < end; ++row) {
    const double depth = run.depth(row, lag[row - run.begin]), range = run.means.range[row];
    if (std::isnan(depth + range)) continue;
    ++n, x += depth, y += range, xx += depth * depth, xy += depth * range, yy += range * range;
  }
  const double width = xx - x * x / n, height = yy - y * y / n, slope = (xy - x * y / n) / width;
  if (!(n > 2 && width > 0 && height > 0)) return {};
  return {slope, (y - slope * x) / n, (height - slope * slope * width) / (n - 2),
          slope > 0 ? slope * slope * width / height : 0};
}

// Returns the most probable lag of each row (Viterbi): the squared residuals of the line decide,
// and each change of the lag must be clear.
std::vector<int> most_probable(const Run& run, const Line& line) {
  constexpr double change = clear * clear / 2, unknown = 0.5, outlier = 4.5;
  const std::size_t n = run.end - run.begin;
  std::array<double, lags> cost;
  cost.fill(change), cost[max_lag] = 0;
  std::vector<std::array<std::uint8_t, lags>> from(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto best = static_cast<std::size_t>(std::ranges::min_element(cost) - cost.begin());
    const double changed = cost[best] + change;
    for (std::size_t k = 0; k < lags; ++k) {
      from[i][k] = static_cast<std::uint8_t>(changed < cost[k] ? best : k);
      const double depth = run.depth(run.begin + i, static_cast<int>(k) - max_lag),
                   off = run.means.range[run.begin + i] - line.offset - line.slope * depth;
      cost[k] = std::min(cost[k], changed) +
                (std::isnan(off) ? unknown : std::min(off * off / line.variance / 2, outlier));
    }
  }
  auto k = static_cast<std::size_t>(std::ranges::min_element(cost) - cost.begin());
  std::vector<int> out(n);
  for (std::size_t i = n; i-- > 0; k = from[i][k]) out[i] = static_cast<int>(k) - max_lag;
  return out;
}

// Returns the lag of each row. Starts with the line through the rows that are correlated best.
std::vector<int> lags_of(const Run& run) {
  constexpr std::size_t rows = 30;
  constexpr int steps = 5;
  std::vector<int> out(run.end - run.begin);
  Line line;
  for (int lag = -max_lag; lag <= max_lag; ++lag) {
    std::ranges::fill(out, lag);
    for (std::size_t at = run.begin; at + min_pairs <= run.end; at += rows / 2)
      if (const Line found = fit(run, out, at, std::min(at + rows, run.end));
          found.explained > line.explained)
        line = found;
  }
  std::ranges::fill(out, 0);
  for (int step = 0; step < steps && line.variance > 0; ++step)
    line = fit(run, out = most_probable(run, line), run.begin, run.end);
  return out;
}

// Returns the warnings for one run, one line for each block with the same lag.
std::string late_truth_of(const Run& run, const std::string& path) {
  const std::vector<int> lag = lags_of(run);
  std::string out;
  for (std::size_t from = 0, to = 0; from < lag.size(); from = to) {
    while (to < lag.size() && lag[to] == lag[from]) ++to;
    if (lag[from] == 0) continue;
    const Comparison found(run, run.begin + from, run.begin + to, lag[from]),
        opposite(run, run.begin + from, run.begin + to, -lag[from]);
    // A periodic scene fits the lag with the opposite sign as well.
    if (found.other < min_correlation || found.errors < clear || opposite.errors >= clear) continue;
    const int count = std::abs(lag[from]);
    const std::string records = std::to_string(count) + (count == 1 ? " record" : " records");
    if (!out.empty()) out += '\n';
    out += printable(path) + ": ";
    if (to - from < lag.size())
      out += format("records %lld to %lld: ",
                    static_cast<long long>(run.data.records[run.begin + from].index),
                    static_cast<long long>(run.data.records[run.begin + to - 1].index));
    out += format(
        "histogram ranges fit the depth maps %s %s (correlation %.2f) better than their own "
        "(%.2f): the maps are %s %s; shift them by %s",
        records.c_str(), lag[from] > 0 ? "later" : "earlier", found.other, found.own,
        records.c_str(), lag[from] > 0 ? "late" : "early", records.c_str());
  }
  return out;
}

}  // namespace

std::string late_truth(const Dataset& data) {
  if (data.spd().axis.count == 0 || data.depth().cols == 0) return {};
  Means means{std::vector<double>(data.size(), NAN), std::vector<double>(data.size(), NAN)};
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (data.has(row, Sensor::spd) && doubt_of(data, row, Inputs::spd, false).empty())
      means.range[row] = mean_bin(counts_of(data, row));
    if (sound_depth(data, row)) means.depth[row] = mean_depth(data.depth().row(row));
  }
  std::string out;
  for (const Source& run : data.sources)
    if (const std::string line =
            late_truth_of({data, means, run.first, run.first + run.count}, run.path);
        !line.empty())
      out += (out.empty() ? "" : "\n") + line;
  return out;
}

}  // namespace echofuse::recon
