// SPDX-License-Identifier: MIT
// Cramer-Rao bound of a lateral position: for the scenes of a data set, from their noise-free
// histogram (Poisson) and range profile (Gaussian).
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Fisher information of noisy measurements, and the Cramer-Rao bound that follows from it.
using Values = std::vector<double>;
using Matrix = std::vector<Values>;  // rows

// Noise-free measurements as a function of the parameters.
using Model = std::function<Values(const Values& parameters)>;

// Returns d model / d parameter at `at`, a row a parameter, by central differences over +-step.
Matrix slopes(const Model& model, const Values& at, double step);

// Returns J J^T from `rows` of slopes, in columns first..first+count-1, with noise of unit
// variance.
//   For Gaussian noise of sigma, divide the information by sigma^2.
//   For Poisson counts of mean l it is sum (dl)^2 / l = sum (d 2 sqrt(l))^2, so let the model
//   return 2 sqrt(l). That needs no division by bins that hold next to nothing.
Matrix information(const Matrix& rows, std::size_t first, std::size_t count);

// Least standard deviation of an unbiased estimate of a quantity with this gradient: sqrt(g^T M^-1
// g), infinite if the information does not determine it. With the information of a prior added to
// the diagonal it is the posterior's width where both are Gaussian (van Trees).
double least_deviation(const Matrix& information, const Values& gradient);

// Knowledge of a scene. Always known: the noise's law, the background, the sensors' axes.
enum class Known : std::uint8_t {
  // Everything is known but x, z, turn and the gain of either sensor. There is no prior.
  shape,
  // Only the kind is known (person, which letter and its size). Height, albedo, every angle of the
  // limbs and where the letter is held are unknown as well. It is known how all but the gains are
  // drawn: each uniform range enters as a Gaussian of the same variance.
  pose,
};

struct Bound {
  std::string axis;   // base, snr_db, photons, baseline_m, resolution_m
  double value = 0;   // 0 for base
  std::string known;  // shape, pose
  // Quartiles over the scenes of the least standard deviation of the body's x (where it stands), m.
  double x_median_m = 0, x_lower_m = 0, x_upper_m = 0;  // quartiles
  // Mean over scenes of the mean absolute error, sqrt(2/pi) sigma of a Gaussian, m: of x, and of
  // the metric `lateral_m` (angle of the silhouette's centroid times its distance).
  double x_error_m = 0, lateral_error_m = 0;
};

struct BoundOptions {
  Conditions conditions;
  std::int64_t scenes = 100;
  std::uint64_t seed = 1;
  std::int64_t rays = 512;  // both ways across the body, from each sensor
  double step = 0.0025;     // step of derivatives, in ranges that a parameter is drawn from
  bool quiet = false;
};

// Throws Error(config) for conditions with other noise (pile-up, a coherent sum), and
// Error(interrupted).
std::vector<Bound> study_bound(const BoundOptions& options);

// Writes bound.csv in `folder`, which exists. Throws Error(disk).
void write_bound(const std::vector<Bound>& rows, const std::string& folder);

// Returns of a scene by rays that follow the body, because the body's edges jump over a fixed grid
// and hide derivatives. Otherwise as spd_returns and radar_returns.
struct Seen : Returns {
  std::vector<double> cosine_x, cosine_z;  // cosines of the direction to each
  double tangent = 0;                      // x/z of the silhouette's centroid
  double z_m = 0;                          // its mean depth
};
Seen seen_by_spd(const Scene& scene, const Conditions& conditions, std::int64_t rays);
Seen seen_by_radar(const Scene& scene, const Conditions& conditions, std::int64_t rays);

}  // namespace echofuse::sim
