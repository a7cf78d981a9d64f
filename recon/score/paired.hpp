// SPDX-License-Identifier: MIT
// Confidence intervals of scores, and paired differences between two methods on the same records.
#pragma once
#include <cmath>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {

// Mean of a metric over records, with its 95 % interval. The interval is NaN if there are fewer
// than five records.
struct MeanInterval {
  std::size_t records = 0;  // number of records for which the metric is defined
  double mean = NAN, low = NAN, high = NAN;
};
MeanInterval mean_interval(const std::vector<MapScores>& scores, Metric metric);

// Mean gain of a second method over a first method. Positive values mean that the second method is
// better, even for error metrics, for which lower values are better.
struct PairedDifference : MeanInterval {
  Metric metric{};
  // Means of both methods over the records for which the metric is defined for both.
  double first = 0, second = 0;
};
double gain(Metric metric, double first, double second);
// Returns the gains, averaged over the records for which the metric is defined for both methods.
// Computes the intervals by a bootstrap over blocks of neighbouring records.
std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second);
nlohmann::json to_json(const std::vector<PairedDifference>& differences);

// Scores listed under one name in a table written by `evaluate --per-record`. If a record has
// several lines (from several training runs), the mean of these lines is used.
struct NamedScores {
  std::string name;
  // Scores by record index; NaN if a metric is undefined.
  std::map<std::int64_t, MapScores> of_record;
};
// Returns the scores in the order in which the names first occur. Throws Error(failed) if the file
// was not written by `evaluate --per-record`.
std::vector<NamedScores> read_scores(const std::string& path);

}  // namespace echofuse::recon
