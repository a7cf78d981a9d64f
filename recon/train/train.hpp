// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

struct TrainOptions {
  // Name of a candidate (models/model.hpp), or "auto", which selects the cheapest candidate within
  // one standard error of the best, by cross-validation on the training records.
  std::string model = "mlp", inputs = "fused", scaling = "record";
  // Candidates compared by "auto"; if empty, those of candidates().
  std::vector<std::string> candidates;
  SplitOptions split;
  FitOptions fit;
  // Optional parts of the model. `fallback`: also train estimators for records without antenna
  // samples or without radar data. `uncertainty`: learn the uncertainty of each estimator.
  bool fallback = false, uncertainty = true;
  // If true, training runs that do not include their radar response may have any response, like the
  // runs of a digital twin.
  bool any_response = false;
  // Records of the room without people, on the axes of the training data; they define the
  // background of the sensor data. No records: the background is learnt from the training records.
  Dataset background = {};
  // How to treat records with a doubtful verdict (see doubt_of): "leave" excludes them, and
  // "take" uses them.
  std::string doubtful = "leave";
  // How to treat records with lost samples: "take" uses them, and "leave" excludes them.
  std::string lossy = "take";
  // How to treat runs with a mirrored camera image (mirrored_camera): "refuse" or "take".
  std::string mirrored = "refuse";
};

// Records to use for training. `left_out` is a line that contains the number of excluded records
// for each reason (a sensor is missing, dead or doubtful; the record is damaged or duplicates an
// earlier record), and the number of lossy records that are used. It is empty if all records are
// used and none is lossy.
struct TrainingRows {
  Rows rows;
  std::string left_out;
  // Why each row is excluded; empty if the row is used (see left_out).
  std::vector<std::string> reasons;
};
// Returns the records to train with. Throws Error(failed) if a required sensor is missing from all
// records, or if all records are excluded. Also throws if the fraction of dead or damaged records
// exceeds `max_damaged`.
TrainingRows rows_to_train(const Dataset& data, Inputs inputs);

// Applies options.doubtful and options.lossy to the data.
void apply_doubts(Dataset& data, const TrainOptions& options);

// Returns the inputs that a model with these options uses. Only some models use the antennas.
Inputs inputs_to_train(const TrainOptions& options);

// Returns a warning if a random split would give optimistic scores; otherwise an empty string.
// Criterion: for many sampled records, the depth map of a neighbouring record is more similar than
// those of distant records.
std::string similar_neighbours(const Dataset& data, const Rows& rows);

// Returns a warning if scenes recur in training and test records that are not neighbours; otherwise
// an empty string. Criterion: for most held-out maps with a body, a few training maps are much more
// similar to the held-out map than all others.
std::string recurring_scenes(const Dataset& data, const Split& split, const SceneModel& scene);

// Splits the usable records, fits the model, and returns it with the list of its training records.
// Throws Error(failed) if there are too few records.
TrainedModel train(const Dataset& data, const TrainOptions& options);

}  // namespace echofuse::recon
