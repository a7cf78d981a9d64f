// SPDX-License-Identifier: MIT
// A record's one way from a run to what is said of it: on the model's axes with true ranges,
// aligned once; then place, shape and map, how far to trust them, and whether the record is like
// the training ones.
#pragma once
#include <string>
#include <vector>

#include "recon/estimator/trained_model.hpp"
#include "recon/uncertainty/gains.hpp"

namespace echofuse::recon {

// Records as the model takes them.
struct Records {
  Dataset data;              // on the model's axes
  Matrix aligned;            // of every record (TrainedModel::align)
  RangeBias range_bias;      // what the records show of one; no records if nobody asked
  double range_bias_m = 0;   // taken off the radar's ranges
  std::string text;          // what there is to say of it, or nothing
  std::string antennas;      // the same of a run that does not have the model's antennas
  GainCheck gains;           // of a model of stable gains; not stable: brightness is forgotten
  std::string speckle = {};  // of a run whose radar's power varies otherwise than in training
};

// Whether the records as a whole are unlike the model's training records.
DomainShift domain_shift_of(const TrainedModel& model, const Records& records);

// Of runs as they were recorded (load_recorded, load_part), or of changed records, for the model
// that is asked about the run (TrainedModel::for_run). What the radar's calibration and a range
// bias ask for is one interpolation. Throws Error(failed) if the axes are not the model's.
Records prepare_records(const TrainedModel& model, Dataset recorded, RangeBiasAction action);
// Of gains that cannot be checked: the maps are made without what they tell.
void forget_brightness(const Alignment& alignment, Matrix& aligned);

// Throws Error(failed) if maps are not finite: a file may hold any weights.
void require_finite(const Matrix& maps);

// own: the map as the model makes it; mean: the mean over what may be there, which has the least
// squared error.
inline const std::vector<std::string> output_names = {"own", "mean"};

// Each includes those before it.
enum class PredictionDetail : std::uint8_t { maps, uncertainty, pixels };

struct Prediction {
  Matrix maps;                                       // metres
  std::vector<PredictionUncertainty> uncertainties;  // empty if the model states none
  Matrix mean, deviation;                            // metres; no rows unless pixels are asked for
  const Matrix& of(const std::string& output) const { return output == "mean" ? mean : maps; }
};

// Where the model falls back, its fallbacks predict. Throws Error(usage) if the model has no
// uncertainty and pixels are asked for.
Prediction predict(const TrainedModel& model, const Records& records, const Rows& rows,
                   PredictionDetail detail);
Prediction predict(
    const TrainedModel& model, const Dataset& data, const Rows& rows,
    PredictionDetail detail = PredictionDetail::uncertainty);  // of data on the model's axes

// Throws Error(usage) if the model states no uncertainty: mean maps and deviations need that.
void require_uncertainty(const TrainedModel& model);

}  // namespace echofuse::recon
