// SPDX-License-Identifier: MIT
#pragma once
#include <string>

#include "recon/models/model.hpp"
#include "recon/network/regression.hpp"

namespace echofuse::recon {

// Fits a network to the depth maps of the samples (mlp.cpp). Shows a progress line that begins with
// `title`.
TrainingLog fit_maps(Regression& regression, const Samples& train, const Samples& validation,
                     const Training& training, const std::string& title);

}  // namespace echofuse::recon
