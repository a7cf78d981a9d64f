// SPDX-License-Identifier: MIT
// Whether a record shows two bodies. No training record does; but the sum of two of them is what
// two bodies measure when neither hides the other (training on made-up outliers: Hendrycks et al.,
// ICLR 2019). A small network tells such sums from single records, by histogram, profile and view
// of the radar's antennas about the centroid of all that is there. The bodies of a sum stand apart
// sideways, as two bodies cannot stand in one place. With both sensors and a baseline all are
// turned about the SPD (models/body/turned.hpp), so that few records make many. Where gains are
// stable the clicks tell, too: two bodies at one range send back twice as many. A third of the
// examples does without, for runs of other gains.
#pragma once
#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/models/body/body_frame.hpp"
#include "recon/models/classifier.hpp"

namespace echofuse::recon {

class TwoBodies {
 public:
  // What a model of these features is given; the alignment is not looked at without a detector.
  void use(const Features& of_model, const Alignment& alignment);
  bool known() const { return classifier_.known(); }
  // From the given rows of the raw inputs. places: where the body of every row is, if it is known.
  void learn(const Matrix& raw_inputs, const Rows& rows,
             const std::vector<std::optional<Place>>& places, std::uint64_t seed);
  // Logarithm of the odds of two bodies against one; very small where nobody is. known_gains: those
  // of the training, if these were stable.
  double operator()(std::span<const float> raw_inputs, bool known_gains) const;

  void save(record::H5File& file, const std::string& group) const;
  void load(const record::H5File& file, const std::string& group);

 private:
  // How many clicks there are for a body at the range of the description, and 1; zeros if unknown.
  using Light = std::array<float, 2>;
  std::vector<float> describe(std::span<const float> raw_inputs) const;
  Light light_of(std::span<const float> raw_inputs, std::span<const float> described) const;
  std::span<const float> radar_of(std::span<const float> raw_inputs) const {
    return raw_inputs.subspan(spd_bins_, profile_);
  }

  std::size_t spd_bins_ = 0, profile_ = 0;
  Alignment alignment_;     // not known without a detector
  bool by_light_ = false;   // gains are stable
  double light_level_ = 0;  // usual logarithm of clicks r^2, r in metres
  Classifier classifier_;
};

}  // namespace echofuse::recon
