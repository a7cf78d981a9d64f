// SPDX-License-Identifier: MIT
// Detects depth maps that are mirrored left to right, from the ranges of the radar or the zones of
// the detector, or upside down, from the zones.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// The radar is at x = -baseline, seen from the camera. A body at (x, z) is therefore farther from
// the radar than from the camera by sqrt((x + b)^2 + z^2) - sqrt(x^2 + z^2). This difference is
// correlated with the measured one. Returns one line for each run in which the correlation is
// clearly negative; usually the camera image is mirrored, or the radar is on the other side.
// With zones, the direction of the light is correlated with that of the body in the map. Returns an
// empty string if the records show nothing, e.g. if no body moves sideways. Without zones, a
// vertical flip cannot be detected, because both sensors are at the same height. Ignores doubtful
// rows.
std::string mirrored_camera(const Dataset& data);

}  // namespace echofuse::recon
