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
  Inputs inputs = Inputs::fused;
  std::string scaling = "record";
  // Required axes of the records. The count of the array axis is 0 if the inputs contain no spatial
  // lags.
  Layout axes;
  std::vector<float> centre;           // value subtracted from each input
  float spd_gain = 1, radar_gain = 1;  // factors that multiply the SPD and radar inputs

  Layout layout() const;  // returns the axes of the sensors in `inputs`
  std::size_t spd_count() const { return inputs == Inputs::radar ? 0 : axes.spd.size(); }
  std::size_t radar_count() const { return inputs == Inputs::spd ? 0 : axes.radar.size(); }
  std::size_t array_count() const { return axes.array.size(); }
  std::size_t count() const { return spd_count() + radar_count() + array_count(); }
  // Returns unscaled inputs [rows x count()], SPD first.
  Matrix raw_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the inputs after the scaling of each record, before the centre and the gains are
  // applied.
  Matrix normalised_inputs(const Dataset& data, const Rows& rows) const;
  // Returns the inputs of the model [rows x count()]: scaled per record, centred, and multiplied by
  // the gains.
  Matrix apply(const Dataset& data, const Rows& rows) const;
};

// Computes the centre and the gains from `rows`, so that all sensors have the same total variance.
// If `rows` is empty or the scaling is "raw", the centre is 0 and the gains are 1.
Features fit_features(const Dataset& data, const Rows& rows, Inputs inputs,
                      const std::string& scaling);

// Returns Layout::shows_sides() for these inputs.
bool shows_sides(const Dataset& data, Inputs inputs);

}  // namespace echofuse::recon
