// SPDX-License-Identifier: MIT
// Compiled with -fno-trapping-math. Otherwise the compiler does not vectorise a division in a loop
// with a condition.
#include "recon/metrics/scene_model.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/clones.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr float foreground_step_m = 0.1f;
// The foreground is treated as empty if at least this fraction of its summed depth differences from
// the background comes from pixels that lie behind the background.
constexpr double max_behind = 0.25;
// Minimum depth of a return, relative to the mean foreground depth.
constexpr float nearest_share = 0.125f;
// Maximum fraction of values below the minimum depth in a map of returns.
constexpr double max_nearer = 0.1;

std::vector<float> median_map(const Matrix& depth, const Rows& rows) {
  // The median of about 1000 maps is accurate enough.
  const std::size_t stride = std::max<std::size_t>(1, rows.size() / 1000);
  Rows some;
  for (std::size_t i = 0; i < rows.size(); i += stride) some.push_back(rows[i]);
  return column_quantile(depth, some, 0.5);
}

// Sets the background to 0 (no return) where at least a fifth of the maps have no return, even if
// most maps contain a body there. A camera normally loses fewer returns.
void clear_behind_bodies(std::vector<float>& background, const Matrix& depth, const Rows& rows) {
  std::vector<std::size_t> empty(depth.cols);
  for (const std::size_t row : rows)
    for (std::size_t p = 0; p < empty.size(); ++p) empty[p] += !(depth.row(row)[p] > 0);
  for (std::size_t p = 0; p < empty.size(); ++p)
    if (5 * empty[p] >= rows.size()) background[p] = 0;
}

// Clamps the values to [0, most].
ECHOFUSE_CLONES void clamp(const float* values, float maximum, float* __restrict out,
                           std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) {
    const float v = values[i], low = v < 0 ? 0 : v;
    out[i] = low > maximum ? maximum : low;
  }
}

}  // namespace

bool true_foreground(float depth_m, float background_m) {
  return depth_m > 0 && (background_m <= 0 || std::abs(depth_m - background_m) > foreground_step_m);
}

SceneModel learn_scene(const Matrix& depth, const Rows& rows, const record::MapGrid& grid) {
  SceneModel scene{median_map(depth, rows), std::vector<float>(depth.cols), 0, grid};
  clear_behind_bodies(scene.background, depth, rows);
  std::vector<double> sum(depth.cols);
  double foreground_sum = 0, off_m = 0, behind_m = 0;
  std::size_t foreground_count = 0;
  for (const std::size_t row : rows) {
    const auto map = depth.row(row);
    for (std::size_t p = 0; p < map.size(); ++p) {
      sum[p] += map[p];
      if (!true_foreground(map[p], scene.background[p])) continue;
      const float before_m = scene.background[p] - map[p];
      off_m += std::abs(before_m);
      if (scene.background[p] > 0) behind_m -= std::min(before_m, 0.f);
      foreground_sum += map[p];
      ++foreground_count;
    }
  }
  for (std::size_t p = 0; p < sum.size(); ++p)
    scene.mean_map[p] = static_cast<float>(sum[p] / static_cast<double>(rows.size()));
  if (foreground_count > 0 && behind_m < max_behind * off_m)
    scene.foreground_depth_m =
        static_cast<float>(foreground_sum / static_cast<double>(foreground_count));
  return scene;
}

void archive(Archive archive, SceneModel& scene) {
  constexpr float farthest_m = 100;
  archive.count("map_size", scene.grid.size, record::min_map_size, record::max_map_size);
  archive.number("map_half_tangent", scene.grid.half_tangent, record::min_map_half_tangent,
                 record::max_map_half_tangent);
  archive.number("map_z_max_m", scene.grid.far_m, record::min_map_far_m, record::max_map_far_m);
  archive.number("foreground_depth_m", scene.foreground_depth_m, 0, double{farthest_m});
  for (auto& [name, map] :
       {std::pair<const char*, std::vector<float>&>{"background_m", scene.background},
        {"mean_map_m", scene.mean_map}}) {
    archive.values(name, map, scene.grid.pixels());
    archive.require(std::all_of(map.begin(), map.end(),
                                [](float depth) { return depth >= 0 && depth <= farthest_m; }),
                    name, "expected depths of 0 to 100 m");
  }
}

namespace {

struct ReturnCounts {
  std::uint32_t count = 0, nearer = 0;
};

ECHOFUSE_CLONES ReturnCounts returns_of(const float* map, const float* background, float nearest_m,
                                        std::size_t count) {
  ReturnCounts out;
  for (std::size_t p = 0; p < count; ++p) {
    const std::uint32_t here = (background[p] <= 0) & (map[p] > 0);
    out.count += here, out.nearer += here & static_cast<std::uint32_t>(map[p] < nearest_m);
  }
  return out;
}

ECHOFUSE_CLONES void share_of(const float* prediction, const float* background, float depth_m,
                              std::size_t count, float* __restrict__ out) {
  for (std::size_t p = 0; p < count; ++p) {
    const float off = prediction[p] - background[p], way = depth_m - background[p];
    // False if background and foreground have almost equal depths, so that they cannot be
    // distinguished.
    const bool distinct = std::abs(way) > foreground_step_m;
    out[p] = (distinct ? off : 0.f) / (distinct ? way : 1.f);
  }
}

ECHOFUSE_CLONES void mark_returns(const float* prediction, const float* background,
                                  std::size_t count, float* __restrict__ share) {
  for (std::size_t p = 0; p < count; ++p) {
    const float found = prediction[p] > 0 ? 1.f : 0.f;
    share[p] = background[p] <= 0 ? found : share[p];
  }
}

}  // namespace

bool holds_returns(std::span<const float> map, const SceneModel& scene) {
  const ReturnCounts found = returns_of(map.data(), scene.background.data(),
                                        nearest_share * scene.foreground_depth_m, map.size());
  return double(found.nearer) <= max_nearer * double(found.count);
}

std::vector<float> foreground_share(std::span<const float> prediction, const SceneModel& scene) {
  std::vector<float> out(prediction.size());
  if (!scene.has_body()) return out;
  const float *map = prediction.data(), *background = scene.background.data();
  share_of(map, background, scene.foreground_depth_m, out.size(), out.data());
  if (holds_returns(prediction, scene)) mark_returns(map, background, out.size(), out.data());
  return out;
}

std::vector<float> within_span(std::span<const float> prediction, const SceneModel& scene) {
  std::vector<float> out(prediction.size());
  clamp(prediction.data(), static_cast<float>(scene.grid.far_m), out.data(), out.size());
  return out;
}

std::vector<float> thresholded_map(std::span<const float> prediction, const SceneModel& scene) {
  if (!scene.has_body()) return {prediction.begin(), prediction.end()};
  std::vector<float> out = scene.background;
  const auto share = foreground_share(prediction, scene);
  for (std::size_t p = 0; p < out.size(); ++p)
    if (share[p] > 0.5f) out[p] = prediction[p];
  return out;
}

}  // namespace echofuse::recon
