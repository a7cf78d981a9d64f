// SPDX-License-Identifier: MIT
// Fits the uncertainty of a trained model on the validation records, unmodified and degraded (fewer
// photons, more radar noise), with the model's own maps.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>

#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/predict/estimator.hpp"

namespace echofuse::recon {

// With fewer training records the errors cannot be estimated.
inline constexpr std::size_t least_cross_fitted = 50;
bool has_enough_records(
    const Split& split);  // true if there are enough to learn an UncertaintyModel
// Validation records and the model that they test; it was not trained on them.
struct HeldOut {
  const Estimator& model;
  Rows rows;
};
// Fits the uncertainty to the maps of the model itself, or of similar models trained on part of its
// records (cross-fitting: Chernozhukov et al., Econometrics Journal 21, C1, 2018). Row i of the
// views belongs to record i of the data. `usual`: rows that are in distribution.
UncertaintyModel fit_uncertainty(const Estimator& model, const Dataset& data, const Matrix& views,
                                 const Rows& usual, const std::vector<HeldOut>& judged,
                                 std::uint64_t seed);
// Returns the uncertainty, or nothing if interrupted. The parts are blocks if the split is in
// blocks. The maps it is fitted to:
//   500 and more validation records  the model's own; the standard error of the 90 % is .013
//                                    (150 are enough for the SPD alone, which is rarely used)
//   otherwise below 2000 records     four models of `fit`, each on three quarters
//   otherwise                        one model of `fit` on a half
std::optional<UncertaintyModel> fit_uncertainty(const Estimator& model, const Dataset& data,
                                                const Matrix& views, const Split& split,
                                                const SplitOptions& options,
                                                const std::function<Estimator(const Split&)>& fit,
                                                std::size_t enough_validation = 500);

// Removes photons at random, down to 1/300 of them, and adds noise to the radar.
void degrade(Dataset& data, Rng& rng);

}  // namespace echofuse::recon
