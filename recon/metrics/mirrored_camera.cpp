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
  double x_m = 0, y_m = 0, z_m = 0;
};

// Returns the mean place of the pixels that differ from the background; `z_m` is 0 if there are
// too few.
Place place_of(std::span<const float> map, const SceneModel& scene) {
  constexpr double min_share = 0.002;
  const Axis x = scene.grid.x(), y = scene.grid.y();
  Place sum;
  double pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!true_foreground(map[p], scene.background[p])) continue;
    sum.x_m += double{map[p]} * x.at(static_cast<double>(p % scene.grid.size));
    sum.y_m += double{map[p]} * y.at(static_cast<double>(p / scene.grid.size));
    sum.z_m += double{map[p]}, ++pixels;
  }
  if (pixels < min_share * static_cast<double>(map.size())) return {};
  return {sum.x_m / pixels, sum.y_m / pixels, sum.z_m / pixels};
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

// Measured values of the records with a body, and values that change their sign if the map is
// flipped.
struct Pairs {
  std::vector<double> measured, of_map;

  void add(double one, double other) {
    if (!std::isnan(one)) measured.push_back(one), of_map.push_back(other);
  }
  // Returns " 0.50 in 60 records": the correlation if it is clearly negative, otherwise nothing.
  std::string flipped() const {
    if (measured.size() < min_records) return {};
    const double found = correlation(measured, of_map),
                 errors = fisher_z(found) * std::sqrt(static_cast<double>(measured.size() - 3));
    return errors > -clear ? "" : format(" %.2f in %zu records", found, measured.size());
  }
};

// Calls `add` with each row that has a body, its place, and the values of the sensor in the room
// without a body.
template <class Add>
void each_body(const Dataset& data, const Source& run, const Column& column, Inputs inputs,
               Add add) {
  Rows rows;
  for (std::size_t row = run.first; row < run.first + run.count; ++row)
    if (sound_depth(data, row) && data.has(row, column.sensor) &&
        doubt_of(data, row, inputs, false).empty())
      rows.push_back(row);
  if (rows.size() < min_records) return;
  const SceneModel scene = learn_scene(data.depth(), rows, data.map);
  // A low quantile, because bodies may be in a range bin in most records.
  const std::vector<float> room = column_quantile(column, rows, 0.1);
  for (const std::size_t row : rows)
    if (const Place at = place_of(data.depth().row(row), scene); at.z_m > 0) add(row, at, room);
}

// Distance by which the body is farther from the radar than from the camera, and the part of the
// expected distance that changes its sign if the map is mirrored.
std::string by_radar(const Dataset& data, const Source& run) {
  const double stated_m = run.mounting.baseline_m,
               baseline_m = stated_m > 0 ? stated_m : usual_baseline_m, reach_m = 1.5 * baseline_m;
  Pairs side;
  each_body(data, run, data.radar(), Inputs::radar,
            [&](std::size_t row, const Place& at, const std::vector<float>& room) {
              const double own_m = std::hypot(at.x_m, at.z_m);
              side.add(range_of(data.radar().row(row), room, data.radar().axis, own_m - reach_m,
                                own_m + reach_m) -
                           own_m,
                       (std::hypot(at.x_m + baseline_m, at.z_m) -
                        std::hypot(at.x_m - baseline_m, at.z_m)) /
                           2);
            });
  const std::string found = side.flipped();
  if (found.empty()) return found;
  return format(
      "the depth maps show bodies on the wrong side (correlation of the side with the radar's "
      "ranges%s): the camera image is mirrored, or the radar is to the right of the detector; flip "
      "the depth maps left to right",
      found.c_str());
}

// Mean direction of the light from the body's range, and direction of the body in the map.
std::string by_zones(const Dataset& data, const Source& run) {
  constexpr double reach_m = 0.3;
  const ColumnAxis& axis = data.spd().axis;
  Pairs side, height;
  each_body(data, run, data.spd(), Inputs::spd,
            [&](std::size_t row, const Place& at, const std::vector<float>& room) {
              const double own_m = std::hypot(at.x_m, at.y_m, at.z_m);
              const auto counts = data.spd().row(row);
              double x = 0, y = 0, sum = 0;
              for (std::size_t k = 0; k < counts.size(); ++k) {
                const double range_m = axis.at(static_cast<double>(k % axis.count)) / ps_per_m;
                if (std::abs(range_m - own_m) > reach_m || counts[k] <= room[k]) continue;
                const Zone& zone = axis.zones[k / axis.count];
                const double over = double{counts[k]} - double{room[k]};
                x += over * zone.x, y += over * zone.y, sum += over;
              }
              side.add(x / sum, at.x_m / at.z_m), height.add(y / sum, at.y_m / at.z_m);
            });
  if (const std::string found = side.flipped(); !found.empty())
    return format(
        "the depth maps show bodies on the wrong side (correlation with the side of the light in "
        "the zones%s): the camera image is mirrored, or the zones are in another order; flip the "
        "depth maps left to right",
        found.c_str());
  if (const std::string found = height.flipped(); !found.empty())
    return format(
        "the depth maps are upside down (correlation with the height of the light in the zones%s), "
        "or the zones are in another order; flip the depth maps",
        found.c_str());
  return {};
}

}  // namespace

std::string mirrored_camera(const Dataset& data) {
  if (data.depth().cols == 0) return {};
  const ColumnAxis& spd = data.spd().axis;
  const bool sides = spd.count > 0 && spd.zones.size() > 1 && spd.zones[0].has_direction();
  std::string out;
  for (const Source& run : data.sources) {
    std::string line = sides ? by_zones(data, run) : "";
    if (line.empty() && data.radar().axis.count > 0) line = by_radar(data, run);
    if (line.empty()) continue;
    if (!out.empty()) out += '\n';
    out += printable(run.path) + ": " + line;
  }
  return out;
}

}  // namespace echofuse::recon
