// SPDX-License-Identifier: MIT
/// @file
/// Predicts the depth map of a record and estimates its errors.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "echofuse/model.hpp"
#include "echofuse/run.hpp"

namespace echofuse {

/// Position of the body in a depth map.
struct Body {
  double x_m = 0;  ///< lateral position, m; positive to the right of the detector
  double z_m = 0;  ///< distance from the detector plane, m
  /// Half-width of the 90 % interval around `x_m`, in metres; valid for records that resemble the
  /// training data. Empty if the model does not estimate errors, or if the record is out of
  /// distribution.
  std::optional<double> lateral_interval_90_m;
};

/// Depth map predicted for one record.
struct DepthMap {
  /// Depth z at each pixel of Model::grid(), in metres, in row-major order; 0: no return. Each
  /// pixel contains the depth of either the body or the background. Empty if `fault` is set.
  std::vector<float> depth_m;
  /// Standard deviation of each pixel's depth, m. Empty if the model does not estimate errors.
  std::vector<float> deviation_m;
  std::optional<Body> body;  ///< empty if the map contains no body
  std::string fault;         ///< why no map was predicted, e.g. `radar missing`; otherwise empty
  std::string note;  ///< note on missing sensor data, e.g. `radar lost: SPD alone`; usually empty
  /// Verdict on a sensor that delivered doubtful data, e.g. `SPD weak`; otherwise empty.
  std::string doubt;
  /// How the record differs from the training data; usually empty.
  std::string out_of_distribution;
};

/// Predicts the map of record `index` in the same way as `echofuse-recon reconstruct`. Applies the
/// run's range calibration, and corrects the counts for pile-up. Sets `fault` if the record cannot
/// be used. Throws std::runtime_error if the axes of the run and the model differ. Threading: the
/// rules of Run apply.
DepthMap predict(const Model& model, const Run& run, std::int64_t index);

/// Predicts a map from values that do not come from a run. `counts` contains the number of
/// detections in each bin, as [Model::zones()][Model::spd_axis().count]. `power` contains
/// Model::radar_axis().count linear powers, which may be negative after the subtraction of noise.
/// Range offsets must already be corrected. If `counts` or `power` is empty, the map is predicted
/// from the other sensor, provided that the model supports this; otherwise `fault` is set. Throws
/// std::runtime_error if the number of values is wrong, a value is not finite, or a count is
/// negative. Threading: any thread.
DepthMap predict(const Model& model, std::span<const float> counts, std::span<const float> power);

}  // namespace echofuse
