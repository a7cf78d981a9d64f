// SPDX-License-Identifier: MIT
// Predictions for a run; the same steps for every record: conversion to the model's axes at true
// ranges, alignment, place, shape, map, uncertainty, comparison with the training data.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

// Records ready for a model.
struct Records {
  Dataset data;          // on the model's axes
  std::string antennas;  // note about a run without the model's antennas; may be empty
  std::string response;  // note about a run without a stated radar response; may be empty
  std::string ranges;    // assumptions of the intervals without a calibration; may be empty
};

// Tests whether the records as a whole differ from the training data. For a run of the training it
// uses the held-out records; for another run it leaves out copies of training records.
DomainShift domain_shift_of(const TrainedModel& model, const Dataset& data);

// Prepares recorded runs (load_recorded, load_part) or modified records for TrainedModel::for_run.
// `range_offset_m`: radar range bias in addition to the calibration; both are subtracted in one
// interpolation. Throws Error(failed) if the axes do not match the model's.
Records prepare_records(const TrainedModel& model, Dataset recorded, double range_offset_m = 0);

// Throws Error(failed) if maps are not finite, because a file may contain any weights.
void require_finite(const Matrix& maps);

// Each level includes the previous ones.
enum class PredictionDetail : std::uint8_t { maps, uncertainty, pixels };

struct Prediction {
  Matrix maps;  // metres
  std::vector<PredictionUncertainty>
      uncertainties;  // empty if no estimator in use states an uncertainty
  // Metres; no rows unless detail is `pixels`. `deviation` is NaN if the estimator states no
  // uncertainty.
  Matrix mean, deviation;
};

// Predicts from data on the model's axes. Fallback estimators handle records without all sensors of
// the first one. Throws Error(usage) for detail `pixels` if the model has no uncertainty.
Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   PredictionDetail detail = PredictionDetail::uncertainty);

struct RecordStatus {
  std::int64_t index = 0;
  std::string fault;  // empty: the record has a map
  std::string note;   // missing sensors
  std::string doubt;  // verdict of an input sensor, e.g. "SPD weak"
  // Delays of a map while following, s: since the end of its slot, and since its reading.
  std::optional<double> after_slot_s = {}, after_reading_s = {};
  // Set if the map shows a body.
  std::optional<BodyPlace> body = {};
  // Set if the record has a map and the estimator states an uncertainty.
  std::optional<PredictionUncertainty> uncertainty = {};
};

// Prediction of one record. Without a map, the status has a fault.
struct MappedRecord {
  RecordStatus status;
  std::vector<float> map_m, deviation_m;  // deviation_m: empty unless detail is `pixels`
};

// The most that the model can state.
PredictionDetail fullest_detail(const TrainedModel& model);

// Predicts the maps of these rows.
std::vector<MappedRecord> map_records(const TrainedModel& model, const Records& records,
                                      std::span<const std::size_t> rows, PredictionDetail detail);
// Predicts the map of a recorded data set of one record. Throws like prepare_records().
MappedRecord map_record(const TrainedModel& model, Dataset recorded, PredictionDetail detail);
// Reads this record of the run and predicts its map.
MappedRecord map_record(const TrainedModel& model, const record::RunReader& run, std::int64_t index,
                        PredictionDetail detail);

// Throws Error(usage) if the model has no uncertainty, which deviations need.
void require_uncertainty(const TrainedModel& model);

}  // namespace echofuse::recon
