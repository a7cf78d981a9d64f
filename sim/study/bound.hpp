// SPDX-License-Identifier: MIT
// How well a lateral position can be known at all: the Cramer-Rao bound of the scenes of a data
// set, from their noise-free histogram (Poisson) and range profile (Gaussian).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"
#include "sim/sensors/render.hpp"
#include "sim/study/information.hpp"
#include "sim/study/scene_parts.hpp"

namespace echofuse::sim {

// What is known of a scene but for the noise's law, the background, and the sensors' axes.
enum class Known : std::uint8_t {
  // Everything but x, z, turn and the gain of either sensor. No prior.
  shape,
  // Only the kind (person, which letter and its size). Height, albedo, every angle of the limbs and
  // where the letter is held are unknown as well. Of all but the gains it is known how they are
  // drawn: each uniform range enters as a Gaussian of the same variance.
  pose,
};

struct Bound {
  std::string axis;   // base, snr_db, photons, baseline_m, resolution_m
  double value = 0;   // 0 for base
  std::string known;  // shape, pose
  // Over the scenes: of the least standard deviation of the body's x (where it stands), m.
  double x_median_m = 0, x_lower_m = 0, x_upper_m = 0;  // quartiles
  // The mean over scenes of the mean absolute error, sqrt(2/pi) sigma of a Gaussian: of x, and of
  // what `lateral_m` measures, the angle of the silhouette's centroid times its distance.
  double x_error_m = 0, lateral_error_m = 0;
};

struct BoundOptions {
  Conditions conditions;
  std::int64_t scenes = 100;
  std::uint64_t seed = 1;
  std::int64_t rays = 512;  // both ways across the body, from each sensor
  double step = 0.0025;  // of the numerical derivatives, in ranges that a parameter is drawn from
  bool quiet = false;
  SceneParts parts = {};
};

// Of a part: nothing. Throws, beside what rows_of_scenes throws, Error(config) for conditions whose
// noise is another: pile-up, a coherent sum; Error( interrupted).
std::vector<Bound> study_bound(const BoundOptions& options);

// bound.csv and bound.svg in `folder`, which exists. Throws Error(disk).
void write_bound(const std::vector<Bound>& rows, const std::string& folder);

// What a sensor sees of a scene, by rays that follow the body: derivatives then do not drown in the
// jumps of its edges over a fixed grid. But for that the same as spd_returns and radar_returns.
struct Seen : Returns {
  std::vector<double> cosine_x, cosine_z;  // of the direction to each
  double tangent = 0;                      // x/z of the silhouette's centroid
  double z_m = 0;                          // its mean depth
};
Seen seen_by_spd(const Scene& scene, const Conditions& conditions, std::int64_t rays);
Seen seen_by_radar(const Scene& scene, const Conditions& conditions, std::int64_t rays);

}  // namespace echofuse::sim
