// SPDX-License-Identifier: MIT
// What a model answers to records: the map that is asked for, and how far to trust it.
#pragma once
#include <string>
#include <vector>

#include "recon/estimator/trained_model.hpp"

namespace echofuse::recon {

// own: the map as the model makes it; hard: where a body is its depth, else the background; mean:
// the mean over what may be there, which has the least squared error.
inline const std::vector<std::string> output_names = {"own", "hard", "mean"};

struct Answer {
  Matrix maps;                // of the output, metres
  std::vector<Claim> claims;  // none without a confidence
  Matrix mean, deviation;     // metres; no rows unless asked for
};
// Throws Error(usage) if the model claims nothing: mean maps and deviations need that.
void require_confidence(const TrainedModel& model);
// Throws Error(usage) if the model has no confidence and one is needed, for mean or deviation.
Answer answer(const TrainedModel& model, const Dataset& data, const Rows& rows,
              const std::string& output, bool with_deviation);
// Replaces the model's own maps by those of the output, which for "mean" uses up the means.
void choose_output(Answer& own, const std::string& output, const Scene& scene);

// Of one model without its fallback, as fit_confidence() needs them.
// What is known at the prediction of how good it will be: one row a map.
Matrix signs_of(const TrainedModel& model, const Dataset& data, const Rows& rows,
                const Matrix& maps);
// With the lateral error as that of a normal distribution.
SoftMaps soft_maps(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   const Matrix& maps, const std::vector<double>& lateral_90_m);

}  // namespace echofuse::recon
