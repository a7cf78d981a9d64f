// SPDX-License-Identifier: MIT
#include "recon/train/tune.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <iterator>
#include <tuple>

#include "drivers/core/random.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "recon/data/response.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/train/fit_uncertainty.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t fold_stream = 0x74756e65;  // "tune"
// Share of the pixels of the median map. People alone fill less, even if half of few records have
// them in one place.
constexpr double changed_share = 0.2;
// A centimetre of lateral error counts as much as this IoU. By quarters of the lateral error (0.5
// to 7.3 cm) the maps of one model have an IoU of .671 to .510.
constexpr double iou_a_metre = 2.4;

const char* const as_it_was = "as it was";
const char* const corrected = "mean body, offset and scale learnt";
const char* const tuned_networks = "networks tuned";
const char* const alone = "these records alone";

bool can_be_tuned(const std::string& kind) {
  return wants_alignment(kind) || kind_of(kind).size == ModelKind::Size::hidden;
}

// True if what the maps show behind people is another place than the one that the model knows.
bool is_elsewhere(const Scene& scene, const Estimator& from) {
  std::size_t changed = 0;
  for (std::size_t p = 0; p < scene.background.size(); ++p)
    changed += std::abs(scene.background[p] - from.scene.background[p]) > 0.1f;
  return static_cast<double>(changed) >=
         changed_share * static_cast<double>(scene.background.size());
}

// Elsewhere the backgrounds of maps and sensors are learnt anew.
Estimator adapt(const Estimator& from, const Dataset& data, const Rows& rows,
                const Tuning& tuning) {
  const Rows all = all_rows(data.size());
  Estimator out;
  out.name = from.name;
  out.features = from.features;
  out.scene = learn_scene(data.depth, rows, data.map);
  const bool anew = tuning.changes() && is_elsewhere(out.scene, from);
  if (!anew) out.scene = from.scene;
  out.knows_empty_room = from.knows_empty_room && !anew;
  out.alignment = anew && wants_alignment(from.name)
                      ? Alignment(out.features.layout(), observe(data, all, out.features), rows,
                                  from.alignment.config())
                      : from.alignment;
  const Matrix views = out.views(data, all, false);
  Matrix scaled;
  const Matrix& taken = out.inputs(data, all, views, scaled);
  out.model = from.model->tuned(
      {taken, data.depth, rows, &out.scene, &out.alignment, &data.radar, &data.array}, tuning);
  return out;
}

Estimator fit_alone(const Estimator& from, const Dataset& data, const Rows& rows,
                    const TuneOptions& options) {
  const Inputs inputs = from.features.inputs;
  const bool aligned = wants_alignment(from.name);
  FitOptions fit = from.model->sizes();
  fit.seed = options.tuning.seed, fit.quiet = true;
  const Preprocessing preprocessing(data, rows, aligned ? inputs : without_antennas(inputs),
                                    learn_scene(data.depth, rows, data.map), aligned,
                                    from.alignment.config());
  const std::string scaling = aligned ? "record" : from.features.scaling;
  return fit_model(data, {rows, {}, {}}, preprocessing, from.name, inputs, scaling, fit);
}

bool are_few(const Estimator& from, const Split& split) {
  return split.train.size() < TuneOptions::least_alone && wants_alignment(from.name);
}

// Returns the standard errors by which something has to be better than the model as it was. So few
// records hardly show which is best, and what stays does no harm. More records choose the best.
double plainly(bool few) { return few ? 2 : 0; }

// More records hold the old weights less, by the square of their number. Of pulls of 100, 30, 10, 3
// and 1 over N, seven worlds have the best scores with 100 (10 records), 10 or 30 (50), 1 (200).
double pull_of(const Split& split) { return 500 / static_cast<double>(split.train.size()); }

// Something that a model may become.
struct Outcome {
  const Start* start;
  std::function<Estimator(const Rows& rows)> fit;
  CrossvalidatedRow row = {};
  std::vector<Estimator> models = {};  // one a fold
  bool is(const char* name) const { return row.name == name; }
  const Dataset& data() const { return is(alone) ? start->own : start->data; }
};

// A model of these records alone is the same from any start, and is made of the first one.
std::vector<Outcome> outcomes_of(const Start& start, const Split& split, const TuneOptions& options,
                                 bool with_alone) {
  const Estimator& from = start.model.first();
  std::vector<Outcome> out;
  const auto add = [&](const char* name, std::function<Estimator(const Rows&)> fit) {
    if (!options.only.empty() && options.only != name) return;
    out.push_back({&start, std::move(fit)});
    out.back().row.name = name;
  };
  const auto add_adapted = [&](const char* name, double pull, bool correct) {
    Tuning tuning = options.tuning;
    tuning.pull = pull, tuning.correct = correct;
    add(name, [&from, &start, tuning](const Rows& rows) {
      return adapt(from, start.data, rows, tuning);
    });
  };
  add_adapted(as_it_was, INFINITY, false);
  if (are_few(from, split)) add_adapted(corrected, INFINITY, true);
  add_adapted(tuned_networks, pull_of(split), false);
  if (with_alone && split.train.size() >= TuneOptions::least_alone)
    add(alone, [&](const Rows& rows) { return fit_alone(from, start.own, rows, options); });
  return out;
}

// Returns by how much the score of a row is better than that of another one of the same records; 0
// if by less than so many standard errors of their paired differences.
double gain_of(const CrossvalidatedRow& row, const CrossvalidatedRow& than, bool has_body,
               double errors) {
  const auto score = [&](const MapScores& map) {
    return has_body ? map[metric_iou] - iou_a_metre * map[metric_lateral_m] : -map[metric_rmse_m];
  };
  std::vector<double> gains;
  for (std::size_t i = 0; i < std::min(row.scores.size(), than.scores.size()); ++i)
    if (const double gain = score(row.scores[i]) - score(than.scores[i]); !std::isnan(gain))
      gains.push_back(gain);
  if (gains.size() < 2) return 0;
  const double error = standard_deviation(gains) / std::sqrt(static_cast<double>(gains.size() - 1));
  return mean_of(gains) > errors * error ? mean_of(gains) : 0;
}

// Returns the best of those that are better than the first one by so many standard errors, or else
// the first one.
const Outcome* best_of(const std::vector<const Outcome*>& some, bool has_body, double errors) {
  const Outcome* best = some.front();
  double most = 0;
  for (const Outcome* one : some)
    if (const double gain = gain_of(one->row, some.front()->row, has_body, errors); gain > most)
      best = one, most = gain;
  return best;
}

// Returns the rows that every start can learn from.
TrainingRows rows_of(const std::vector<Start>& starts) {
  TrainingRows out;
  for (const Start& start : starts) {
    if (!can_be_tuned(start.model->name))
      throw Error(ExitCode::failed,
                  "a model of kind " + start.model->name +
                      " cannot be tuned; silhouette, factorised, mlp and pca-mlp can");
    const TrainingRows found = rows_to_train(start.data, start.model->features.inputs);
    Rows both;
    std::ranges::set_intersection(out.rows, found.rows, std::back_inserter(both));
    if (&start == &starts.front())
      out = found;
    else
      out.rows = both;
  }
  return out;
}

// Adds the parts beside the chosen model; no uncertainty with too few records.
void finish(Estimator& model, const Dataset& data, const Split& split,
            const std::vector<Judged>& judged, std::uint64_t seed) {
  const Rows all = all_rows(data.size());
  const Inputs inputs = model.features.inputs;
  const bool has_spd = inputs != Inputs::radar;
  const bool uncertainty = split.train.size() >= least_cross_fitted;
  const bool domain = split.train.size() >= DomainReference::least_records;
  if (!wants_alignment(model.name)) {
    model.alignment = {};
    if (has_spd && domain)
      model.alignment =
          Alignment(model.features.layout(), observe(data, all, model.features), split.train);
  }
  const Matrix views = model.views(data, all, true);
  if (domain) model.domain = DomainReference(model.alignment, data, views, split.train, inputs);
  if (uncertainty)
    model.uncertainty = fit_uncertainty(model, data, views, split.train, judged, seed);
}

// Few records say nothing of an estimator that stays as it was; its own training did.
void keep_statements(Estimator& model, const Estimator& from) {
  model.uncertainty = from.uncertainty, model.domain = from.domain;
}

// Tunes the estimators for the range profile and the SPD alone, or fits them alone as the first
// one. Their pull is not tested: they are seldom needed. With few records they learn no more than
// the first estimator does.
Estimator tune_other(const Estimator& from, const Dataset& data, const Split& split,
                     const TuneOptions& options, bool learns, bool by_alone) {
  const bool few = are_few(from, split);
  Tuning tuning = options.tuning;
  tuning.pull = few ? INFINITY : pull_of(split);
  tuning.correct = few && learns;
  const auto fit = [&](const Rows& rows) {
    return by_alone ? fit_alone(from, data, rows, options) : adapt(from, data, rows, tuning);
  };
  Estimator out = fit(split.train);
  if (!by_alone && !tuning.changes()) {
    keep_statements(out, from);
    return out;
  }
  const std::array halves{make_fold(split.train, 0, 2, 0), make_fold(split.train, 1, 2, 0)};
  const std::array models{fit(halves[0].train), fit(halves[1].train)};
  finish(out, data, split, {{models[0], halves[0].test}, {models[1], halves[1].test}}, tuning.seed);
  return out;
}

// Returns the records of the old model and of this one.
SeenRecords both(const SeenRecords& old, SeenRecords seen) {
  const auto first = static_cast<std::uint32_t>(seen.runs.size());
  seen.runs.insert(seen.runs.end(), old.runs.begin(), old.runs.end());
  for (const std::uint32_t run : old.run) seen.run.push_back(first + run);
  seen.index.insert(seen.index.end(), old.index.begin(), old.index.end());
  seen.part.insert(seen.part.end(), old.part.begin(), old.part.end());
  seen.hash.insert(seen.hash.end(), old.hash.begin(), old.hash.end());
  return seen;
}

}  // namespace

void match_for_tuning(const TrainedModel& from, const std::string& path, Dataset& data) {
  require_map(data, from->scene.grid, "the model");
  const Features& f = from->features;
  const std::string run = data.sources.empty() ? "run" : printable(data.sources.front().path);
  for (const auto& [found, wanted, what] : {std::tuple{data.spd_axis, f.layout().spd, "spd"},
                                            {data.radar_axis, f.layout().radar, "radar"},
                                            {data.array_axis, f.layout().array, "array"}})
    if (wanted.count > 0 && found.count == 0)
      throw Error(ExitCode::failed, run + ": has no " + what + ", which " + printable(path) +
                                        " takes (" + name_of(f.inputs) + ")");
  match_axes(data, f.spd_axis, f.radar_axis, f.inputs);
  match_array(data, f.array_axis);
  bring_to_response(data, from.radar_response, from.any_response);
}

TunedModel tune(const std::vector<Start>& starts, const TuneOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  const auto [rows, left_out] = rows_of(starts);
  if (rows.size() < TuneOptions::least_records)
    throw Error(ExitCode::failed, std::to_string(rows.size()) +
                                      " usable records; at least 10 are needed to tune a model");
  const Split split = make_split(rows, options.split);
  const Estimator& first = starts.front().model.first();
  const Scene learnt = learn_scene(starts.front().data.depth, split.train, starts.front().data.map);
  const Scene& judged_by = is_elsewhere(learnt, first) ? learnt : first.scene;
  const Crossvalidation folds(judged_by, split.train, options.split, fold_stream);
  const double errors = plainly(are_few(first, split));
  std::vector<Outcome> all;
  for (const Start& start : starts)
    for (Outcome& one : outcomes_of(start, split, options, &start == &starts.front())) {
      if (!options.quiet) std::fprintf(stderr, "cross-validation: %s\n", one.row.name.c_str());
      one.row = folds.row(
          one.row.name, one.data(), [&](const Split& fold) { return one.fit(fold.train); },
          &one.models);
      all.push_back(std::move(one));
    }
  if (all.empty())
    throw Error(ExitCode::usage, options.only + ": nothing of this name is tried here");
  // Between starts with few records one error: none harmed 2 of 21 draws of seven worlds, one 0.
  std::vector<const Outcome*> of_starts;
  for (const Start& start : starts) {
    std::vector<const Outcome*> own;
    for (const Outcome& one : all)
      if (one.start == &start) own.push_back(&one);
    if (!own.empty()) of_starts.push_back(best_of(own, judged_by.has_body(), errors));
  }
  const Outcome& best = *best_of(of_starts, judged_by.has_body(), errors / 2);
  TunedModel out;
  out.left_out = left_out;
  for (const Outcome& one : all) {
    if (&one == &best) out.chosen = out.table.size();
    out.table.push_back(one.row);
    if (starts.size() > 1) out.table.back().name = one.start->name + ": " + one.row.name;
  }
  const TrainedModel& from = best.start->model;
  const bool by_alone = best.is(alone);
  const Dataset& data = best.data();
  TrainedModel& model = out.model;
  model.estimators.push_back(best.fit(split.train));
  model.split = options.split;
  model->fit.seed = options.tuning.seed;
  model.seen = both(from.seen, seen_records(data, split));
  model.data_hash = data.hash;
  model.radar_response = by_alone ? widest_response(data) : from.radar_response;
  model.any_response = !by_alone && from.any_response;
  const bool stayed = split.train.size() < least_cross_fitted && best.is(as_it_was);
  if (stayed)
    keep_statements(model.first(), from.first());
  else {
    std::vector<Judged> judged;
    for (std::size_t k = 0; k < best.models.size(); ++k)
      judged.push_back({best.models[k], folds.folds()[k].test});
    finish(model.first(), data, split, judged, options.tuning.seed);
  }
  for (std::size_t k = 1; k < from.estimators.size(); ++k)
    model.estimators.push_back(
        tune_other(from.estimators[k], data, split, options, !stayed, by_alone));
  model->train_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace echofuse::recon
