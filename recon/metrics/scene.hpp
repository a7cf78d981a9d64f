// SPDX-License-Identifier: MIT
// A scene holds what the training maps say of the place itself, and defines what stands out from
// it.
//
// A pixel of a true map is foreground if d > 0 and b = 0 or |d - b| > 0.1 m, where b is the
// background map: the median of the training maps, 0 where a fifth of them has no return.
// A pixel of a prediction v is foreground if it lies nearer to m, the mean depth of the training
// foreground, than to b. Where b = 0, the rule depends on the map: if it holds returns, v > 0; if
// it holds expected depths (probability of a return times depth, from a regression), v > m / 2. No
// body stands out if a quarter of what is off the background lies behind it, as when a wall is
// moved to and fro. Then nothing is foreground, and the thresholded map is the raw one.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Scene {
  std::vector<float> background;  // b: per-pixel median of the training maps, metres
  std::vector<float> mean_map;    // metres
  float foreground_depth_m = 0;   // m; 0: no body stands out
  record::MapGrid grid;           // grid of these and of all maps beside them

  bool has_body() const { return foreground_depth_m > 0; }
};

inline constexpr const char* no_body =
    "no body stands out from the background: IoU and lateral error are not defined, RMSE judges";

// There is one row a record. It holds how probably a body is at each pixel if the body is where the
// model puts it, and how far away (metres) the body is there in that case.
struct SoftMaps {
  Matrix foreground_probability, depth;
};

// The archive holds the background, the mean map and their grid.
void archive(Archive archive, Scene& scene);

// The mask of a map has one byte a pixel.
using Mask = std::vector<std::uint8_t>;

// Learns from the given rows (at least one) of the depth table; the maps are on this grid.
Scene learn_scene(const Matrix& depth, const Rows& rows, const record::MapGrid& grid);

bool true_foreground(float depth_m, float background_m);

// True if at most a tenth of the map's values without a background are below m / 8. Expected depths
// have many such values at the edges of a body and in their ripple; returns have none.
bool holds_returns(std::span<const float> map, const Scene& scene);

// Position of each predicted pixel between background (0) and mean foreground depth (1); above 0.5
// it is foreground. For a least-squares prediction over an open room it estimates the probability
// of foreground, but ripple may leave 0..1. Returns over an open room give 0 or 1.
std::vector<float> foreground_share(std::span<const float> prediction, const Scene& scene);

// Returns the prediction as it is shown, stored and compared: clipped to the grid's depths,
// 0..far_m.
std::vector<float> within_span(std::span<const float> prediction, const Scene& scene);

// The thresholded map is the prediction where it is foreground, and the background elsewhere.
std::vector<float> thresholded_map(std::span<const float> prediction, const Scene& scene);

}  // namespace echofuse::recon
