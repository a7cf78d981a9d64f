// SPDX-License-Identifier: MIT
// Fits the uncertainty of a trained model to maps of held-out records. The records are used
// unmodified, and degraded by fewer photons and more radar noise.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>

#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/predict/estimator.hpp"

namespace echofuse::recon {

// Minimum number of training records needed to estimate the errors.
inline constexpr std::size_t min_cross_fitted = 50;
// Returns true if there are enough records to learn an UncertaintyModel.
bool has_enough_records(const Split& split);
// Held-out records, and a model that was not trained on them.
struct HeldOut {
  const Estimator& model;
  Rows rows;
};
// Fits the uncertainty to maps of held-out records. The maps are made by the model itself, or by
// similar models trained on part of its records (cross-fitting: Chernozhukov et al., Econometrics
// Journal 21, C1, 2018). Row i of `views` belongs to record i of `data`. `usual`: rows that count
// as in distribution.
UncertaintyModel fit_uncertainty(const Estimator& model, const Dataset& data, const Matrix& views,
                                 const Rows& usual, const std::vector<HeldOut>& assessed,
                                 std::uint64_t seed);
// Returns the uncertainty, or std::nullopt after an interrupt. It is fitted to maps made by
//   - the model itself, if `split` has at least `enough_validation` validation records;
//   - otherwise four models, if there are fewer than 2000 training and validation records; `fit`
//     trains each model on three quarters of these records;
//   - otherwise one model, which `fit` trains on half of these records.
// If the split is blocked, the quarters and halves are blocks. The fraction of errors within the
// 90 % interval has a standard error of .013 if it is estimated from 500 validation records.
// For the SPD alone, 150 records are enough, because its estimator is rarely used.
std::optional<UncertaintyModel> fit_uncertainty(const Estimator& model, const Dataset& data,
                                                const Matrix& views, const Split& split,
                                                const SplitOptions& options,
                                                const std::function<Estimator(const Split&)>& fit,
                                                std::size_t enough_validation = 500);

// Degrades records: keeps a random fraction of the photons, down to 1/300, and adds random noise of
// the same relative strength to the radar profile and to the antenna lags.
void degrade(Dataset& data, Rng& rng);

}  // namespace echofuse::recon
