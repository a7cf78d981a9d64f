// SPDX-License-Identifier: MIT
// Every record takes one way from a run to its prediction. It comes onto the model's axes with true
// ranges, and is aligned once. Then follow place, shape and map, how far to trust them, and whether
// the record is like the training ones.
#pragma once
#include <string>
#include <vector>

#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

// These are records as the model takes them.
struct Records {
  Dataset data;          // on the model's axes
  Matrix views;          // views of every record, by TrainedModel::for_run
  std::string antennas;  // a note about a run without the model's antennas, or empty
  std::string response;  // a note about a run that does not state its radar's response, or empty
};

// It says whether the records as a whole are unlike the model's training records.
DomainShift domain_shift_of(const TrainedModel& model, const Records& records);

// It takes runs as they were recorded (load_recorded, load_part), or changed records, and prepares
// them for the model that answers for the run (TrainedModel::for_run). The radar's ranges become
// shorter by the offset beside what their calibration says, in one interpolation. Throws
// Error(failed) if the axes are not the model's.
Records prepare_records(const TrainedModel& model, Dataset recorded, double range_offset_m = 0);

// Throws Error(failed) if maps are not finite: a file may hold any weights.
void require_finite(const Matrix& maps);

// Each level includes those before it.
enum class PredictionDetail : std::uint8_t { maps, uncertainty, pixels };

struct Prediction {
  Matrix maps;  // metres
  std::vector<PredictionUncertainty>
      uncertainties;  // empty if no estimator that answers states any
  // Metres; no rows unless pixels are asked for. The deviation is NaN of an estimator that states
  // none.
  Matrix mean, deviation;
};

// Where the model falls back, its fallbacks predict. Throws Error(usage) if the model has no
// uncertainty and pixels are asked for.
Prediction predict(const TrainedModel& model, const Records& records, const Rows& rows,
                   PredictionDetail detail);
Prediction predict(
    const TrainedModel& model, const Dataset& data, const Rows& rows,
    PredictionDetail detail = PredictionDetail::uncertainty);  // the data are on the model's axes

// Throws Error(usage) if the model states no uncertainty: deviations need that.
void require_uncertainty(const TrainedModel& model);

}  // namespace echofuse::recon
