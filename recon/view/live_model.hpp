// SPDX-License-Identifier: MIT
// A model that is asked about single records of a run.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "recon/use/trained_model.hpp"

namespace echofuse::view {

struct Reconstruction {
  std::vector<float> map_m,
      deviation_m;  // on `grid`, metres; the deviation is empty if the model states none
  record::MapGrid grid;
  std::string fault;               // why there is none; or empty
  std::string note;                // sensors that the model lacked, or oddities of the record
  std::optional<double> x_m, z_m;  // metres, if the map shows a body
  std::optional<double> lateral_interval_90_m;
  std::optional<double> iou, lateral_error_m;  // against the depth camera
};

class LiveModel {
 public:
  explicit LiveModel(const std::string& path);  // throws as recon::load_model
  const std::string& name() const { return name_; }
  bool calibrated() const { return model_->uncertainty.has_value(); }
  // True if the training used this record of the run.
  bool saw(const std::string& run_uuid, std::int64_t index) const;
  // Never throws for what a record or a run is like: that is a fault.
  Reconstruction reconstruct(const record::RunReader& run, std::int64_t index) const;
  // Compares with the camera's map, if that is on the same grid.
  void compare(Reconstruction& made, std::span<const float> camera_map_m) const;
  // Why maps of these records are not to be trusted as a whole (recon::DomainShift); empty if
  // nothing speaks against it, or too few records tell.
  std::string doubt(const record::RunReader& run, std::int64_t first, std::int64_t count) const;

 private:
  recon::TrainedModel model_;
  std::string name_;
};

}  // namespace echofuse::view
