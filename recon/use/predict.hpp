// SPDX-License-Identifier: MIT
// Way from a run to its predictions, the same for every record. Steps: the model's axes with true
// ranges, alignment, place, shape, map, trust, likeness to the training records.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

// Records as the model takes them.
struct Records {
  Dataset data;          // on the model's axes
  std::string antennas;  // a note about a run without the model's antennas, or empty
  std::string response;  // a note about a run that does not state its radar's response, or empty
  std::string ranges;    // assumptions of the intervals without a calibration, or empty
};

// Tells whether the records as a whole are unlike the model's training records. Of a run that the
// model was trained on it takes the records that training held out; of another run it leaves out
// copies of training records.
DomainShift domain_shift_of(const TrainedModel& model, const Dataset& data);

// Prepares recorded runs (load_recorded, load_part) or changed records for TrainedModel::for_run.
// `range_offset_m`: how much too long the radar's ranges are beyond their calibration; both are
// subtracted in one interpolation. Throws Error(failed) if the axes are not the model's.
Records prepare_records(const TrainedModel& model, Dataset recorded, double range_offset_m = 0);

// Throws Error(failed) if maps are not finite: a file may hold any weights.
void require_finite(const Matrix& maps);

// Each level includes those before it.
enum class PredictionDetail : std::uint8_t { maps, uncertainty, pixels };

struct Prediction {
  Matrix maps;  // metres
  std::vector<PredictionUncertainty>
      uncertainties;  // empty if no estimator that answers states any
  // Metres; no rows unless pixels are asked for. `deviation` is NaN where the estimator states
  // none.
  Matrix mean, deviation;
};

// Predicts from data on the model's axes. Fallbacks answer for records that lack sensors of the
// first estimator. Throws Error(usage) if the model has no uncertainty and pixels are asked for.
Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   PredictionDetail detail = PredictionDetail::uncertainty);

struct RecordStatus {
  std::int64_t index = 0;
  std::string fault;  // empty: it has a map
  std::string note;   // sensors that the model had to do without
  std::string doubt;  // quality flag of a sensor that the map is made of, as "SPD weak"
  // Delays of a map while following, s: from the end of its slot, and from its reading.
  std::optional<double> after_slot_s = {}, after_reading_s = {};
  // Set for a record with a body in its map.
  std::optional<BodyPlace> body = {};
  // Set for a record with a map, if the estimator states any.
  std::optional<PredictionUncertainty> uncertainty = {};
};

// One record's prediction. Without a map, the status has a fault.
struct MappedRecord {
  RecordStatus status;
  std::vector<float> map_m, deviation_m;  // deviation_m: empty unless pixels are asked for
};

// Predicts the maps of these rows.
std::vector<MappedRecord> map_records(const TrainedModel& model, const Records& records,
                                      std::span<const std::size_t> rows, PredictionDetail detail);
// Predicts the map of a data set of one record, as recorded. Throws as prepare_records().
MappedRecord map_record(const TrainedModel& model, Dataset recorded, PredictionDetail detail);
// Reads this record of the run and predicts its map.
MappedRecord map_record(const TrainedModel& model, const record::RunReader& run, std::int64_t index,
                        PredictionDetail detail);

// Throws Error(usage) if the model states no uncertainty: deviations need that.
void require_uncertainty(const TrainedModel& model);

}  // namespace echofuse::recon
