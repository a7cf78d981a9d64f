// SPDX-License-Identifier: MIT
// Trained model: an ordered list of estimators, and the list of its training records. A record is
// processed by the first estimator for which it contains all sensor data. Order of the sensor sets:
// SPD and radar with antenna samples, SPD and range profile, SPD alone. File format: safetensors
// (numbers/tensor_file.hpp). Names that begin with N/ belong to estimator N:
//
//   facts    format "echofuse model", format_version, version, estimators, data_crc32c,
//            split/kind, split/gap, split/seed, split/test_share, split/validation_share,
//            split/run/R (uuid of run R), split/leave_doubtful and leave_lossy,
//            response/cell_m and any; N/model, N/inputs, N/scaling,
//            N/axes/SENSOR/..., N/scene/map_size and others, N/alignment/config/KEY, N/training/...
//   tensors  response/taps; per record split/run, split/index, split/part (0 train, 1 validation,
//            2 test), and split/hash of its sensor data (RecordInfo::content); N/scene/background_m
//            and mean_map_m; N/alignment/counts, power and lags: the background; N/model/...:
//            learnt values; N/domain/..., N/uncertainty/...
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "recon/data/response_conversion.hpp"
#include "recon/predict/estimator.hpp"

namespace echofuse::recon {

enum class Subset : std::uint8_t { train, validation, test };

struct TrainingRecords {
  std::vector<std::string> runs;   // UUIDs of the training runs
  std::vector<std::uint32_t> run;  // index of the record's run in `runs`
  std::vector<std::int64_t> index;
  std::vector<std::uint8_t> part;  // Subset that contains the record
  std::vector<std::int64_t> hash;  // hash of the record's data, RecordInfo::content
};

struct TrainedModel {
  std::vector<Estimator> estimators;  // at least one; fallback estimators follow the first one
  SplitOptions split;
  TrainingRecords training;
  std::uint32_t data_hash = 0;
  ModelResponse response;
  Exclusions exclusions;
  // Correction added to the radar values after adapt_to_room(): columns with one row, or none.
  std::vector<Column> room_change;

  // Returns the first estimator, which is used for all records with complete data.
  const Estimator& first() const { return estimators.front(); }
  Estimator& first() { return estimators.front(); }
  double train_s() const;  // returns the total training time of all estimators, s

  // Returns the first estimator that matches the radar antennas of the run.
  const Estimator& for_run(const Dataset& data) const;
  // Converts the data to the axes of for_run(). The depth maps must already be on the grid of the
  // model. If the run has no radar and a fallback estimator works without radar, all radar frames
  // are marked as lost.
  void match(Dataset& data) const;
  // Returns the first estimator that can use the record; null if no estimator can use it (see
  // fault_of()). The data must be on the model's axes.
  const Estimator* estimator_for(const Dataset& data, std::size_t row) const;
  // Returns which sensor data were missing for the map, e.g. "radar lost: SPD alone"; empty if the
  // data were complete.
  std::string note_of(const Dataset& data, std::size_t row) const;
  // Returns the reason why the record has no map; empty if it has a map.
  std::string fault_of(const Dataset& data, std::size_t row) const;
  // Returns the unclipped maps of the given rows, m. within_span() clips them for display. The
  // functions in predict.hpp return more details.
  Matrix predict(const Dataset& data, const Rows& rows) const;
  // Returns true if the model was trained on a run in this data set.
  bool was_trained_on(const Dataset& data) const;
  // Returns the rows used for training or validation. Recognises copies in other runs by their
  // hash.
  Rows rows_trained_on(const Dataset& data) const;
  // Returns the rows that belong to this subset of the training split.
  Rows rows_of(const Dataset& data, Subset part) const;
};

inline const char* calibration_name(bool calibrated) {
  return calibrated ? "calibrated" : "not calibrated";
}
inline const char* calibration_of(const TrainedModel& model) {
  return calibration_name(model.first().uncertainty.has_value());
}
// Explains which model and training a calibration requires.
constexpr const char* reason_not_calibrated =
    "calibration needs a model with sensor inputs and an uninterrupted training on at least 50 "
    "records";

TrainingRecords training_records(const Dataset& data, const Split& split);

// Throws Error(usage) if the file exists, and Error(disk) if it cannot be created. Called before
// training, so that such an error does not waste a long training run.
void check_can_save(const std::string& path);
// Writes PATH.part, loads it again, passes the loaded model to `check`, and renames the file to
// PATH. Throws Error(disk) if writing fails. Throws Error(failed) in the cases listed for
// load_model(), and if PATH exists; in the latter case, both files are kept.
void save_model(const TrainedModel& model, const std::string& path,
                const std::function<void(const TrainedModel&)>& check = {});
// Loads a model file. Throws Error(failed) with the file name, the object, the fault and the
// expected value if the file is missing, damaged, inconsistent, not a model, or has a different
// format version.
TrainedModel load_model(const std::string& path);
TrainedModel load_model(const std::string& name, ByteView contents);

}  // namespace echofuse::recon
