// SPDX-License-Identifier: MIT
// Evaluates a model: scores on records not used in training, scores of the baselines, and cost.
#pragma once
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "recon/metrics/metrics.hpp"
#include "recon/predict/predict.hpp"

namespace echofuse::recon {

// One method in a table of scores, with its metrics.
struct ScoredRow {
  std::string name;
  Summaries metrics;
};

struct RunningCost {
  Cost cost;
  // Time per map on one thread, including input scaling, µs: median and 99th percentile.
  double infer_us_median = 0, infer_us_p99 = 0;
  double infer_us_batch = 0;  // time per map in a batch of up to 1000 records, µs
  double train_s = 0;
  std::size_t model_bytes = 0;
};

// Comparison of the estimated errors with the actual errors.
struct UncertaintyCalibration {
  // fraction of records with a lateral error within their 90 % interval
  double within_90 = 0;
  double lateral_interval_90_m = 0;  // mean half-width of the 90 % intervals, m
  double flagged = 0;                // fraction of records flagged as out of distribution
  // Root mean square over all pixels, m, of the actual error of the mean map and of its estimated
  // standard deviation.
  double error_m = 0, deviation_m = 0;
};

// Number of records with the label `two_people_label`, and number of these records that are flagged
// as out of distribution.
struct TwoPeopleCounts {
  std::size_t records = 0, flagged = 0;
};

// Definition of foreground and background for the scores. All methods in a table use the same
// definition.
struct ScoringScene {
  SceneModel scene;
  std::string note;  // source of foreground and background; empty: training data
};
// Learns the scene from all valid depth maps of the training runs. Throws Error(failed) if there
// are no such maps.
ScoringScene scoring_scene(const Dataset& training);
// Normally returns the scene of the model's training data. Returns a scene learnt from the run
// itself if the model was not trained on the run, the run has enough depth maps, and the two
// backgrounds differ in more than half of the pixels.
ScoringScene scoring_scene(const TrainedModel& model, const Dataset& data);

struct Evaluation {
  std::string model;
  Inputs inputs{};
  std::size_t records = 0;
  // The scored records: rows, scores and estimated errors (empty if the model is not calibrated).
  Rows rows;
  std::vector<MapScores> scores;
  std::vector<PredictionUncertainty> uncertainties;
  // Number of records predicted by a fallback model, for each message of TrainedModel::note_of.
  std::map<std::string, std::size_t> fallbacks;
  // For a run not used in training: number of records without a predicted map, in total and for
  // each reason.
  std::size_t left_out = 0;
  std::map<std::string, std::size_t> faults = {};
  // For a run not used in training: number of records that are copies of training records, and
  // number of all records (`of`). Copies are not scored unless requested.
  std::size_t trained_on = 0, of = 0;
  std::size_t twice = 0;  // number of records excluded as copies of earlier records in the run
  // Number of records excluded for each verdict (doubt_of), and the scores if these
  // records are included.
  std::map<std::string, std::size_t> doubtful;
  Summaries with_doubtful = {};
  ScoringScene scoring;
  std::string antennas;  // note about the antennas (Records::antennas)
  std::string response;  // note about the radar response (Records::response)
  std::string ranges;    // note about errors not included in the 90 % intervals (Records::ranges)
  std::string truth;     // warnings from faults_of_truth(); may be empty
  DomainShift domain_shift;  // result of testing the whole run or its held-out records
  std::string tested;        // prefix of the message from domain_shift: "RUN: "
  Summaries metrics;
  std::vector<ScoredRow> baselines;
  RunningCost cost;
  TwoPeopleCounts two_people;  // computed only if the model is calibrated
  // Empty if the model is not calibrated. Values are NaN if no record has an estimated error.
  std::optional<UncertaintyCalibration> calibration;
};

// Returns, for each row, the reason why it is excluded from the evaluation; empty for rows to be
// scored.
std::vector<std::string> left_out_of_evaluation(const TrainedModel& model, const Dataset& data,
                                                bool all);
// Returns the rows to be scored. If the model was trained on the run, these are the held-out rows.
// Otherwise they are all rows with a depth map and a predicted map; copies of training records are
// included only if `all` is true. Excludes doubtful records. Throws Error(failed) if no row is
// left.
Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all);

// Scores one predicted map per row against the ground-truth depth map.
std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const SceneModel& scene);

// Scores the model on these rows, without scoring baselines or measuring the cost. Shows a progress
// line on stderr if `title` is not empty. `scoring` defaults to scoring_scene(model, run).
Evaluation evaluate(const TrainedModel& model, const Records& records, const Rows& rows,
                    const std::string& title = {}, const std::optional<ScoringScene>& scoring = {});

// Scores the baselines, which do not need a model: the empty room, the mean map, and the map of the
// nearest neighbour. The search for the nearest neighbour uses the scaling "record" and the sensors
// with matching axes in both data sets. Copies of scored records are not used as neighbours. Omits
// the nearest-neighbour baseline if `neighbours` is empty. `title`: see evaluate().
std::vector<ScoredRow> score_baselines(const Dataset& data, const Rows& rows,
                                       const SceneModel& scene, const Dataset& neighbours_data,
                                       Rows neighbours, const std::string& title = {});

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path);

nlohmann::json to_json(const Evaluation& evaluation);
// Returns the JSON for maps and models that were scored together: {"records", "note", "rows":
// [{"model", "metrics"}, ...], "trivial"}. "model" and "metrics" of the first row are repeated at
// the top level, as in the JSON for a single model.
nlohmann::json to_json(const std::vector<ScoredRow>& rows, const std::vector<ScoredRow>& baselines,
                       std::size_t records, const std::string& note);
// Returns warnings about depth maps that contradict the sensor data, one per line; may be empty.
std::string faults_of_truth(const Dataset& data);
// Returns a warning if nearly all predicted bodies are on the wrong side, otherwise an empty
// string.
std::string mirrored_truth(const Summaries& metrics);
// Returns the metrics as a text table with one column per method. Lengths are in metres.
std::string to_table(const std::vector<ScoredRow>& rows);
std::string to_text(const Evaluation& evaluation);
// Returns notes about the run and the scores, one per line; may be empty.
std::string notes(const Evaluation& evaluation);
std::string to_text(const std::optional<UncertaintyCalibration>& calibration);

}  // namespace echofuse::recon
