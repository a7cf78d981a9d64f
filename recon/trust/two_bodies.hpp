// SPDX-License-Identifier: MIT
// This file tests whether a record shows two bodies. No training record does, but the sum of two of
// them is what two bodies measure when neither hides the other (training on made-up outliers:
// Hendrycks et al., ICLR 2019). A small network tells such sums from single records, by histogram,
// profile and view of the radar's antennas about the centroid of all that is there. The bodies of a
// sum stand apart sideways, as two bodies cannot stand in one place. With both sensors and a
// baseline all are turned about the SPD (method/turned.hpp), so that few records make many.
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"
#include "recon/models/network/classifier.hpp"

namespace echofuse::recon {

class TwoBodies {
 public:
  // It takes the features and the alignment of a model; without a detector the alignment is not
  // used.
  void use(const Features& of_model, const Alignment& alignment);
  bool known() const { return classifier_.known(); }
  // It learns from the given rows of the raw inputs. `places` holds where the body of every row is,
  // if that is known.
  void learn(const Matrix& raw_inputs, const Rows& rows,
             const std::vector<std::optional<Place>>& places, std::uint64_t seed);
  // Returns the logarithm of the odds of two bodies against one; it is very small where nobody is.
  // It takes a view without its correlation, or, without a detector, the radar's power.
  double operator()(std::span<const float> aligned, std::span<const float> power) const;

  void archive(Archive archive);

 private:
  std::vector<float> describe(std::span<const float> raw_inputs) const;
  std::span<const float> radar_of(std::span<const float> raw_inputs) const {
    return raw_inputs.subspan(spd_bins_, profile_);
  }

  // Raw inputs are counts | power | lags.
  std::size_t spd_bins_ = 0, profile_ = 0;
  Alignment alignment_;  // empty without a detector
  Classifier classifier_;
};

}  // namespace echofuse::recon
