// SPDX-License-Identifier: MIT
// These numbers are known at the prediction, and tell how good a map will be: how far its body
// stands from the axis, and how strong each sensor's signal is against its noise.
#pragma once
#include "recon/data/dataset.hpp"
#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

// Returns a profile's peak over the scatter of its weaker half.
float peak_to_noise(std::span<const float> power);

std::size_t predictor_count(Inputs inputs);

// There is one row a map. It holds |x/z| of the map's foreground (NaN if there is none). For the
// SPD it holds log(1 + clicks above the background, in deviations of all clicks). For the radar it
// holds log(peak over the scatter of the weaker half of the profile). Row i of the maps belongs to
// rows[i] of the data.
Matrix predictors_of(const Matrix& maps, const Scene& scene, const Dataset& data, const Rows& rows,
                     Inputs inputs);

}  // namespace echofuse::recon
