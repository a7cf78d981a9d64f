// SPDX-License-Identifier: MIT
#include "recon/estimator/learning_curve.hpp"

#include <algorithm>
#include <cmath>

#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t more_records = 100;
constexpr double least_se = 1e-3;

}  // namespace

double LearningForecast::iou(std::size_t records) const {
  return limit - slope / std::sqrt(static_cast<double>(records));
}

std::optional<LearningForecast> forecast_of(const std::vector<LearningPoint>& curve) {
  double n = 0, x1 = 0, x2 = 0, y1 = 0, xy = 0;
  std::size_t points = 0;
  for (const LearningPoint& p : curve) {
    if (std::isnan(p.iou.mean)) continue;
    const double se = std::isnan(p.iou.se) ? 1 : std::max(p.iou.se, least_se);
    const double weight = 1 / (se * se), x = -1 / std::sqrt(static_cast<double>(p.records));
    n += weight, x1 += weight * x, x2 += weight * x * x;
    y1 += weight * p.iou.mean, xy += weight * x * p.iou.mean;
    ++points;
  }
  const double spread = n * x2 - x1 * x1;
  if (points < 2 || !(spread > 0)) return {};
  const double slope = std::max((n * xy - x1 * y1) / spread, 0.);
  return LearningForecast{(y1 - slope * x1) / n, slope};
}

std::vector<std::size_t> learning_steps(std::size_t records) {
  std::vector<std::size_t> out;
  for (std::size_t decade = 10; decade < records; decade *= 10)
    for (const std::size_t step : {decade, 2 * decade, 5 * decade})
      if (step < records) out.push_back(step);
  if (records >= TuneOptions::least_records) out.push_back(records);
  return out;
}

LearningPoint learn(const TrainedModel& from, const Dataset& data, const Rows& usable,
                    std::size_t records, const TuneOptions& options) {
  const Rows rows(usable.begin(), usable.begin() + static_cast<std::ptrdiff_t>(records));
  const TunedModel tuned = tune(from, part_of_run(data, rows), options);
  const CrossvalidatedRow& row = tuned.table[tuned.chosen];
  return {records, row.name, row.metrics[metric_iou], row.metrics[metric_lateral_m]};
}

std::string learning_header() {
  return formatted("%8s  %-22s %15s %15s\n", "records", "best", "IoU", "lateral m");
}

std::string to_text(const LearningPoint& p) {
  return formatted("%8zu  %-22s %15s %15s\n", p.records, p.chosen.c_str(),
                   formatted(p.iou, " +-").c_str(), formatted(p.lateral_m, " +-").c_str());
}

std::string advice(const std::vector<LearningPoint>& curve) {
  const auto forecast = forecast_of(curve);
  if (!forecast) return {};
  const LearningPoint& last = curve.back();
  const double gain = forecast->iou(last.records + more_records) - forecast->iou(last.records);
  return formatted("another %zu records: IoU %+.3f", more_records, gain) +
         (gain > last.iou.se ? "; go on\n"
                             : formatted(", less than it is uncertain by (%.3f)\n", last.iou.se));
}

}  // namespace echofuse::recon
