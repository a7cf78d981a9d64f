// SPDX-License-Identifier: MIT
// Applies a model to single records of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::view {

struct Reconstruction {
  std::vector<float> map_m,
      deviation_m;  // on `grid`, m; no deviation if the model does not estimate it
  record::MapGrid grid;
  std::string fault;               // reason for a missing map; may be empty
  std::string note;                // missing sensors, or anomalies of the record
  std::optional<double> x_m, z_m;  // body position, if the map shows one
  std::optional<double> lateral_interval_90_m;
  std::optional<double> iou, lateral_error_m;  // against the depth camera
};

class LiveModel {
 public:
  explicit LiveModel(const std::string& path);  // throws as recon::load_model
  const std::string& name() const { return name_; }
  bool calibrated() const { return model_->uncertainty.has_value(); }
  // Returns true if this record was in the training data.
  bool saw(const std::string& run_uuid, std::int64_t index) const;
  // Does not throw if the record or the run is unusable; sets `fault` instead. Takes longer with
  // the deviations of the pixels.
  Reconstruction reconstruct(const record::RunReader& run, std::int64_t index,
                             bool with_deviation) const;
  // Compares with the camera's map if both have the same grid.
  void compare(Reconstruction& made, std::span<const float> camera_map_m) const;
  // Returns why the maps of these records are unreliable as a group (recon::DomainShift); empty if
  // the test passes or has too few records.
  std::string doubt(const record::RunReader& run, std::int64_t first, std::int64_t count) const;

 private:
  recon::TrainedModel model_;
  std::string name_;
};

}  // namespace echofuse::view
