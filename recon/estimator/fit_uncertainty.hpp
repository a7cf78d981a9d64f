// SPDX-License-Identifier: MIT
// Learns what a trained model may say of its own answers, from the validation records: as they are
// and made worse (fewer photons, more radar noise), with the model's own maps.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>

#include "drivers/core/random.hpp"
#include "recon/data/split.hpp"
#include "recon/estimator/estimator.hpp"

namespace echofuse::recon {

// Fewer records to train on tell nothing of a model's errors.
inline constexpr std::size_t least_cross_fitted = 50;
bool has_enough_records(const Split& split);  // to learn an UncertaintyModel from
// Records that a model has not seen: it answers for them.
struct Judged {
  const Estimator& model;
  Rows rows;
};
// What may be said of the model, by its own answers, or by those of its likes that were trained on
// part of its records (cross-fitting; Chernozhukov et al., Econometrics Journal 21, C1, 2018). Row
// i of the views is of record i of the data; `usual`: what is in distribution.
UncertaintyModel fit_uncertainty(const Estimator& model, const Dataset& data, const Matrix& views,
                                 const Rows& usual, const std::vector<Judged>& judged,
                                 std::uint64_t seed);
// By its own answers to the validation records, if these are at least 150. Else by what models of
// all but one fold of the records, which `fit` makes, say of that fold, in blocks if the split is
// in blocks. None if interrupted.
std::optional<UncertaintyModel> fit_uncertainty(const Estimator& model, const Dataset& data,
                                                const Matrix& views, const Split& split,
                                                const SplitOptions& options,
                                                const std::function<Estimator(const Split&)>& fit,
                                                std::size_t folds = 4);

// Photons are lost at random, up to all but 1/300 of them, and the radar gets more noise.
void degrade(Dataset& data, Rng& rng);

}  // namespace echofuse::recon
