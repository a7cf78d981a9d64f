// SPDX-License-Identifier: MIT
// What a training makes: an ordered list of estimators. Of each record the first one answers whose
// sensors the record has: of both sensors with the radar's antennas, of its range profile alone, of
// the SPD alone. With it, which records it has seen. Kept as one safetensors file
// (numbers/tensor_file.hpp); names below N/ are of estimator N:
//
//   facts    format "echofuse model", format_version, version, estimators, data_crc32c,
//            split/kind, split/gap, split/seed, split/test_share, split/validation_share,
//            split/run/R (uuid of run R); N/model, N/inputs, N/scaling, N/axes/SENSOR/...,
//            N/scene/map_size and others, N/alignment/config/KEY, N/training/...
//   tensors  split/run, split/index, split/part (0 train, 1 validation, 2 test): a record each
//            N/scene/background_m and mean_map_m; N/alignment/counts, power and lags, what is
//            always there; N/model/..., what the model learnt; N/domain/..., N/uncertainty/...
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "recon/estimator/estimator.hpp"

namespace echofuse::recon {

enum class Part : std::uint8_t { train, validation, test };

struct SeenRecords {
  std::vector<std::string> runs;    // uuids
  std::vector<std::uint32_t> run;   // per record: index into runs
  std::vector<std::int64_t> index;  // per record: its number in the run
  std::vector<std::uint8_t> part;   // per record: Part
};

struct TrainedModel {
  std::vector<Estimator> estimators;  // at least one
  SplitOptions split;
  SeenRecords seen;
  std::uint32_t data_hash = 0;
  // Of a model that was taken to another room: what is added to its records' radar.
  std::optional<EmptyRoom> room_change;

  // model->name: of the first estimator, which answers wherever it can.
  const Estimator& first() const { return estimators.front(); }
  Estimator& first() { return estimators.front(); }
  const Estimator* operator->() const { return &first(); }
  Estimator* operator->() { return &first(); }
  double train_s() const;  // of all estimators

  // The first estimator whose antennas the run has.
  const Estimator& for_run(const Dataset& data) const;
  // Brings the data onto the axes of for_run(); depth maps must be on its grid. A run without any
  // radar becomes one of lost radars if an estimator does without.
  void match(Dataset& data) const;
  // Who answers for a record on these axes; none: fault_of says why.
  const Estimator* answering(const Dataset& data, std::size_t row) const;
  // What its status says then: what the map was made without; else nothing.
  std::string note_of(const Dataset& data, std::size_t row) const;
  // Why there is no map of the record; empty if there is one.
  std::string fault_of(const Dataset& data, std::size_t row) const;
  // Maps of the given rows, metres, as the model makes them: within_span() for show. predict.hpp
  // tells more of them.
  Matrix predict(const Dataset& data, const Rows& rows) const;
  // True if the data set holds a run that the model was trained on.
  bool knows(const Dataset& data) const;
  // The rows of the data set that were this part of the model's training.
  Rows rows_of(const Dataset& data, Part part) const;
};

// Whether the model may say how far off its maps are: what its file and whoever shows maps say.
inline const char* calibration_name(bool calibrated) {
  return calibrated ? "calibrated" : "not calibrated";
}
inline const char* calibration_of(const TrainedModel& model) {
  return calibration_name(model->uncertainty.has_value());
}

SeenRecords seen_records(const Dataset& data, const Split& split);

// Throws Error(disk) if no file can be made there, and Error(usage) if there is one: to be asked
// before a long training.
void check_can_save(const std::string& path);
// Writes PATH.part and renames it. Throws Error(disk), and Error(failed) if there is a file of this
// name: it stays, and so does PATH.part.
void save_model(const TrainedModel& model, const std::string& path);
// Throws Error(failed) that names file, object, what is wrong and what would be right: not there,
// not a model, damaged, written by another version, or of parts that do not fit together.
TrainedModel load_model(const std::string& path);
TrainedModel load_model(const std::string& name, ByteView contents);

}  // namespace echofuse::recon
