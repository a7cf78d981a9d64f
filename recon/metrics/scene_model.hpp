// SPDX-License-Identifier: MIT
// A scene is learnt from the training maps (background, mean map) and defines the foreground.
//
// A pixel of a true map is foreground if d > 0 and b = 0 or |d - b| > 0.1 m, where b is the
// background map: the median of the training maps, 0 where a fifth of them has no return. A
// predicted pixel v is foreground if it is nearer to m than to b; m is the mean depth of the
// training foreground. Where b = 0, the rule depends on the map: v > 0 if it contains returns; v >
// m / 2 if it contains expected depths (probability of a return times depth, from a regression).
// No pixel is foreground if a quarter of the deviation from the background lies behind it, e.g.
// when a wall was moved. Then the thresholded map is the raw one.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct SceneModel {
  std::vector<float> background;  // b: per-pixel median of the training maps, metres
  std::vector<float> mean_map;    // metres
  float foreground_depth_m = 0;   // m; 0: no foreground
  record::MapGrid grid;           // grid of these and of all maps used with them

  bool has_body() const { return foreground_depth_m > 0; }
};

inline constexpr const char* no_body =
    "no body differs from the background: IoU and lateral error are undefined; RMSE is used";

// One row per record: the probability that the body covers each pixel if it is at the model's
// position, and the body's depth there (m).
struct SoftMaps {
  Matrix foreground_probability, depth;
};

void archive(Archive archive, SceneModel& scene);

// The mask of a map has one byte per pixel.
using Mask = std::vector<std::uint8_t>;

// Learns from these rows (at least one) of the depth table; the maps are on this grid.
SceneModel learn_scene(const Matrix& depth, const Rows& rows, const record::MapGrid& grid);

bool true_foreground(float depth_m, float background_m);

// True if at most a tenth of the map's values without a background are below m / 8. Expected depths
// have many such values at the edges of a body and in their ripple; returns have none.
bool holds_returns(std::span<const float> map, const SceneModel& scene);

// Position of each predicted pixel between background (0) and mean foreground depth (1); foreground
// above 0.5. For a least-squares prediction in an open room it estimates the probability of
// foreground, but may leave 0..1. For returns in an open room it is 0 or 1.
std::vector<float> foreground_share(std::span<const float> prediction, const SceneModel& scene);

// Returns the prediction as it is shown, stored and compared: clipped to 0..far_m of the grid.
std::vector<float> within_span(std::span<const float> prediction, const SceneModel& scene);

// The thresholded map: the prediction where it is foreground, the background elsewhere.
std::vector<float> thresholded_map(std::span<const float> prediction, const SceneModel& scene);

}  // namespace echofuse::recon
