// SPDX-License-Identifier: MIT
// Training records as they would have been under worse conditions, by the forward model of the
// sensors. A model that is trained on degraded copies is robust to them.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

//   noise  more radar noise: 20 down to 10 dB below the mean of the records' peaks
// Gains, impulse response and background have no copies: they hardly change the models' maps. A
// range offset has none: the operator states it.
inline const std::vector<std::string> augment_names = {"noise"};

// Appends a perturbed copy of the rows for each kind, and their numbers to `rows`. The data then
// belong to no source. Throws Error(usage) if the kind is not known.
void augment(Dataset& data, Rows& rows, const std::vector<std::string>& kinds, std::uint64_t seed);

}  // namespace echofuse::recon
