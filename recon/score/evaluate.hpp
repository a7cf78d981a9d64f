// SPDX-License-Identifier: MIT
// Evaluation of a model: scores on records not used in training, scores of the baselines, and the
// cost.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"
#include "recon/predict/predict.hpp"

namespace echofuse::recon {

// Row of a table: a method and its scores.
struct ScoredRow {
  std::string name;
  Summaries metrics;
};

struct RunningCost {
  Cost cost;
  double infer_us_median = 0, infer_us_p99 = 0;  // scaling and prediction of one map on one thread
  double infer_us_batch = 0;                     // per map, up to 1000 records at once
  double train_s = 0;
  std::size_t model_bytes = 0;
};

// Comparison of the stated uncertainty with the actual errors.
struct UncertaintyCalibration {
  double within_90 = 0;                 // share of records with an error within
                                        // lateral_interval_90_m
  double lateral_interval_90_m = 0;     // mean over the records
  double flagged = 0;                   // share of records out of distribution
  double error_m = 0, deviation_m = 0;  // rms over pixels: error of the mean map; stated deviation
};

// Counts of records labelled two_people_label, and of the flagged ones.
struct TwoPeopleCounts {
  std::size_t records = 0, flagged = 0;
};

// Foreground and background for the scores. They belong to the run, so that all rows of a table are
// scored equally.
struct ScoringScene {
  SceneModel scene;
  std::string note;  // origin of the scene unless it is the training's
};
// Learns the scene from all depth maps of these training runs (at least one).
ScoringScene scoring_scene(const Dataset& training);
// Returns the model's scene if it was trained on this run or in this room. If more than half of the
// map's background differs, learns the scene from the run's own maps.
ScoringScene scoring_scene(const TrainedModel& model, const Dataset& data);

struct Evaluation {
  std::string model;
  Inputs inputs{};
  std::size_t records = 0;
  // Scored records: row, scores, and uncertainty (empty if the model states none).
  Rows rows;
  std::vector<MapScores> scores;
  std::vector<PredictionUncertainty> uncertainties;
  std::map<std::string, std::size_t> fallbacks;  // number of records per TrainedModel::note_of
  // Records of a new run with depth but without a map: total, and by reason.
  std::size_t left_out = 0;
  std::map<std::string, std::size_t> faults = {};
  // Records of a new run that were also training records under another run's name, out of `of`.
  // Left out unless all are scored.
  std::size_t trained_on = 0, of = 0;
  std::size_t twice = 0;  // records left out because an earlier one of the run has equal counts
  // Records left out by verdict (Dataset::doubt_of), and the scores including them.
  std::map<std::string, std::size_t> doubtful;
  Summaries with_doubtful = {};
  ScoringScene scoring;
  std::string antennas;      // note (Records)
  std::string response;      // note (Records)
  std::string ranges;        // assumptions of the intervals (Records)
  std::string late_truth;    // line of late_truth(); may be empty
  DomainShift domain_shift;  // test of the run, or of its held-out records
  std::string tested;        // prefix of the text of domain_shift: "RUN: "
  Summaries metrics;
  std::vector<ScoredRow> baselines;  // empty room, mean map, nearest neighbour
  RunningCost cost;
  TwoPeopleCounts two_people;  // only if the model states an uncertainty
  // Empty if the model states no uncertainty. Values are NaN if no record has one.
  std::optional<UncertaintyCalibration> calibration;
};

// Returns why each row is left out of the evaluation; empty if it is scored.
std::vector<std::string> left_out_of_evaluation(const TrainedModel& model, const Dataset& data,
                                                bool all);
// Returns the rows to score a model on. For a run of its training: the held-out rows. For another
// run: rows with depth and a map that, unless `all`, were not training records. Leaves out doubtful
// ones. Throws Error(failed) if none are left.
Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all);

// Scores one map per row against the depth table.
std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const SceneModel& scene);

// Scores the rows, without baselines and cost. A non-empty `title` shows a progress line on stderr.
// Default of `scoring`: scoring_scene(model, run).
Evaluation evaluate(const TrainedModel& model, const Records& records, const Rows& rows,
                    const std::string& title = {}, const std::optional<ScoringScene>& scoring = {});

// Scores the baselines without a model: empty room, mean map, and map of the nearest neighbour. The
// nearest neighbour is found in the scaling "record", by the sensors with equal axes in both data
// sets. Copies of scored records are not used as neighbours. Without neighbours their row is left
// out. `title` as above.
std::vector<ScoredRow> score_baselines(const Dataset& data, const Rows& rows,
                                       const SceneModel& scene, const Dataset& neighbours_data,
                                       Rows neighbours, const std::string& title = {});

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path);

nlohmann::json to_json(const Evaluation& evaluation);
// JSON of maps and models scored together: {"records", "note", "rows": [{"model", "metrics"}, ...],
// "trivial"}. The first row's "model" and "metrics" are repeated at the top level, as for a single
// model.
nlohmann::json to_json(const std::vector<ScoredRow>& rows, const std::vector<ScoredRow>& baselines,
                       std::size_t records, const std::string& note);
// Returns a warning if nearly all bodies are on the wrong side, otherwise nothing.
std::string mirrored_truth(const Summaries& metrics);
// Returns the metrics as aligned rows of text, lengths in metres.
std::string to_table(const std::vector<ScoredRow>& rows);
std::string to_text(const Evaluation& evaluation);
// Returns the notes about the run and its scores, one per line; may be empty.
std::string notes(const Evaluation& evaluation);
// Returns one line.
std::string to_text(const std::optional<UncertaintyCalibration>& calibration);

}  // namespace echofuse::recon
