// SPDX-License-Identifier: MIT
// Two ways to make maps, compared record by record.
#pragma once
#include <cmath>
#include <vector>

#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {

// Gain of the second over the first: plus is better, also of an error.
struct PairedDifference {
  Metric metric{};
  std::size_t records = 0;  // records that define the metric in both
  // Mean of both, the mean gain, and its 95 % interval; NaN for fewer than five records.
  double first = 0, second = 0, mean = 0, low = NAN, high = NAN;
};
double gain(Metric metric, double first, double second);
// Gains in what both define, with intervals by resampled blocks of neighbours.
std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second);

}  // namespace echofuse::recon
