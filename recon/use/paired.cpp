// SPDX-License-Identifier: MIT
#include "recon/use/paired.hpp"

#include <cmath>

#include "drivers/core/random.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

double gain(Metric metric, double first, double second) {
  const bool less = metric == metric_lateral_m || metric == metric_depth_mae_m ||
                    metric == metric_rmse_m || metric == metric_ghost;
  return less ? first - second : second - first;
}

std::vector<PairedDifference> paired_differences(const std::vector<MapScores>& first,
                                                 const std::vector<MapScores>& second) {
  constexpr std::size_t resamples = 2000, least_records = 5;
  std::vector<PairedDifference> out;
  for (const Metric m : {metric_iou, metric_lateral_m, metric_depth_mae_m, metric_ssim_fg,
                         metric_ssim_hard, metric_rmse_m, metric_ghost}) {
    std::vector<double> differences;
    PairedDifference row{m};
    for (std::size_t i = 0; i < first.size(); ++i) {
      if (std::isnan(first[i][m]) || std::isnan(second[i][m])) continue;
      row.first += first[i][m], row.second += second[i][m];
      differences.push_back(gain(m, first[i][m], second[i][m]));
    }
    if (differences.empty()) continue;
    row.records = differences.size();
    const auto n = static_cast<double>(row.records);
    row.first /= n, row.second /= n, row.mean = mean_of(differences);
    Rng rng = make_rng(1, static_cast<std::uint64_t>(m));
    std::vector<float> means;
    for (std::size_t k = 0; k < resamples; ++k) {
      double sum = 0;
      for (const std::size_t i : resampled_blocks(row.records, row.records, rng))
        sum += differences[i];
      means.push_back(static_cast<float>(sum / n));
    }
    if (row.records >= least_records)
      row.low = double{quantile(means, 0.025)}, row.high = double{quantile(means, 0.975)};
    out.push_back(row);
  }
  return out;
}

}  // namespace echofuse::recon
