// SPDX-License-Identifier: MIT
// Evaluation of a model: scores on records it has not seen, those of the baselines, and the cost.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"
#include "recon/use/predict.hpp"

namespace echofuse::recon {

// Row of a table: a way to make maps, and its scores.
struct ScoredRow {
  std::string name;
  Summaries metrics;
};

struct RunningCost {
  Cost cost;
  double infer_us_median = 0, infer_us_p99 = 0;  // scaling and prediction of one map, one thread
  double infer_us_batch = 0;                     // per map, up to 1000 records at once
  double train_s = 0;
  std::size_t model_bytes = 0;
};

// Agreement of the stated uncertainty with the errors, on records with a truth.
struct UncertaintyCalibration {
  double within_90 = 0;                 // share of the records within their lateral_interval_90_m
  double lateral_interval_90_m = 0;     // mean
  double flagged = 0;                   // share of the records that are out of distribution
  double error_m = 0, deviation_m = 0;  // pixels' root mean square: of the mean map, as stated
};

// Counts of records labelled two_people_label, and of the flagged ones.
struct TwoPeopleSeen {
  std::size_t records = 0, flagged = 0;
};

// Foreground and background by which maps are scored. Both belong to the run, so that all rows of a
// table have one judge.
struct Judge {
  Scene scene;
  std::string note;  // origin of the scene, if not a training; or empty
};
// Learns the judge of other runs from all depth maps of these training runs (at least one).
Judge judge_of(const Dataset& training);
// Returns the model's scene if it was trained on this run or in this room. If more than half of the
// map's background differs, the run's own maps say what stands still.
Judge judge_of(const TrainedModel& model, const Dataset& data);

struct Evaluation {
  std::string model;
  Inputs inputs{};
  std::size_t records = 0;
  // Judged records: row, scores, and stated uncertainty of each (empty if the model states none).
  Rows rows;
  std::vector<MapScores> scores;
  std::vector<PredictionUncertainty> uncertainties;
  std::map<std::string, std::size_t> fallbacks;  // records for each TrainedModel::note_of
  // Records of a fresh run with depth, of which no map can be made: all, and by reason.
  std::size_t left_out = 0;
  std::map<std::string, std::size_t> faults = {};
  // Records of a fresh run that the model was trained on as those of another run, out of `of`. Left
  // out unless all are judged.
  std::size_t trained_on = 0, of = 0;
  std::size_t twice = 0;  // records left out because an earlier one of the run has their counts
  // Records left out because of a verdict (Dataset::doubt_of), by verdict; and all scores with them
  // included.
  std::map<std::string, std::size_t> doubtful;
  Summaries with_doubtful = {};
  Judge judge;
  std::string antennas;      // a note about them (Records)
  std::string response;      // a note about it (Records)
  std::string ranges;        // assumptions of its intervals (Records)
  std::string late_truth;    // line of late_truth(), or empty
  DomainShift domain_shift;  // tested: the run, or its held-out records
  std::string tested;        // begins the text of domain_shift: "RUN: "
  Summaries metrics;
  std::vector<ScoredRow> baselines;  // empty room, mean map, nearest neighbour
  RunningCost cost;
  TwoPeopleSeen two_people;  // counted if the model states its uncertainty
  // Empty if the model states no uncertainty. Values are NaN if no record has one.
  std::optional<UncertaintyCalibration> calibration;
};

// Returns why each row is left out of an evaluation of the model; empty if it is judged.
std::vector<std::string> left_out_of_evaluation(const TrainedModel& model, const Dataset& data,
                                                bool all);
// Returns the rows to judge a model by. A run it was trained on gives its held-out rows. Another
// run gives those with depth that the model has a map of and, unless `all`, was not trained on.
// Leaves doubtful ones out. Throws Error(failed) if there are none.
Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all);

// Scores one map a row against the depth table's rows.
std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const Scene& scene);

// Scores the rows, without baselines and cost. A `title` shows a progress line on stderr. Without
// `judge` the scores are by judge_of(model, run).
Evaluation evaluate(const TrainedModel& model, const Records& records, const Rows& rows,
                    const std::string& title = {}, const std::optional<Judge>& judge = {});

// Scores what needs no model: the empty room, the mean map, and the map of the nearest of the
// neighbours. Finds the nearest one by the sensors that both data sets have on the same axes, in
// the scaling "record". No copy of a judged record is a neighbour. Leaves it out if there are no
// neighbours. `title` as above.
std::vector<ScoredRow> score_baselines(const Dataset& data, const Rows& rows, const Scene& scene,
                                       const Dataset& neighbours_data, Rows neighbours,
                                       const std::string& title = {});

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path);

nlohmann::json to_json(const Evaluation& evaluation);
// Rows of maps and models judged together: {"records", "note", "rows": [{"model", "metrics"}, ...],
// "trivial"}. The first row's "model" and "metrics" stand beside them, as for a single model.
nlohmann::json to_json(const std::vector<ScoredRow>& rows, const std::vector<ScoredRow>& baselines,
                       std::size_t records, const std::string& note);
// Returns a line if nearly all bodies are on the other side than in the truth, otherwise nothing.
std::string mirrored_truth(const Summaries& metrics);
// Returns the metrics as aligned rows of text, lengths in metres.
std::string to_table(const std::vector<ScoredRow>& rows);
std::string to_text(const Evaluation& evaluation);
// Returns all sentences about the run and its scores but the figures: a line each, or empty.
std::string notes(const Evaluation& evaluation);
// Returns one line.
std::string to_text(const std::optional<UncertaintyCalibration>& calibration);

}  // namespace echofuse::recon
