// SPDX-License-Identifier: MIT
// Maps of records that show two bodies: where these can be taken apart (body/split_bodies.hpp), a
// model that places a body makes a map of each, and the nearer one covers the other.
#pragma once
#include "recon/estimator/predict.hpp"
#include "recon/maps/soft_maps.hpp"

namespace echofuse::recon {

// Replaces the maps, and what is stated, of the records that `made` states to be two bodies, if
// both are found; of the others the reason says that they are not. Row i of `made` and of `soft`
// (if there is any) belongs to rows[i]. Of a model that takes the radar's antennas its fallback for
// the range profile makes the maps.
void separate_bodies(const TrainedModel& model, const Dataset& data, const Rows& rows,
                     Prediction& made, SoftMaps* soft);

// By how much the places of bodies that are taken apart are off: errors of `most` sums of two of
// the rows, which the model has not seen, over the lateral intervals stated of each. None of a
// model that takes none apart.
std::vector<SeparatedError::Sum> errors_of_separated(const TrainedModel& model,
                                                     const LateralError& lateral,
                                                     const Dataset& data, const Rows& rows,
                                                     std::size_t most, std::uint64_t seed);

}  // namespace echofuse::recon
