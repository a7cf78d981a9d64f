// SPDX-License-Identifier: MIT
// The scene model defines which pixels of a depth map are foreground. It is learnt from the
// training maps and contains their background b and the mean depth m of their foreground. b is the
// median of the training maps, or 0 where at least a fifth of them have no return.
//
// A pixel of a ground-truth map with depth d is foreground if d > 0 and either b = 0 or |d - b| >
// 0.1 m. A predicted pixel with depth v is foreground if v is nearer to m than to b. If b = 0, the
// rule depends on the map. In a map of returns, v > 0 is foreground. In a map of expected depths
// (probability of a return times depth, from a regression), v > m / 2 is foreground.
//
// If at least a quarter of the deviation from the background lies behind it, e.g. because a wall
// was moved, no pixel is foreground. The thresholded map is then equal to the raw map.
#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct SceneModel {
  std::vector<float> background;  // b: per-pixel median of the training maps, m
  std::vector<float> mean_map;    // per-pixel mean of the training maps, m
  float foreground_depth_m = 0;   // mean depth of the foreground, m; 0 if the foreground is empty
  record::MapGrid grid;           // grid of these maps, and of all maps compared with them

  bool has_body() const { return foreground_depth_m > 0; }
};

inline constexpr const char* no_body =
    "the depth maps show no body in front of the background: IoU and lateral error are undefined; "
    "RMSE is used instead";

// One row per record. For each pixel: the probability that the body covers it, given the predicted
// position, and the depth of the body there (m).
struct SoftMaps {
  Matrix foreground_probability, depth;
};

void archive(Archive archive, SceneModel& scene);

// Foreground mask of a map, one byte per pixel.
using Mask = std::vector<std::uint8_t>;

// Learns the background and the foreground from the given rows of a table of depth maps. `rows`
// must not be empty; `grid` is the grid of the maps.
SceneModel learn_scene(const Matrix& depth, const Rows& rows, const record::MapGrid& grid);

bool true_foreground(float depth_m, float background_m);

// Returns true if the map contains returns, false if it contains expected depths. Considers pixels
// that have no background: a map contains returns if at most a tenth of these pixels have values
// below an eighth of the mean foreground depth. Expected depths have many such values at the edges
// of a body.
bool holds_returns(std::span<const float> map, const SceneModel& scene);

// For each pixel, returns the relative position of its depth between the background (0) and the
// mean foreground depth (1). Pixels above 0.5 are foreground. If the map contains returns
// (holds_returns) and a pixel has no background, its value is 1 for a return and 0 otherwise. For a
// least-squares prediction, the value estimates the probability of foreground, and may be below 0
// or above 1.
std::vector<float> foreground_share(std::span<const float> prediction, const SceneModel& scene);

// Returns the prediction clipped to the range from 0 to the maximum depth of the grid (`far_m`), as
// it is displayed, stored and scored.
std::vector<float> within_span(std::span<const float> prediction, const SceneModel& scene);

// Returns the thresholded map, which contains the prediction at foreground pixels and the
// background elsewhere.
std::vector<float> thresholded_map(std::span<const float> prediction, const SceneModel& scene);

}  // namespace echofuse::recon
