// SPDX-License-Identifier: MIT
// Real recordings made by others: Turpin et al., "Spatial images from temporal data", Optica 7, 900
// (2020), github.com/aturpin88/Spatial-images-from-temporal-data. An RF transceiver's range
// histograms with the frames of a depth camera, in the order of time.
#pragma once
#include <cstdint>
#include <string>

namespace echofuse::recon {

// Depths of these recordings come in units of the scene's maximum, 0..1. A run file holds
// millimetres: 1.0 is stored as 6 m, the span of all our maps, so that errors divided by 6 m are in
// the recording's units again.
inline constexpr double turpin_scale_m = 6.0;

// DIR/histogram.npy [frames, bins] and DIR/depth.npy [frames, N, N] become a run with radar and
// depth. Unless `published_out` is empty, the authors' own reconstruction, DIR/published.npy,
// becomes a second run with their maps in place of the depth camera's. Returns the number of
// frames.
std::int64_t import_turpin(const std::string& dir, const std::string& out,
                           const std::string& published_out);

}  // namespace echofuse::recon
