// SPDX-License-Identifier: MIT
// Predicts the maps of single records of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_reader.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::view {

struct Reconstruction {
  // Depth and standard deviation of each pixel on `grid`, m. `deviation_m` is empty if it was not
  // requested or the model is not calibrated.
  std::vector<float> map_m, deviation_m;
  record::MapGrid grid;
  std::string fault;  // reason why the map is missing; otherwise empty
  // Names of the missing sensors, or the reason why the record is out of distribution.
  std::string note;
  std::optional<double> x_m, z_m;  // position of the body in m, if the map shows one
  std::optional<double> lateral_interval_90_m;
  std::optional<double> iou, lateral_error_m;  // scores of the map against the camera's depth map
};

// Result of comparing a group of records with the training data (recon::DomainShift).
struct GroupCheck {
  // How they differ; empty if they do not, or if there are too few records for the test.
  std::string doubt{};
  double interval_factor = 1;  // factor by which the 90 % intervals are widened
};

class LiveModel {
 public:
  explicit LiveModel(const std::string& path);  // throws the same errors as recon::load_model
  const std::string& name() const { return name_; }
  bool calibrated() const { return model_.first().uncertainty.has_value(); }
  // Returns true if this record was used in training or validation.
  bool saw(const std::string& run_uuid, std::int64_t index) const;
  // Predicts the map of a record. Sets `fault` instead of throwing if the record or the run cannot
  // be used. with_deviation: also computes the standard deviation of each pixel, which takes
  // additional time.
  Reconstruction reconstruct(const record::RunReader& run, std::int64_t index,
                             bool with_deviation) const;
  // Computes `iou` and `lateral_error_m` if both maps have the same number of pixels.
  void compare(Reconstruction& made, std::span<const float> camera_map_m) const;
  GroupCheck check(const record::RunReader& run, std::int64_t first, std::int64_t count) const;

 private:
  recon::TrainedModel model_;
  std::string name_;
};

}  // namespace echofuse::view
