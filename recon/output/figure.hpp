// SPDX-License-Identifier: MIT
// Pictures as PNG bytes: depth maps in colour, and the paper's figure.
#pragma once
#include <span>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

// A depth map (square, row-major, metres) in colour, each pixel `zoom` x `zoom`: dark = no return,
// bright = `farthest_m`.
Bytes depth_picture(std::span<const float> map, double farthest_m, int zoom);

enum class Ink { blue, orange };

struct Curve {
  std::string name;
  Ink ink;
  std::vector<double> range_m, value;
};

// histogram | truth | reconstruction | its standard deviation, if any row has one
struct FigureRow {
  std::string name;
  std::vector<Curve> curves;  // at most two: each is scaled to its own peak
  std::span<const float> truth, reconstruction, deviation;  // the last may be empty
  std::string caption;                                      // below the reconstruction
  std::string uncertainty, warning;  // below the deviation, one below the other
};

// Of maps over tangents of +-half_tangent.
Bytes figure(const std::string& title, const std::vector<FigureRow>& rows, double half_tangent);

}  // namespace echofuse::recon
