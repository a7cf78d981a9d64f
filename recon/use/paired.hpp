// SPDX-License-Identifier: MIT
// Two ways to make maps, compared record by record.
#pragma once
#include <vector>

#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {

struct PairedDifference {
  Metric metric{};

  // Two models on the same records: how much better the second is. Plus is better, also of an
  // error.
  double gain(Metric metric, double first, double second);
  // Gains in what both define, with intervals by resampled blocks of neighbours.
  std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                   const std::vector<MapScores>& second);

}  // namespace echofuse::recon
