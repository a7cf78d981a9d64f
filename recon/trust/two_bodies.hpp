// SPDX-License-Identifier: MIT
// A small network tells whether a record shows two bodies. No training record does, but the sum of
// two of them is what two bodies measure when neither hides the other (training on made-up
// outliers: Hendrycks et al., ICLR 2019). The network tells views of such sums from views of single
// records. A view is about the centroid of all that is there. The bodies of a sum stand apart
// sideways, as two bodies cannot stand in one place. With both sensors and a baseline all bodies
// are turned about the SPD (method/turned.hpp), so that few records make many.
#pragma once
#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/models/network/classifier.hpp"

namespace echofuse::recon {

// It learns from the given rows, each with one body at most; their maps tell where. The classifier
// takes a view without its correlation that shows a body. Fewer than two bodies teach nothing.
Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Rows& rows, const Scene& scene,
                            std::uint64_t seed);

}  // namespace echofuse::recon
