// SPDX-License-Identifier: MIT
// Predicts the depth maps of a run. Processes every record in the same steps: conversion to the
// model's axes with the range offsets subtracted, the steps of method.hpp, and the comparison with
// the training data.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_reader.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

// Records converted to the axes of a model.
struct Records {
  Dataset data;          // data on the model's axes
  std::string antennas;  // note if the run lacks antennas used by the model; otherwise empty
  std::string response;  // note if the run lacks its radar response; otherwise empty
  std::string ranges;    // note about errors not included in the 90 % intervals; may be empty
};

// Tests whether the records as a group differ from the training data. For a run used in training,
// uses only the held-out records. For another run, excludes copies of training records.
DomainShift domain_shift_of(const TrainedModel& model, const Dataset& data);

// Converts recorded runs (load_recorded, load_part) or modified records to the axes of
// TrainedModel::for_run. `range_offset_m`: radar range bias in addition to the calibration offset,
// m; both are subtracted in one interpolation. Throws Error(failed) if the axes of the data cannot
// be converted to those of the model.
Records prepare_records(const TrainedModel& model, Dataset recorded, double range_offset_m = 0);

// Throws Error(failed) if any value is not finite. This can happen because a model file may contain
// arbitrary weights.
void require_finite(const Matrix& maps);

// Amount of output: maps, errors per record, or errors per pixel. Each level includes the previous
// ones.
enum class PredictionDetail : std::uint8_t { maps, uncertainty, pixels };

struct Prediction {
  Matrix maps;  // predicted depth, m
  // Error estimates, one per row; empty if not requested or if the model is not calibrated.
  std::vector<PredictionUncertainty> uncertainties;
  // Mean and standard deviation of each pixel, m. Both have no rows unless `pixels` was requested.
  // The deviation is NaN if the estimator is not calibrated.
  Matrix mean, deviation;
};

// Predicts maps from data on the model's axes. On one machine, the map of a record is identical bit
// for bit alone, in a batch of any size, live, and with any number of threads (row_product.hpp). If
// a record lacks data from a sensor of the first estimator, a fallback estimator is used. Throws
// Error(usage) if `pixels` is requested but the model is not calibrated.
Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   PredictionDetail detail = PredictionDetail::uncertainty);

struct RecordStatus {
  std::int64_t index = 0;
  std::string fault;  // reason why the map is missing; otherwise empty
  std::string note;   // names of sensors missing from the record; may be empty
  std::string doubt;  // verdict on an input sensor that delivered doubtful data, e.g. "SPD weak"
  // Delay of the map in follow mode, s: from the end of the slot, and from the reading of the
  // record.
  std::optional<double> after_slot_s = {}, after_reading_s = {};
  // position of the body; empty if the map shows no body
  std::optional<BodyPlace> body = {};
  // estimated errors; empty if the map is missing or the estimator is not calibrated
  std::optional<PredictionUncertainty> uncertainty = {};
};

// Prediction for one record. If the map is missing, status.fault contains the reason.
struct MappedRecord {
  RecordStatus status;
  // Depth and standard deviation of each pixel, m. `deviation_m` is empty unless `pixels` was
  // requested.
  std::vector<float> map_m, deviation_m;
};

// Returns the highest level of detail supported by the model.
PredictionDetail fullest_detail(const TrainedModel& model);

std::vector<MappedRecord> map_records(const TrainedModel& model, const Records& records,
                                      std::span<const std::size_t> rows, PredictionDetail detail);
// Predicts the map of a recorded data set that contains one record. Throws the same errors as
// prepare_records().
MappedRecord map_record(const TrainedModel& model, Dataset recorded, PredictionDetail detail);
// Reads record `index` of the run and predicts its map.
MappedRecord map_record(const TrainedModel& model, const record::RunReader& run, std::int64_t index,
                        PredictionDetail detail);

// Throws Error(usage) if the model is not calibrated, because deviations need its error estimate.
void require_uncertainty(const TrainedModel& model);

}  // namespace echofuse::recon
