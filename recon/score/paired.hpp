// SPDX-License-Identifier: MIT
// Scores of maps by record: intervals, and differences of two methods.
#pragma once
#include <cmath>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {

// Mean of a metric over records, and its 95 % interval; NaN for fewer than five records.
struct MeanInterval {
  std::size_t records = 0;  // records that define the metric
  double mean = NAN, low = NAN, high = NAN;
};
MeanInterval mean_interval(const std::vector<MapScores>& scores, Metric metric);

// Gain of the second over the first; positive is better, also for errors.
struct PairedDifference : MeanInterval {
  Metric metric{};
  double first = 0, second = 0;  // means of both over the records that define the metric in both
};
double gain(Metric metric, double first, double second);
// Gains for records where both are defined, with intervals by a bootstrap over blocks of
// neighbours.
std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second);
nlohmann::json to_json(const std::vector<PairedDifference>& differences);

// Scores of one name in a table of `evaluate --per-record`; if a record has several lines (several
// trainings), their mean.
struct NamedScores {
  std::string name;
  std::map<std::int64_t, MapScores> of_record;  // NaN: not defined
};
// In the order of the names' first lines. Throws Error(failed) for another table.
std::vector<NamedScores> read_scores(const std::string& path);

}  // namespace echofuse::recon
