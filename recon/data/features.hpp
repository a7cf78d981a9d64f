// SPDX-License-Identifier: MIT
// Features make the input of a model from the raw inputs of the sensors: [SPD histogram ++ radar
// profile]. Of a detector with zones the histograms of all zones stand side by side. Each sensor is
// scaled by itself, so that hundreds of SPD bins do not drown tens of radar bins. Models that look
// at the body scale by themselves (method/method.hpp).
#pragma once
#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/data/lags.hpp"
#include "recon/numbers/layout.hpp"

namespace echofuse::recon {

// The scaling says how one record's raw inputs are normalised before the training set's scaling:
//   plain   as they are
//   sqrt    square root, which makes the noise of a Poisson count the same in every bin
//   raw     as they are, and not scaled by the training set either (models that do it themselves)
//   record  minus the record's own median (background), divided by its own sum: laser power,
//           exposure and radar gain do not matter
//   root    square root of "record", 0 below the background
inline const std::vector<std::string> scaling_names = {"plain", "sqrt", "record", "root"};

inline const std::string raw_scaling = "raw";

// Applies "record" to one sensor's values. If nothing is above the background, all are zero.
void normalise(std::span<float> values);

struct Features {
  Layout layout() const {
    return {spd_count() > 0 ? spd_axis : Axis{}, radar_count() > 0 ? radar_axis : Axis{},
            array_axis, zones};
  }
  Inputs inputs = Inputs::fused;
  std::string scaling = "record";
  Axis spd_axis, radar_axis;           // axes that a record must have
  std::vector<float> centre;           // one an input; it is subtracted
  float spd_gain = 1, radar_gain = 1;  // factors that follow
  Axis array_axis = {};                // count 0: the model does not take it
  std::size_t zones = 0;               // 0: one histogram, the sum of the zones if there are any

  std::size_t spd_count() const {
    return inputs == Inputs::radar ? 0 : spd_axis.count * std::max<std::size_t>(zones, 1);
  }
  std::size_t radar_count() const { return inputs == Inputs::spd ? 0 : radar_axis.count; }
  std::size_t array_count() const { return lag_columns(array_axis); }
  std::size_t count() const { return spd_count() + radar_count() + array_count(); }
  // Returns [SPD ++ radar] of each of `rows`, as they are. Throws as require_zones.
  Matrix raw_inputs(const Dataset& data, const Rows& rows) const;
  // Inputs of the rows, brought to a common strength by `scaling` only.
  Matrix normalised_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the model's input: one row of count() values for each of `rows`.
  Matrix apply(const Dataset& data, const Rows& rows) const;
};

// Throws Error(failed) unless the detector of the data has this number of zones; 0: any number.
void require_zones(const Dataset& data, std::size_t zones);

// Learns centre and gains from `rows`, if any: the inputs of each sensor get the same total
// variance.
Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling);

}  // namespace echofuse::recon
