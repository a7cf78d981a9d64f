// SPDX-License-Identifier: MIT
/// @file
/// Depth map of a record, with its error.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "echofuse/model.hpp"
#include "echofuse/run.hpp"

namespace echofuse {

/// Body that a map shows.
struct Body {
  double x_m = 0;  ///< to the right of the detector, m
  double z_m = 0;  ///< distance from the detector's plane, m
  /// Radius that contains the body in 90 % of the records like the training, m. Empty if the model
  /// states no errors, or if the record is unlike the training.
  std::optional<double> lateral_interval_90_m;
};

/// Prediction for one record.
struct DepthMap {
  /// Depth z in m on Model::grid(), row-major; 0: no return. The body is cut out of the background.
  /// Empty with a fault.
  std::vector<float> depth_m;
  /// Standard deviation of each pixel, m. Empty if the model states no errors.
  std::vector<float> deviation_m;
  std::optional<Body> body;         ///< empty if the map shows none
  std::string fault;                ///< reason without a map, such as `radar missing`; else empty
  std::string note;                 ///< which sensor the map was made without; usually empty
  std::string doubt;                ///< verdict of a doubtful sensor, as `SPD weak`
  std::string out_of_distribution;  ///< why the record is unlike the training; usually empty
};

/// Predicts the map of the run's record with this number, as `echofuse-recon reconstruct` does:
/// ranges are corrected by the run's calibration, counts for pile-up. A record that cannot be used
/// has a `fault`. Throws std::runtime_error if the run's axes are not the model's. Threading: as
/// Run.
DepthMap predict(const Model& model, const Run& run, std::int64_t index);

/// Predicts a map from values of another source, at true ranges: `counts` as
/// [Model::zones()][Model::spd_axis().count] detections, `power` as Model::radar_axis().count
/// linear powers. Either may be empty: then a model of the other sensor answers, or the map has a
/// `fault`. Throws std::runtime_error for another size, a value that is not finite, or a negative
/// count; power is negative where noise was subtracted. Threading: any thread.
DepthMap predict(const Model& model, std::span<const float> counts, std::span<const float> power);

}  // namespace echofuse
