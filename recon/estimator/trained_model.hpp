// SPDX-License-Identifier: MIT
// A model with everything that belongs to it: how its inputs are made, what the scene is, which
// records it has seen and how its training went. Kept as one HDF5 file.
//
//   /            attributes: format, format_version, model, inputs, scaling, version, data_crc32c,
//                train_s, uncertainty (calibrated, or not calibrated: then it states none),
//                foreground_depth_m, map_size, map_half_tangent, split, gap, seed, test_share,
//                validation_share, knows_empty_room (0 or 1)
//   axes/NAME    attributes of spd and radar as in drivers/core/axis.hpp; of array, if the model
//                needs the samples of the radar's antennas
//   features/    centre, with attributes spd_gain and radar_gain
//   scene/       background_m, mean_map_m
//   split/       runs (uuid), run, index, part (0 train, 1 validation, 2 test): one entry a record
//   training/    loss_m, validation_loss_m, hidden (widths), with attributes best_epoch, epochs,
//                batch, learning_rate, weight_decay, patience
//   alignment/   what is always there (body/alignment.hpp), if anything in the file needs it
//   context/     of a model of many laboratories, what is known of this one (run_context.hpp)
//   model/       what the model itself keeps
//   range_bias/  of a fused model: range_bias.hpp
//   domain/      what the training records are like: domain_shift.hpp
//   fallback/    of a fused model: another one of this format, for records that lack what this one
//                needs: of one that takes the radar's antennas one for its range profile, and of
//                that one, or any other fused model, one for the SPD alone
//   uncertainty/ what tells how far to trust it; files of older versions have none
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "recon/estimator/run_context.hpp"
#include "recon/maps/scene.hpp"
#include "recon/models/model.hpp"
#include "recon/uncertainty/domain_shift.hpp"
#include "recon/uncertainty/range_bias.hpp"
#include "recon/uncertainty/uncertainty.hpp"

namespace echofuse::recon {

enum class Part : std::uint8_t { train, validation, test };

struct SeenRecords {
  std::vector<std::string> runs;    // uuids
  std::vector<std::uint32_t> run;   // per record: index into runs
  std::vector<std::int64_t> index;  // per record: its number in the run
  std::vector<std::uint8_t> part;   // per record: Part
};

struct TrainedModel {
  std::string name;  // as make_model takes it
  Features features;
  Scene scene;
  Alignment alignment;  // not known if nothing here needs it
  RunContext context;   // of models of many laboratories
  std::unique_ptr<Model> model;
  std::optional<UncertaintyModel> uncertainty;  // none: no uncertainty is stated
  TrainingLog log;
  SplitOptions split;
  FitOptions fit;
  SeenRecords seen;
  RangeBiasReference range_bias;           // of a fused model
  DomainReference domain;                  // what its training records are like
  std::unique_ptr<TrainedModel> fallback;  // of a fused model; may be null
  // Trained with a run of nobody (state_empty_room); files of older versions do not say so.
  bool knows_empty_room = false;
  // Of a model that was taken to another room: what is added to its records' radar.
  std::optional<EmptyRoom> room_change;
  std::uint32_t data_hash = 0;
  double train_s = 0;

  // Who is asked about a run: this model, or its fallback for the range profile if the run does not
  // have this one's antennas.
  const TrainedModel& for_run(const Dataset& data) const;
  // Brings the data onto the axes of the model that is asked (match_axes); depth maps must be on
  // its grid. A run without any radar becomes one of lost radars if there is a fallback.
  void match(Dataset& data) const;
  // Whether the record lacks what the model needs (its radar is missing or dead, or the samples of
  // its antennas are), and a fallback answers for it.
  bool falls_back(const Dataset& data, std::size_t row) const;
  // What its status says then: what the map was made without; else nothing.
  std::string note_of(const Dataset& data, std::size_t row) const;
  // Why there is no map of the record; empty if there is one.
  std::string fault_of(const Dataset& data, std::size_t row) const;
  // Who answers for which of the rows: this model, and its fallbacks if they are needed.
  struct Assignment {
    const TrainedModel& by;
    Rows places, rows;  // indices into the given rows, and those rows
  };
  std::vector<Assignment> assign_rows(const Dataset& data, const Rows& rows) const;
  // The rows as seen from the body in each, where the model takes that or if it is wanted for what
  // is stated; else no columns.
  Matrix align(const Dataset& data, const Rows& rows, bool wanted) const;
  // What the model takes of the rows; row i of the aligned features belongs to rows[i].
  Matrix inputs(const Dataset& data, const Rows& rows, const Matrix& aligned) const;
  Cost cost() const;  // with the alignment
  // Maps of the given rows, metres, as the model makes them: within_span() for show. predict.hpp
  // tells more of them.
  Matrix predict(const Dataset& data, const Rows& rows) const;
  // True if the data set holds a run that the model was trained on.
  bool knows(const Dataset& data) const;
  // The rows of the data set that were this part of the model's training.
  Rows rows_of(const Dataset& data, Part part) const;

 private:
  const TrainedModel& answering(const Dataset& data, std::size_t row) const;
};

// Whether the model may say how far off its maps are: what its file and whoever shows maps say.
inline const char* calibration_name(bool calibrated) {
  return calibrated ? "calibrated" : "not calibrated";
}
inline const char* calibration_of(const TrainedModel& model) {
  return calibration_name(model.uncertainty.has_value());
}

SeenRecords seen_records(const Dataset& data, const Split& split);

// What all models of the same training rows and inputs share.
struct Preprocessing {
  Scene scene;
  Alignment alignment;   // not known unless wanted, nor without a detector
  Matrix aligned;        // of every record of the data set
  RunContext context;    // if these are of many laboratories,
  Matrix contexts;       // and of every record what it is trained with
  double elapsed_s = 0;  // which belongs to the time of each training
  Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, Scene scene, bool wanted,
                Gains gains = Gains::unknown);
};

// Fits scaling and model to the training rows; leaves `seen`, `range_bias` and `fallback` empty.
// Throws Error(usage) if the model needs both sensors.
TrainedModel fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                       const std::string& name, Inputs inputs, const std::string& scaling,
                       const FitOptions& options);

enum class Existing : bool { keep, replace };

// Throws Error(disk) if no file can be made there, and Error(usage) if there is one that is no
// model, or is not to be replaced: to be asked before a long training.
void check_can_save(const std::string& path, Existing existing);
// Writes a new file beside and renames it: an interrupted save leaves the old one. Throws
// Error(disk), and Error(failed) if there is one that is not to be replaced: then the new one is
// kept as PATH.part.
void save_model(const TrainedModel& model, const std::string& path,
                Existing existing = Existing::replace);
// Throws Error(failed) that names file, object, what is wrong and what would be right: not there,
// not a model, damaged, written by another version, or of parts that do not fit together.
TrainedModel load_model(const std::string& path);
TrainedModel load_model(const record::H5File& file);  // of one that is open

}  // namespace echofuse::recon
