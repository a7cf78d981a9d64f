// SPDX-License-Identifier: MIT
// A model's scores on records it has not seen, with the baselines' beside, and the cost.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "recon/estimator/predict.hpp"
#include "recon/maps/letters.hpp"
#include "recon/maps/metrics.hpp"

namespace echofuse::recon {

// A table's row: some way to make maps, and how good they are.
struct ScoredRow {
  std::string name;
  Summaries metrics;
};

struct RunningCost {
  Cost cost;
  double infer_us_median = 0, infer_us_p99 = 0;  // scaling and prediction of one map, one thread
  double train_s = 0;
  std::size_t model_bytes = 0;
};

// How well the stated uncertainty holds on records with a truth.
struct UncertaintyCalibration {
  double within_90 = 0;                 // share of the records within their lateral_interval_90_m
  double lateral_interval_90_m = 0;     // mean
  double flagged = 0;                   // share of the records that are out of distribution
  double error_m = 0, deviation_m = 0;  // of pixels, root mean square: of the mean map, as stated
};

// What became of the records whose label says two people (maps/people.hpp).
struct TwoPeopleSeen {
  std::size_t records = 0, flagged = 0;
};

struct Evaluation {
  std::string model;
  Inputs inputs{};
  std::size_t records = 0;
  // Of each record that was judged: its row, its scores, and what the model stated (if it does).
  Rows rows;
  std::vector<MapScores> scores;
  std::vector<PredictionUncertainty> uncertainties;
  std::map<std::string, std::size_t> fallbacks;  // records of each TrainedModel::note_of
  std::size_t left_out = 0;  // of a fresh run: had depth, but no map can be made of them
  std::string antennas;      // what there is to say of them (Records)
  DomainShift domain_shift;  // of all records of the run
  Summaries metrics;
  std::vector<ScoredRow> baselines;  // empty room, mean map, nearest neighbour
  RunningCost cost;
  TwoPeopleSeen two_people;  // of a model that states how sure it is
  // None: the model states no uncertainty; NaN: of no record.
  std::optional<UncertaintyCalibration> calibration;
};

// The rows to judge a model by: the held-out ones of a run it was trained on, else all with depth
// that the model has a map of.
// Throws Error(failed) if there are none.
Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all);

// Of each row whose label names a letter, where its true map shows it.
using Plates = std::vector<std::optional<Plate>>;
Plates find_plates(const Dataset& data, const Rows& rows, const Scene& scene);

// Scores of one map a row against the depth table's rows. Letters are read where there are plates,
// which takes as long as the other scores.
std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const Scene& scene, const Plates& plates = {});

// Without baselines and cost.
Evaluation evaluate(const TrainedModel& model, const Records& records, const Rows& rows);

// What needs no model: the empty room, the mean map, and of the neighbours' maps that of the
// nearest one by the sensors that both data sets have on the same axes, in a fixed scaling
// ("record"); left out if there are no neighbours.
std::vector<ScoredRow> score_baselines(const Dataset& data, const Rows& rows, const Scene& scene,
                                       const Dataset& neighbours_data, const Rows& neighbours);

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path);

nlohmann::json to_json(const Evaluation& evaluation);
// Rows of metrics as aligned text; lengths in metres.
std::string to_table(const std::vector<ScoredRow>& rows);
std::string to_text(const Evaluation& evaluation);
// What must be known to read the scores (antennas, fallbacks, records left out): a line
// each, or nothing.
std::string notes(const Evaluation& evaluation);
// One line.
std::string to_text(const std::optional<UncertaintyCalibration>& calibration);

}  // namespace echofuse::recon
