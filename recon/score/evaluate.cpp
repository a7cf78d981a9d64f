// SPDX-License-Identifier: MIT
#include "recon/score/evaluate.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <optional>
#include <span>

#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "recon/data/copies.hpp"
#include "recon/numbers/parallel.hpp"

namespace echofuse::recon {
namespace {

// Minimum number of records needed to learn the scene from a run.
constexpr std::size_t min_room_records = 20;

// Returns the sensors that have matching axes in both data sets; empty if no sensor has matching
// axes.
std::optional<Inputs> common_inputs(const Dataset& data, const Dataset& other) {
  const auto common = [](const Column& column, const Column& of_other) {
    return of_other.axis.count > 0 && is_near(column.axis, of_other.axis);
  };
  const bool spd = common(data.spd(), other.spd()), radar = common(data.radar(), other.radar());
  if (spd && radar) return Inputs::fused;
  if (!spd && !radar) return std::nullopt;
  return spd ? Inputs::spd : Inputs::radar;
}

Matrix nearest_maps(const Dataset& data, const Rows& rows, const Dataset& neighbours_data,
                    const Rows& neighbours, Inputs inputs) {
  const Features features = fit_features(neighbours_data, neighbours, inputs, "record");
  const Matrix known = features.apply(neighbours_data, neighbours);
  const Matrix maps = take_rows(neighbours_data.depth(), neighbours);
  const auto model = kind_of("nearest").make();
  model->fit({known, maps, all_rows(neighbours.size())}, {known, maps, {}}, {});
  Dataset scored = part_of(data, rows);
  match_axes(scored, features.axes, inputs);
  return model->predict(features.apply(scored, all_rows(rows.size())));
}

Rows with_depth(const Dataset& data) {
  Rows rows = all_rows(data.size());
  std::erase_if(rows, [&](std::size_t row) { return !data.has(row, Sensor::depth); });
  return rows;
}

// Returns the rows with a depth map that is not excluded by the camera verdict.
Rows with_sound_depth(const Dataset& data) {
  Rows rows = all_rows(data.size());
  std::erase_if(rows, [&](std::size_t row) { return !sound_depth(data, row); });
  return rows;
}

Rows with_map_and_depth(const TrainedModel& model, const Dataset& data) {
  Rows rows = with_depth(data);
  std::erase_if(rows, [&](std::size_t row) { return !model.fault_of(data, row).empty(); });
  return rows;
}

std::string doubt_of(const TrainedModel& model, const Dataset& data, std::size_t row) {
  const Estimator* by = model.estimator_for(data, row);
  return by ? doubt_of(data, row, by->features.inputs) : "";
}

// Returns the rows that are not in `unwanted`. Both lists must be sorted.
Rows without(const Rows& rows, const Rows& unwanted) {
  Rows out;
  std::ranges::set_difference(rows, unwanted, std::back_inserter(out));
  return out;
}

struct StatedUncertainty {
  double within = 0, stated = 0, known = 0, flagged = 0, squares = 0, variance = 0, pixels = 0,
         records = 0;

  void add(const Prediction& own, const Dataset& data, const Rows& rows, const SceneModel& scene) {
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const auto truth = data.depth().row(rows[i]);
      if (!own.uncertainties[i].stated) continue;
      flagged += !own.uncertainties[i].out_of_distribution.reason.empty(), ++records;
      for (std::size_t p = 0; p < truth.size(); ++p, ++pixels) {
        squares += std::pow(double{own.mean.row(i)[p]} - double{truth[p]}, 2);
        variance += std::pow(double{own.deviation.row(i)[p]}, 2);
      }
      const double error = lateral_error(own.maps.row(i), truth, scene);
      const double interval_m = own.uncertainties[i].lateral_interval_90_m;
      if (std::isnan(error) || std::isnan(interval_m)) continue;
      within += error <= interval_m, stated += interval_m, ++known;
    }
  }
  UncertaintyCalibration mean() const {
    return {within / known, stated / known, flagged / records, std::sqrt(squares / pixels),
            std::sqrt(variance / pixels)};
  }
};

// Computes metrics and calibration in batches of records, to limit memory use.
void score_predictions(const TrainedModel& model, const Records& records, const Rows& rows,
                       const std::string& title, Evaluation& out) {
  const SceneModel& scoring = out.scoring.scene;
  Progress progress(title, rows.size(), title.empty());
  constexpr std::size_t batch_records = 512;
  std::vector<MapScores>& scores = out.scores;
  StatedUncertainty uncertainty;
  for (std::size_t first = 0; first < rows.size(); first += batch_records) {
    const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(first);
    const Rows part(begin, begin + std::min<std::ptrdiff_t>(batch_records, rows.end() - begin));
    Prediction one = predict(model, records.data, part, fullest_detail(model));
    for (PredictionUncertainty& u : one.uncertainties)
      u.lateral_interval_90_m *= out.domain_shift.interval_factor;
    if (!one.uncertainties.empty() && model.first().uncertainty)
      uncertainty.add(one, records.data, part, scoring);
    if (one.uncertainties.empty() && model.first().uncertainty)
      one.uncertainties.resize(part.size());
    out.uncertainties.insert(out.uncertainties.end(), one.uncertainties.begin(),
                             one.uncertainties.end());
    const auto some = score_maps(one.maps, records.data, part, scoring);
    scores.insert(scores.end(), some.begin(), some.end());
    progress.update(scores.size());
  }
  out.metrics = summarise(scores);
  if (model.first().uncertainty) out.calibration = uncertainty.mean();
}

}  // namespace

std::vector<std::string> left_out_of_evaluation(const TrainedModel& model, const Dataset& data,
                                                bool all) {
  const bool held_out = !all && model.was_trained_on(data);
  std::vector<std::string> out(data.size());
  const auto fault = [&](std::size_t row) {
    return data.has(row, Sensor::depth) ? model.fault_of(data, row) : "camera missing";
  };
  for (std::size_t row = 0; row < data.size(); ++row)
    out[row] = held_out ? "not in any part of the training split" : fault(row);
  if (held_out)
    for (const Subset part : {Subset::train, Subset::validation, Subset::test})
      for (const std::size_t row : model.rows_of(data, part))
        out[row] = part == Subset::test ? fault(row) : trained_on_record;
  else if (!all)
    for (const std::size_t row : model.rows_trained_on(data))
      if (out[row].empty()) out[row] = trained_on_record;
  Copies copies;
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (out[row].empty()) out[row] = doubt_of(model, data, row);
    if (!out[row].empty()) continue;
    if (copies.first(data.records[row].content, row) != row) out[row] = duplicate_in_run;
  }
  return out;
}

Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all) {
  const std::vector<std::string> left_out = left_out_of_evaluation(model, data, all);
  Rows sound;
  bool trained_on = false, doubtful = false;
  for (std::size_t row = 0; row < data.size(); ++row) {
    trained_on |= left_out[row] == trained_on_record;
    if (left_out[row].empty()) sound.push_back(row);
    doubtful |= left_out[row] == doubt_of(model, data, row);
  }
  if (!sound.empty()) return sound;
  const std::string path = data.path();
  if (doubtful) {
    std::map<std::string, std::size_t> reasons;
    for (const std::string& why : left_out) ++reasons[why];
    throw Error(ExitCode::failed, path + ": " + left_out_text(reasons, data.size()));
  }
  const char* const use_all = "; use --all to score the training records";
  throw Error(
      ExitCode::failed,
      path +
          (!all && model.was_trained_on(data)
               ? ": the model was trained on this run, and no valid held-out record is left" +
                     std::string(use_all)
           : trained_on
               ? ": all records of this run are copies of training records" + std::string(use_all)
               : ": no record contains a depth map and valid data of the sensors of a \"" +
                     name_of(model.first().features.inputs) + "\" model"));
}

ScoringScene scoring_scene(const Dataset& training) {
  const Rows seen = with_sound_depth(training);
  if (seen.empty())
    throw Error(ExitCode::failed,
                training.sources.front().path + ": no record has a valid depth map");
  return {learn_scene(training.depth(), seen, training.map), {}};
}

ScoringScene scoring_scene(const TrainedModel& model, const Dataset& data) {
  const Rows seen = with_sound_depth(data);
  if (model.was_trained_on(data) || seen.size() < min_room_records)
    return {model.first().scene, {}};
  SceneModel own = learn_scene(data.depth(), seen, data.map);
  std::size_t moved = 0;
  for (std::size_t p = 0; p < own.background.size(); ++p)
    moved += std::abs(own.background[p] - model.first().scene.background[p]) > 0.1f;
  if (2 * moved < own.background.size()) return {model.first().scene, {}};
  return {std::move(own),
          "the room differs from the training room: foreground and background are learnt from the "
          "depth maps of this run; use --train RUN to learn them from other runs"};
}

std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const SceneModel& scene) {
  std::vector<MapScores> out(rows.size());
  for_each_part(rows.size(), [&](std::size_t i) {
    out[i] = score(maps.row(i), data.depth().row(rows[i]), scene);
  });
  return out;
}

namespace {

// Scores the doubtful records together with the other records. The main scores exclude the doubtful
// records.
void add_doubtful(const TrainedModel& model, const Records& records, Evaluation& out) {
  const Dataset& data = records.data;
  Rows rest = without(with_map_and_depth(model, data), model.rows_trained_on(data)), doubtful;
  Rows scored = out.rows;
  std::sort(scored.begin(), scored.end());
  for (const std::size_t row : without(rest, scored))
    if (const std::string doubt = doubt_of(model, data, row); !doubt.empty())
      doubtful.push_back(row), ++out.doubtful[doubt];
  if (doubtful.empty()) return;
  const Matrix maps = predict(model, data, doubtful, PredictionDetail::maps).maps;
  const SceneModel& scene = out.scoring.scene;
  std::vector<MapScores> all = score_maps(maps, data, doubtful, scene);
  all.insert(all.end(), out.scores.begin(), out.scores.end());
  out.with_doubtful = summarise(all);
}

TwoPeopleCounts count_two_people(const Evaluation& e, const Dataset& data) {
  TwoPeopleCounts out;
  for (std::size_t i = 0; i < e.uncertainties.size(); ++i) {
    if (data.records[e.rows[i]].label != two_people_label) continue;
    ++out.records, out.flagged += !e.uncertainties[i].out_of_distribution.reason.empty();
  }
  return out;
}

}  // namespace

Evaluation evaluate(const TrainedModel& model, const Records& records, const Rows& rows,
                    const std::string& title, const std::optional<ScoringScene>& scoring) {
  const Dataset& data = records.data;
  Evaluation out;
  out.scoring = scoring ? *scoring : scoring_scene(model, data);
  out.model = model.first().name;
  out.inputs = model.for_run(data).features.inputs;
  out.records = rows.size(), out.rows = rows;
  out.antennas = records.antennas, out.response = records.response;
  out.ranges = records.ranges;
  out.truth = faults_of_truth(data);
  out.domain_shift = domain_shift_of(model, data);
  if (!data.sources.empty())
    out.tested =
        data.sources.front().path + (model.was_trained_on(data) ? ", held-out records: " : ": ");
  for (const std::size_t row : rows)
    if (const std::string note = model.note_of(data, row); !note.empty()) ++out.fallbacks[note];
  if (!data.damaged.empty()) out.faults["damaged"] = data.damaged.size();
  if (!model.was_trained_on(data)) {
    for (const std::size_t row : with_depth(data))
      if (!model.fault_of(data, row).empty())
        ++out.faults[has_inputs(data, row, out.inputs) ? dead_record : "missing sensor"];
    out.trained_on = model.rows_trained_on(data).size();
    out.of = data.size();
  }
  out.twice = static_cast<std::size_t>(
      std::ranges::count(left_out_of_evaluation(model, data, false), duplicate_in_run));
  for (const auto& [why, count] : out.faults) out.left_out += count;
  score_predictions(model, records, rows, title, out);
  add_doubtful(model, records, out);
  out.two_people = count_two_people(out, data);
  return out;
}

std::vector<ScoredRow> score_baselines(const Dataset& data, const Rows& rows,
                                       const SceneModel& scene, const Dataset& neighbours_data,
                                       Rows neighbours, const std::string& title) {
  const auto inputs = common_inputs(data, neighbours_data);
  Copies scored_records;
  for (const std::size_t row : rows) scored_records.first(data.records[row].content, row);
  std::erase_if(neighbours, [&](std::size_t row) {
    return scored_records.contains(neighbours_data.records[row].content);
  });
  const bool with_nearest = !neighbours.empty() && inputs;
  Progress progress(title, with_nearest ? 3 : 2, title.empty());
  const auto scored = [&](const Matrix& maps) {
    return summarise(score_maps(maps, data, rows, scene));
  };
  std::vector<ScoredRow> out;
  const auto add = [&](const char* name, const Matrix& maps) {
    out.push_back({name, scored(maps)});
    progress.update(out.size());
  };
  add("empty", repeated_row(scene.background, rows.size()));
  add("mean", repeated_row(scene.mean_map, rows.size()));
  if (with_nearest) add("nearest", nearest_maps(data, rows, neighbours_data, neighbours, *inputs));
  return out;
}

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path) {
  const Estimator& by = model.for_run(data);
  using SteadyClock = std::chrono::steady_clock;
  constexpr std::size_t warm_up = 20, repeats = 400, max_batch = 1000;
  const auto us_of = [&](const Rows& some) {
    const auto started = SteadyClock::now();
    by.maps(data, some);
    return std::chrono::duration<double, std::micro>(SteadyClock::now() - started).count();
  };
  std::vector<double> us;
  for (std::size_t i = 0; i < warm_up + repeats; ++i)
    if (const double taken = us_of({rows[i % rows.size()]}); i >= warm_up) us.push_back(taken);
  std::sort(us.begin(), us.end());
  const auto some = std::span(rows).first(std::min(rows.size(), max_batch));
  const Rows batch(some.begin(), some.end());
  return {by.cost(),
          us[repeats / 2],
          us[repeats * 99 / 100],
          us_of(batch) / static_cast<double>(batch.size()),
          by.train_s,
          static_cast<std::size_t>(std::filesystem::file_size(model_path))};
}

}  // namespace echofuse::recon
