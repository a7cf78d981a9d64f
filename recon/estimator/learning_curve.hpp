// SPDX-License-Identifier: MIT
// How much better a model gets with the records of a room, and what more of them would bring.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recon/estimator/tune.hpp"

namespace echofuse::recon {

struct LearningPoint {
  std::size_t records = 0;  // the first so many usable ones
  std::string chosen;       // TunedModel::table
  Summary iou, lateral_m;   // cross-validated among them
};

// IoU = limit - slope / sqrt(records), slope >= 0: the rate at which the mean error of a smooth
// estimator falls (Amari et al., Neural Computation 4, 605, 1992).
struct LearningForecast {
  double limit = 0, slope = 0;
  double iou(std::size_t records) const;
};
// Weighted least squares over at least two points with an IoU; none for fewer.
std::optional<LearningForecast> forecast_of(const std::vector<LearningPoint>& curve);

// 10, 20, 50, 100, 200 ... up to `records`, which comes last itself.
std::vector<std::size_t> learning_steps(std::size_t records);

// The model tuned to the first `records` usable ones of the data (match_for_tuning).
LearningPoint learn(const TrainedModel& from, const Dataset& data, const Rows& usable,
                    std::size_t records, const TuneOptions& options);

std::string learning_header();
std::string to_text(const LearningPoint& point);  // a line
// What 100 more records would bring, by the forecast, and whether that exceeds what the IoU is
// uncertain by. A line; empty if nothing can be told.
std::string advice(const std::vector<LearningPoint>& curve);

}  // namespace echofuse::recon
