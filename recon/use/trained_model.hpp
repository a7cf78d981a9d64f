// SPDX-License-Identifier: MIT
// Trained model: an ordered list of estimators, and the records it has seen. The first estimator
// whose sensors a record has answers for it. Order: both sensors with the radar's antennas, both
// with its range profile alone, the SPD alone. File: safetensors (numbers/tensor_file.hpp). Names
// below N/ belong to estimator N:
//
//   facts    format "echofuse model", format_version, version, estimators, data_crc32c,
//            split/kind, split/gap, split/seed, split/test_share, split/validation_share,
//            split/run/R (uuid of run R), response/cell_m and any; N/model, N/inputs, N/scaling,
//            N/axes/SENSOR/..., N/scene/map_size and others, N/alignment/config/KEY, N/training/...
//   tensors  response/taps; of each record split/run, split/index, split/part (0 train, 1
//            validation, 2 test), and split/hash of what its sensors hold (Dataset::content)
//            N/scene/background_m and mean_map_m; N/alignment/counts, power and lags, what is
//            always there; N/model/..., what the model learnt; N/domain/..., N/uncertainty/...
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "recon/use/estimator.hpp"

namespace echofuse::recon {

enum class Part : std::uint8_t { train, validation, test };

struct SeenRecords {
  std::vector<std::string> runs;    // uuids
  std::vector<std::uint32_t> run;   // per record: index into runs
  std::vector<std::int64_t> index;  // per record: its number in the run
  std::vector<std::uint8_t> part;   // per record: Part
  std::vector<std::int64_t> hash;   // per record: Dataset::content
};

struct TrainedModel {
  std::vector<Estimator> estimators;  // at least one; each states its own uncertainty, or none
  SplitOptions split;
  SeenRecords seen;
  std::uint32_t data_hash = 0;
  // Response of the training's profiles; unknown if none was stated.
  record::RadarResponse radar_response;
  bool any_response = false;  // TrainOptions
  // Added to the radar of the records, if the model was taken to another room.
  std::optional<EmptyRoom> room_change;

  // model->name is that of the first estimator, which answers wherever it can.
  const Estimator& first() const { return estimators.front(); }
  Estimator& first() { return estimators.front(); }
  const Estimator* operator->() const { return &first(); }
  Estimator* operator->() { return &first(); }
  double train_s() const;  // sum over all estimators

  // Returns the first estimator whose antennas the run has.
  const Estimator& for_run(const Dataset& data) const;
  // Brings the data onto the axes of for_run(); depth maps must be on its grid. A run without a
  // radar counts as a run of lost radars if an estimator needs none.
  void match(Dataset& data) const;
  // Returns the estimator that answers for a record on these axes, or null (see fault_of).
  const Estimator* answering(const Dataset& data, std::size_t row) const;
  // Returns the record's status: which sensor the map was made without, or empty.
  std::string note_of(const Dataset& data, std::size_t row) const;
  // Returns why there is no map of the record, or empty if there is one.
  std::string fault_of(const Dataset& data, std::size_t row) const;
  // Returns maps of the given rows, in metres, as the model makes them; within_span() makes them
  // ready to show. predict.hpp gives more details of them.
  Matrix predict(const Dataset& data, const Rows& rows) const;
  // Returns true if the data set holds a run that the model was trained on.
  bool knows(const Dataset& data) const;
  // Returns the rows that trained or validated the model, whatever their run's uuid.
  Rows rows_trained_on(const Dataset& data) const;
  // Returns the rows of the data set that were in this part of the model's training.
  Rows rows_of(const Dataset& data, Part part) const;
};

// Name of whether the model may state its errors, for its file and every display of maps.
inline const char* calibration_name(bool calibrated) {
  return calibrated ? "calibrated" : "not calibrated";
}
inline const char* calibration_of(const TrainedModel& model) {
  return calibration_name(model->uncertainty.has_value());
}
// Conditions under which a model is calibrated.
constexpr const char* why_not_calibrated =
    "only a model of a sensor, trained to its end on 50 records or more, states its errors";

SeenRecords seen_records(const Dataset& data, const Split& split);

// Throws Error(disk) if no file can be made there, and Error(usage) if there is one. Called before
// a long training.
void check_can_save(const std::string& path);
// Writes PATH.part, reads it back, has `check` judge the model that was read, and renames the file.
// Throws Error(disk), Error(failed) as load_model, and Error(failed) if a file of this name exists:
// both files stay.
void save_model(const TrainedModel& model, const std::string& path,
                const std::function<void(const TrainedModel&)>& check = {});
// Throws Error(failed) that names the file, the object, what is wrong and what would be right.
// Faults: no file, no model, damaged, of another version, or its parts do not fit together.
TrainedModel load_model(const std::string& path);
TrainedModel load_model(const std::string& name, ByteView contents);

}  // namespace echofuse::recon
