// SPDX-License-Identifier: MIT
// Two ways to make maps, compared record by record.
#pragma once
#include <vector>

#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {

// By how much the second is better; plus is better, also of an error.
struct PairedDifference {
  Metric metric{};
  std::size_t records = 0;                                    // that define it in both
  double first = 0, second = 0, mean = 0, low = 0, high = 0;  // of the gain; low, high: of 95 %
};
double gain(Metric metric, double first, double second);
// Gains in what both define, with intervals by resampled blocks of neighbours.
std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second);

}  // namespace echofuse::recon
