// SPDX-License-Identifier: MIT
// Fits the stated uncertainty of a trained model. Uses the validation records, as they are and made
// worse (fewer photons, more radar noise), with the model's own maps.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>

#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/use/estimator.hpp"

namespace echofuse::recon {

// Fewer training records tell nothing of a model's errors.
inline constexpr std::size_t least_cross_fitted = 50;
bool has_enough_records(const Split& split);  // true if they suffice to learn an UncertaintyModel
// The model has not seen these records, and answers for them.
struct Judged {
  const Estimator& model;
  Rows rows;
};
// Fits the uncertainty to the model's own answers, or to those of similar models trained on part of
// its records. Source of such cross-fitting: Chernozhukov et al., Econometrics Journal 21, C1,
// 2018. Row i of the views belongs to record i of the data. `usual`: rows that are in distribution.
UncertaintyModel fit_uncertainty(const Estimator& model, const Dataset& data, const Matrix& views,
                                 const Rows& usual, const std::vector<Judged>& judged,
                                 std::uint64_t seed);
// Returns the uncertainty, or nothing if interrupted. The parts are blocks if the split is in
// blocks. Answers that it is fitted to:
//   500 and more validation records  the model's own; they hold 90 % to a standard error of .013
//                                    (150 do for the SPD alone, which is seldom asked)
//   else below 2000 records          four models of `fit`, of three quarters each
//   else                             one model of `fit`, of a half
std::optional<UncertaintyModel> fit_uncertainty(const Estimator& model, const Dataset& data,
                                                const Matrix& views, const Split& split,
                                                const SplitOptions& options,
                                                const std::function<Estimator(const Split&)>& fit,
                                                std::size_t enough_validation = 500);

// Photons are lost at random, up to all but 1/300 of them, and the radar gets more noise.
void degrade(Dataset& data, Rng& rng);

}  // namespace echofuse::recon
