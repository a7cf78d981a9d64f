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

/// Reason why a record has no map.
enum class FaultCode : std::uint8_t {
  none,             ///< the record has a map
  sensor_missing,   ///< the data of a sensor that the model needs are missing
  constant_values,  ///< the values of a sensor are the same in every bin
  damaged,          ///< the record contains impossible values
};

/// Depth map predicted for one record.
struct DepthMap {
  /// Depth z at each pixel of Model::grid(), in metres, in row-major order; 0: no return. Each
  /// pixel contains the depth of either the body or the background. Empty if `fault` is set.
  std::vector<float> depth_m;
  /// Standard deviation of each pixel's depth, m. Empty if the model does not estimate errors.
  std::vector<float> deviation_m;
  std::optional<Body> body;                ///< empty if the map contains no body
  FaultCode fault_code = FaultCode::none;  ///< kind of the fault
  std::string fault;  ///< why no map was predicted, e.g. `radar missing`; otherwise empty
  std::string note;   ///< note on missing sensor data, e.g. `radar lost: SPD alone`; usually empty
  /// Verdict on a sensor that delivered doubtful data, e.g. `SPD weak`; otherwise empty.
  std::string doubt;
  /// How the record differs from the training data; usually empty.
  std::string out_of_distribution;
};

/// Predicts the map of a record in the same way as `echofuse-recon reconstruct`. Applies the run's
/// range calibration, and corrects the counts for pile-up. Sets `fault` if the record cannot be
/// used. Throws Exception if the axes of the run and the model differ. Threading: any thread.
[[nodiscard]] DepthMap predict(const Model& model, const Record& record);

/// Predicts a map from values that do not come from a run. `spd` contains the number of
/// detections in each bin, as [Model::zones()][Model::spd_axis().count]. `radar` contains
/// Model::radar_axis().count linear powers, which may be negative after the subtraction of noise.
/// Range offsets must already be corrected. If `spd` or `radar` is empty, the map is predicted
/// from the other sensor, provided that the model supports this; otherwise `fault` is set. Throws
/// Exception if the number of values is wrong, a value is not finite, or a count is
/// negative. Threading: any thread.
[[nodiscard]] DepthMap predict(const Model& model, std::span<const float> spd,
                               std::span<const float> radar);

}  // namespace echofuse
