// SPDX-License-Identifier: MIT
// Features: the input of a model, computed from the raw inputs [SPD histogram ++ radar profile].
// The histograms of all zones are concatenated. Each sensor has its own scale, because otherwise
// hundreds of SPD bins outweigh tens of radar bins. Models with aligned inputs scale them in
// method/method.hpp.
#pragma once
#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/data/lags.hpp"
#include "recon/numbers/layout.hpp"

namespace echofuse::recon {

// Normalisation of one record's inputs, before the scaling learnt from the training set: plain
// none
//   sqrt    square root, which gives Poisson counts equal noise in every bin
//   raw     none, and no scaling by the training set either (for models with their own scaling)
//   record  minus the record's median (background), divided by the sum: independent of laser power,
//   exposure and radar gain
//   root    square root of "record", 0 below the background
inline const std::vector<std::string> scaling_names = {"plain", "sqrt", "record", "root"};

inline const std::string raw_scaling = "raw";

// Applies "record" to one sensor's values. All become zero if none is above the background.
void normalise(std::span<float> values);

struct Features {
  Layout layout() const {
    return {spd_count() > 0 ? spd_axis : Axis{}, radar_count() > 0 ? radar_axis : Axis{},
            array_axis, zones};
  }
  Inputs inputs = Inputs::fused;
  std::string scaling = "record";
  Axis spd_axis, radar_axis;           // required axes of a record
  std::vector<float> centre;           // offset subtracted from each input
  float spd_gain = 1, radar_gain = 1;  // factors applied to each input
  Axis array_axis = {};                // count 0: not an input
  std::size_t zones = 0;               // 0: one histogram, the sum of any zones

  std::size_t spd_count() const {
    return inputs == Inputs::radar ? 0 : spd_axis.count * std::max<std::size_t>(zones, 1);
  }
  std::size_t radar_count() const { return inputs == Inputs::spd ? 0 : radar_axis.count; }
  std::size_t array_count() const { return lag_columns(array_axis); }
  std::size_t count() const { return spd_count() + radar_count() + array_count(); }
  // Returns unscaled [SPD ++ radar] of each of `rows`. Throws like require_zones().
  Matrix raw_inputs(const Dataset& data, const Rows& rows) const;
  // Inputs of the rows with `scaling` only.
  Matrix normalised_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the model's inputs: one row of count() values per row.
  Matrix apply(const Dataset& data, const Rows& rows) const;
};

// Throws Error(failed) unless the detector has this number of zones; 0: any number.
void require_zones(const Dataset& data, std::size_t zones);

// Learns centre and gains from `rows`, if not empty: all sensors get the same total variance.
Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling);

}  // namespace echofuse::recon
