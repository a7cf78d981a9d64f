// SPDX-License-Identifier: MIT
// Features: the inputs of a model, computed from the raw inputs [SPD histogram ++ radar profile].
// The histograms of all zones are concatenated. SPD and radar have separate gains, because
// otherwise hundreds of SPD bins would outweigh tens of radar bins. Models with aligned inputs
// scale these in method/method.hpp.
#pragma once
#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/data/lags.hpp"
#include "recon/numbers/layout.hpp"

namespace echofuse::recon {

// Scaling of the inputs of each record, before the centre and the gains of the training set are
// applied:
//   plain   no scaling
//   sqrt    square root, after which Poisson counts have the same noise in every bin
//   raw     no scaling, centre or gains, for models that scale their inputs themselves
//   record  subtraction of the record's median (background) and division by the sum, which make
//           the inputs independent of laser power, exposure and radar gain
//   root    square root of "record"; 0 below the background
inline const std::vector<std::string> scaling_names = {"plain", "sqrt", "record", "root"};

inline const std::string raw_scaling = "raw";

// Applies the scaling "record" to the values of one sensor. All values become zero if their sum
// above the background is not positive.
void normalise(std::span<float> values);

struct Features {
  Layout layout() const {
    return {spd_count() > 0 ? spd_axis : Axis{}, radar_count() > 0 ? radar_axis : Axis{},
            array_axis, zones.size()};
  }
  Inputs inputs = Inputs::fused;
  std::string scaling = "record";
  Axis spd_axis, radar_axis;           // required axes of the records
  std::vector<float> centre;           // value subtracted from each input
  float spd_gain = 1, radar_gain = 1;  // factors that multiply the SPD and radar inputs
  Axis array_axis = {};                // its count is 0 if the inputs contain no spatial lags
  // Zones that have separate histograms as inputs; empty: the only histogram is the sum over all
  // zones. A model file stores their number and directions.
  Zones zones = {};

  std::size_t spd_count() const {
    return inputs == Inputs::radar ? 0 : spd_axis.count * histograms_of(zones);
  }
  std::size_t radar_count() const { return inputs == Inputs::spd ? 0 : radar_axis.count; }
  std::size_t array_count() const { return lag_columns(array_axis); }
  std::size_t count() const { return spd_count() + radar_count() + array_count(); }
  // Returns unscaled inputs [rows x count()], SPD first. Throws Error(failed) if the zones of
  // the data differ from those of the model.
  Matrix raw_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the inputs after the scaling of each record, before the centre and the gains are
  // applied.
  Matrix normalised_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the inputs of the model [rows x count()]: scaled per record, centred, and multiplied by
  // the gains.
  Matrix apply(const Dataset& data, const Rows& rows) const;
};

// Throws Error(failed) if the detector does not have these zones in this order. Compares their
// number and directions. An empty list allows any zones.
void require_zones(const Dataset& data, const Zones& expected);

// Computes the centre and the gains from `rows`, so that all sensors have the same total variance.
// If `rows` is empty or the scaling is "raw", the centre is 0 and the gains are 1.
Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling);

}  // namespace echofuse::recon
