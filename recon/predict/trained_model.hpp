// SPDX-License-Identifier: MIT
// Trained model: an ordered list of estimators, and the list of its training records. A record is
// processed by the first estimator for which it has all sensors. Order: both sensors with the
// radar's antennas, both with only its range profile, the SPD alone. File: safetensors
// (numbers/tensor_file.hpp). Names below N/ belong to estimator N:
//
//   facts    format "echofuse model", format_version, version, estimators, data_crc32c,
//            split/kind, split/gap, split/seed, split/test_share, split/validation_share,
//            split/run/R (uuid of run R), response/cell_m and any; N/model, N/inputs, N/scaling,
//            N/axes/SENSOR/..., N/scene/map_size and others, N/alignment/config/KEY, N/training/...
//   tensors  response/taps; per record split/run, split/index, split/part (0 train, 1 validation,
//            2 test), and split/hash of its sensor data (Dataset::content); N/scene/background_m
//            and mean_map_m; N/alignment/counts, power and lags: the background; N/model/...:
//            learnt values; N/domain/..., N/uncertainty/...
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "recon/predict/estimator.hpp"

namespace echofuse::recon {

enum class Subset : std::uint8_t { train, validation, test };

struct TrainingRecords {
  std::vector<std::string> runs;    // uuids
  std::vector<std::uint32_t> run;   // per record: index into runs
  std::vector<std::int64_t> index;  // per record: number in the run
  std::vector<std::uint8_t> part;   // per record: Subset
  std::vector<std::int64_t> hash;   // per record: Dataset::content
};

struct TrainedModel {
  std::vector<Estimator> estimators;  // at least one; each may state an uncertainty
  SplitOptions split;
  TrainingRecords training;
  std::uint32_t data_hash = 0;
  // Response of the training's profiles; unknown if not stated.
  record::RadarResponse radar_response;
  bool any_response = false;  // TrainOptions::any_response
  // Correction added to the radar's values, if the model was adapted to another room.
  std::optional<EmptyRoom> room_change;

  // model-> accesses the first estimator, which is used whenever possible.
  const Estimator& first() const { return estimators.front(); }
  Estimator& first() { return estimators.front(); }
  const Estimator* operator->() const { return &first(); }
  Estimator* operator->() { return &first(); }
  double train_s() const;  // sum over all estimators

  // Returns the first estimator with the antennas of the run.
  const Estimator& for_run(const Dataset& data) const;
  // Converts the data to the axes of for_run(); depth maps must be on its grid. A run without a
  // radar is treated as one with all radar frames lost, if an estimator works without radar.
  void match(Dataset& data) const;
  // Returns the estimator for a record on these axes, or null (see fault_of).
  const Estimator* estimator_for(const Dataset& data, std::size_t row) const;
  // Returns the record's status: the sensor that the map was made without, or empty.
  std::string note_of(const Dataset& data, std::size_t row) const;
  // Returns why the record has no map, or an empty text.
  std::string fault_of(const Dataset& data, std::size_t row) const;
  // Returns unclipped maps of the given rows, m; within_span() clips them for display. predict.hpp
  // returns more details.
  Matrix predict(const Dataset& data, const Rows& rows) const;
  // Returns true if the data set contains a run of the model's training.
  bool knows(const Dataset& data) const;
  // Returns the rows used for training or validation, even if their run has another uuid.
  Rows rows_trained_on(const Dataset& data) const;
  // Returns the rows of the data set in this part of the model's training.
  Rows rows_of(const Dataset& data, Subset part) const;
};

// Name for files and displays: whether the model states its errors.
inline const char* calibration_name(bool calibrated) {
  return calibrated ? "calibrated" : "not calibrated";
}
inline const char* calibration_of(const TrainedModel& model) {
  return calibration_name(model->uncertainty.has_value());
}
// Condition for a model to be calibrated.
constexpr const char* why_not_calibrated =
    "needs a model with sensor inputs and an uninterrupted training on at least 50 records";

TrainingRecords training_records(const Dataset& data, const Split& split);

// Throws Error(disk) if a file cannot be created there, and Error(usage) if it exists. Called
// before a long training.
void check_can_save(const std::string& path);
// Writes PATH.part, reads it back, calls `check` with the model read, and renames the file. Throws
// Error(disk); Error(failed) like load_model(); and Error(failed) if a file of this name exists, in
// which case both files are kept.
void save_model(const TrainedModel& model, const std::string& path,
                const std::function<void(const TrainedModel&)>& check = {});
// Throws Error(failed) with file, object, fault and expected value. Faults: no file, not a model,
// damaged, another version, or inconsistent parts.
TrainedModel load_model(const std::string& path);
TrainedModel load_model(const std::string& name, ByteView contents);

}  // namespace echofuse::recon
