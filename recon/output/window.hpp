// SPDX-License-Identifier: MIT
// The part of a map about the body that it shows, enlarged to as many pixels as the map has.
#pragma once
#include <span>
#include <vector>

#include "drivers/core/axis.hpp"
#include "recon/maps/scene.hpp"

namespace echofuse::recon {

struct Window {
  Axis x, y;  // tangents of the pixel centres
};

// Of size_m x size_m metres at the mean depth of the map's foreground, about its centroid; about
// the axis at the training bodies' depth if the map shows nobody.
Window window_about_body(std::span<const float> map, const Scene& scene, double size_m);

// Each pixel is the map's nearest one, 0 outside the map: depths never mix.
std::vector<float> cut(std::span<const float> map, const record::MapGrid& grid,
                       const Window& window);

}  // namespace echofuse::recon
