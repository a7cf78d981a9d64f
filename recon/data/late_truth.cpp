// SPDX-License-Identifier: MIT
#include "recon/data/late_truth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t min_pairs = 30, block_records = 100;
constexpr int max_lag = 5;
constexpr double min_correlation = 0.3;
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

// Mean range of the histogram (bins) and mean depth of the map (m) of each row; NaN if unknown.
struct Means {
  std::vector<double> range, depth;
};

// Maps `lag` records after those of the histograms fit better than the own maps, by this number of
// standard errors. 0: none.
struct Lag {
  int lag = 0;
  double correlation = 0, own = 0, errors = 0;
};

Lag lag_of(const Dataset& data, const Means& means, std::size_t begin, std::size_t end) {
  Lag found;
  double opposite = 0;  // `errors` of the lag with the opposite sign: a periodic scene fits both
  const auto compare = [&](int lag) -> Lag {
    // Both correlations of a lag are computed from the same rows.
    std::vector<double> ranges, own, other;
    for (std::size_t row = begin; row < end; ++row) {
      const std::size_t of = row + static_cast<std::size_t>(lag);
      if (of < begin || of >= end || data.records[row].index + lag != data.records[of].index ||
          std::isnan(means.range[row] + means.depth[row] + means.depth[of]))
        continue;
      ranges.push_back(means.range[row]);
      own.push_back(means.depth[row]), other.push_back(means.depth[of]);
    }
    if (ranges.size() < min_pairs) return {};
    const double with_own = correlation(ranges, own), with_other = correlation(ranges, other);
    const double error = std::sqrt(2 / static_cast<double>(ranges.size() - 3));
    const double errors = (fisher_z(with_other) - fisher_z(with_own)) / error;
    return with_other < min_correlation ? Lag{} : Lag{lag, with_other, with_own, errors};
  };
  for (int count = 1; count <= max_lag; ++count) {
    const Lag after = compare(count), before = compare(-count);
    const bool late = after.errors >= before.errors;
    if (const Lag& best = late ? after : before; best.errors > found.errors)
      found = best, opposite = late ? before.errors : after.errors;
  }
  return found.errors >= clear && opposite < clear ? found : Lag{};
}

// Returns the warning for one run, or an empty string.
std::string late_truth_of(const Dataset& data, const Source& run, const Means& means) {
  const std::size_t end = run.first + run.count;
  Lag found;
  std::size_t from = run.first, to = end;  // rows with this lag
  for (std::size_t at = run.first; at + block_records <= end; at += block_records / 2) {
    const std::size_t last = at + 3 * block_records / 2 > end ? end : at + block_records;
    const Lag lag = lag_of(data, means, at, last);
    if (lag.lag == 0 || (found.lag != 0 && lag.lag != found.lag)) continue;
    if (found.lag == 0) found = lag, from = at;
    to = last;
  }
  if (found.lag == 0) found = lag_of(data, means, from, to);
  if (found.lag == 0) return {};
  const int count = std::abs(found.lag);
  const std::string records = std::to_string(count) + (count == 1 ? " record" : " records");
  const std::string where =
      from == run.first && to == end
          ? ""
          : format("records %lld to %lld: ", static_cast<long long>(data.records[from].index),
                   static_cast<long long>(data.records[to - 1].index));
  return printable(run.path) + ": " + where +
         format(
             "histogram ranges fit the depth maps %s %s (correlation %.2f) better than their own "
             "(%.2f): the maps are %s %s; shift them by %s",
             records.c_str(), found.lag > 0 ? "later" : "earlier", found.correlation, found.own,
             records.c_str(), found.lag > 0 ? "late" : "early", records.c_str());
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
    if (const std::string line = late_truth_of(data, run, means); !line.empty())
      out += (out.empty() ? "" : "\n") + line;
  return out;
}

}  // namespace echofuse::recon
