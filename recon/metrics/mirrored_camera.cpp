// SPDX-License-Identifier: MIT
#include "recon/metrics/mirrored_camera.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t min_records = 30;
constexpr double usual_baseline_m = 0.5;
// A correlation is clear if its Fisher z-transform exceeds this number of standard errors.
constexpr double clear = 4;

struct Place {
  double x_m = 0, z_m = 0;
};

// Returns the mean place of the pixels that differ from the background; `z_m` is 0 if there are
// too few.
Place place_of(std::span<const float> map, const SceneModel& scene, const Axis& x) {
  constexpr double min_share = 0.002;
  Place sum;
  double pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!true_foreground(map[p], scene.background[p])) continue;
    sum.x_m += double{map[p]} * x.at(static_cast<double>(p % scene.grid.size));
    sum.z_m += double{map[p]}, ++pixels;
  }
  if (pixels < min_share * static_cast<double>(map.size())) return {};
  return {sum.x_m / pixels, sum.z_m / pixels};
}

// Returns the mean range of the power above that of the room, from `near_m` to `far_m`; NaN if
// no power exceeds it. The squares of the powers are the weights, so that side lobes and noise
// count little.
double range_of(std::span<const float> power, const std::vector<float>& room, const Axis& axis,
                double near_m, double far_m) {
  double sum = 0, weight = 0;
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double range_m = axis.at(static_cast<double>(i));
    if (range_m < near_m || range_m > far_m) continue;
    const double over = std::max(0.0, double{power[i]} - double{room[i]});
    sum += over * over * range_m, weight += over * over;
  }
  return weight > 0 ? sum / weight : NAN;
}

std::string line_of(const Dataset& data, const Source& run) {
  Rows rows;
  for (std::size_t row = run.first; row < run.first + run.count; ++row)
    if (sound_depth(data, row) && data.has(row, Sensor::radar) &&
        doubt_of(data, row, Inputs::radar, false).empty())
      rows.push_back(row);
  if (rows.size() < min_records) return {};
  const SceneModel scene = learn_scene(data.depth(), rows, data.map);
  // A low quantile, because bodies may be in a range bin in most records.
  const std::vector<float> room = column_quantile(data.radar(), rows, 0.1);
  const Axis x = data.map.x();
  const double stated_m = run.mounting.baseline_m,
               baseline_m = stated_m > 0 ? stated_m : usual_baseline_m;
  // Measured distance by which the body is farther from the radar than from the camera, and the
  // part of the expected distance that changes its sign if the map is mirrored.
  std::vector<double> farther_m, of_side_m;
  for (const std::size_t row : rows) {
    const Place at = place_of(data.depth().row(row), scene, x);
    if (at.z_m <= 0) continue;
    const double own_m = std::hypot(at.x_m, at.z_m), reach_m = 1.5 * baseline_m;
    const double range_m =
        range_of(data.radar().row(row), room, data.radar().axis, own_m - reach_m, own_m + reach_m);
    if (std::isnan(range_m)) continue;
    farther_m.push_back(range_m - own_m);
    of_side_m.push_back(
        (std::hypot(at.x_m + baseline_m, at.z_m) - std::hypot(at.x_m - baseline_m, at.z_m)) / 2);
  }
  if (farther_m.size() < min_records) return {};
  const double found = correlation(farther_m, of_side_m);
  if (fisher_z(found) * std::sqrt(static_cast<double>(farther_m.size() - 3)) > -clear) return {};
  return printable(run.path) +
         format(
             ": the depth maps show bodies on the wrong side (correlation of the side with the "
             "radar's ranges %.2f in %zu records): the camera image is mirrored, or the radar is "
             "to the right of the detector; flip the depth maps left to right",
             found, farther_m.size());
}

}  // namespace

std::string mirrored_camera(const Dataset& data) {
  if (data.radar().axis.count == 0 || data.depth().cols == 0) return {};
  std::string out;
  for (const Source& run : data.sources)
    if (const std::string line = line_of(data, run); !line.empty())
      out += (out.empty() ? "" : "\n") + line;
  return out;
}

}  // namespace echofuse::recon
