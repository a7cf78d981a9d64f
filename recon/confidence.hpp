// SPDX-License-Identifier: MIT
// What a model says of its own answers: how far off a body may be, how sure each pixel is, and
// whether the record is one that it can know anything about. Learnt after the training from the
// validation records, as they are and made worse (fewer photons, more radar noise), with the
// trained model's own maps; the model itself may be any.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/novelty.hpp"
#include "recon/pixel_error.hpp"
#include "recon/split.hpp"

namespace echofuse::recon {

struct TrainedModel;

// The usual lateral error grows with noise, range of view and distance from the axis: a regression
// of its logarithm on those, times the factor that holds 90 % of the validation records (split
// conformal prediction; Lei et al., J. Am. Stat. Assoc. 113, 1094, 2018).
class LateralError {
 public:
  static constexpr double share_within = 0.9;

  // Row i of each belongs together; an error that is NaN is left out. `plain`: the first so many
  // rows are records as they were measured, which set the factor.
  void fit(const Matrix& signs, const std::vector<double>& error_m, std::size_t plain);
  double operator()(std::span<const float> signs) const;  // metres; NaN if nothing was learnt

  void save(record::H5File& file, const std::string& group) const;
  void load(const record::H5File& file, const std::string& group);

 private:
  std::vector<float> terms_of(std::span<const float> signs) const;

  std::vector<float> centre_, spread_, least_, most_;  // of the signs
  std::vector<double> weights_;
  double factor_ = 0;
};

// What is claimed of one reconstruction.
struct Claim {
  double lateral_90_m = 0;  // the body is within so much of where it is shown in 90 % of the
                            // records like the training ones; NaN: nothing is claimed
  Strangeness strangeness;
};

struct Confidence {
  static constexpr std::size_t least_validation = 30;

  Novelty novelty;
  LateralError lateral;
  PixelError pixels;

  void save(record::H5File& file) const;  // below "confidence/"
  void load(const record::H5File& file, const Features& of_model);
};

// Whether there are enough records to learn a Confidence from.
bool can_judge(const Split& split);
Confidence fit_confidence(const TrainedModel& model, const Dataset& data, const Split& split,
                          std::uint64_t seed);

// Of the model's maps of these rows; the model must have a confidence.
std::vector<Claim> claims(const TrainedModel& model, const Dataset& data, const Rows& rows,
                          const Matrix& maps);
PixelMaps pixel_maps(const TrainedModel& model, const Dataset& data, const Rows& rows,
                     const Matrix& maps, const std::vector<Claim>& claims);

// own: the map as the model makes it; hard: where a body is its depth, else the background; mean:
// the mean over what may be there, which has the least squared error.
inline const std::vector<std::string> output_names = {"own", "hard", "mean"};

struct Answer {
  Matrix maps;                // metres
  std::vector<Claim> claims;  // none without a confidence
  Matrix deviation;           // metres; no rows unless asked for
};
// Throws Error(usage) if the model has no confidence and one is needed, for the mean or deviations.
Answer answer(const TrainedModel& model, const Dataset& data, const Rows& rows,
              const std::string& output, bool with_deviation);

}  // namespace echofuse::recon
