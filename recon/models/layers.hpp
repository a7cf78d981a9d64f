// SPDX-License-Identifier: MIT
// What models are made of, for other people's runtimes.
#pragma once
#include <vector>

#include "recon/models/body/body_frame.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// y = x W + b, and max(0, y) after it if it is rectified.
struct AffineLayer {
  Matrix weights;             // inputs x outputs
  std::vector<float> biases;  // outputs
  bool rectified = false;
};

// A model that places a body and draws it into the map. Its inputs x end with the range of the
// body, 0 if there is none: then the map is the background.
//   s = (x - centre) / deviation, what the networks take
//   side, behind = the first two outputs of the positions' mean, metres
//   depth = max(range + behind, nearest_m), tangent = side / max(range, nearest_m)
//   share, relief = masks and reliefs of the shapes' mean, drawn by BodyFrame at {tangent, depth}
//   map = depth + relief / share where the share is above the threshold, else background
struct BodyLayers {
  std::vector<float> background;  // metres, of the map's pixels
  std::vector<float> centre, deviation;
  std::vector<std::vector<AffineLayer>> positions, shapes;  // networks; no shapes: always the same
  AffineLayer masks, reliefs;  // from shapes to the frame's cells, row by row
  BodyFrame::Grid frame;
  float nearest_m, threshold;
};

}  // namespace echofuse::recon
