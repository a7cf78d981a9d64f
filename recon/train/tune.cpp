// SPDX-License-Identifier: MIT
#include "recon/train/tune.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <iterator>
#include <tuple>

#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/train/choice.hpp"
#include "recon/train/fit_uncertainty.hpp"

namespace echofuse::recon {
namespace {

constexpr std::array penalties{100., 10., 1.};
constexpr double usual_penalty = 30, min_penalty_of_few = 10;
// Minimum fraction of background pixels that must change before the background is replaced. People
// cover fewer pixels of the median map, even if they stay in one place for half of the records.
constexpr double changed_share = 0.2;

const char* const unchanged = "unchanged";
const char* const corrected = "background and position corrected";
const char* const alone = "these records alone";

bool can_be_tuned(const std::string& kind) {
  return wants_alignment(kind) || kind_of(kind).size == ModelKind::Size::hidden;
}

// Returns the scene learnt from `rows` if at least 20 % of the background pixels changed; otherwise
// the scene of the model.
SceneModel scene_for(const Estimator& from, const Dataset& data, const Rows& rows) {
  SceneModel scene = learn_scene(data.depth(), rows, data.map);
  std::size_t changed = 0;
  for (std::size_t p = 0; p < scene.background.size(); ++p)
    changed += std::abs(scene.background[p] - from.scene.background[p]) > 0.1f;
  if (static_cast<double>(changed) < changed_share * static_cast<double>(scene.background.size()))
    return from.scene;
  return scene;
}

// Background of the sensor data: kept from the model, or learnt from the new records.
enum class BackgroundSource : bool { kept, learnt };

Estimator adapt(const Estimator& from, const Dataset& data, const Rows& rows, BackgroundSource room,
                const Tuning& tuning, bool with_scene = true) {
  Estimator out;
  out.name = from.name;
  out.features = from.features;
  out.has_empty_room = from.has_empty_room && room == BackgroundSource::kept;
  out.scene = with_scene ? scene_for(from, data, rows) : from.scene;
  const Rows all = all_rows(data.size());
  out.alignment = wants_alignment(from.name) && room == BackgroundSource::learnt
                      ? Alignment(out.features.layout(), observe(data, all, out.features), rows)
                      : from.alignment;
  const Matrix views = out.views(data, all, false);
  Matrix scaled;
  const Matrix& taken = out.inputs(data, all, views, scaled);
  out.model = from.model->tuned(
      {taken, data.depth(), rows, &out.scene, &out.alignment, &data.radar(), &data.array()},
      tuning);
  return out;
}

Estimator fit_alone(const Estimator& from, const Dataset& data, const Rows& rows,
                    const TuneOptions& options) {
  const Inputs inputs = from.features.inputs;
  const bool aligned = wants_alignment(from.name);
  FitOptions fit = from.model->sizes();
  fit.seed = options.tuning.seed, fit.quiet = true;
  const Preprocessing preprocessing(data, rows, aligned ? inputs : without_antennas(inputs),
                                    learn_scene(data.depth(), rows, data.map), aligned);
  const std::string scaling = aligned ? "record" : from.features.scaling;
  return fit_model(data, {rows, {}, {}}, preprocessing, from.name, inputs, scaling, fit);
}

bool are_few(const Estimator& from, const Split& split) {
  return split.train.size() < TuneOptions::min_records_alone && wants_alignment(from.name);
}

// Returns by how many standard errors a candidate must be better than the first model unchanged. A
// few records cannot show which candidate is best, so that model is kept in doubtful cases. If
// there are more records, the best candidate is used.
double plainly(bool few) { return few ? 1 : 0; }

Tuning without_training(Tuning tuning) {
  tuning.l2_penalty = INFINITY;
  return tuning;
}

// Returns the background that gives a better score with the unchanged networks. The learnt
// background is chosen only if it is better by one standard error.
BackgroundSource better_room(const Start& start, const SceneModel& assessed_by, const Split& split,
                             const TuneOptions& options) {
  if (!wants_alignment(start.model.first().name) || !options.only.empty())
    return BackgroundSource::kept;
  Choice choice(assessed_by, split, options.split);
  for (const BackgroundSource room : {BackgroundSource::kept, BackgroundSource::learnt})
    choice.add("background", start.data, [&, room](const Rows& rows) {
      return adapt(start.model.first(), start.data, rows, room, without_training(options.tuning),
                   room == BackgroundSource::learnt);
    });
  choice.choose(1);
  return choice.chosen() == 0 ? BackgroundSource::kept : BackgroundSource::learnt;
}

// Tries all candidates for one start model. `with_alone`: also tries a model trained only on the
// new records. This is needed for only one start model, because the result does not depend on the
// start model.
void try_all(Choice& choice, const Start& start, const Split& split, const TuneOptions& options,
             BackgroundSource room, bool with_alone) {
  const Estimator& from = start.model.first();
  const Dataset& data = start.data;
  const bool aligned = wants_alignment(from.name);
  const auto add = [&](const std::string& name, Choice::Fit fit) {
    if (!options.only.empty() && options.only != name) return;
    if (!options.quiet) std::fprintf(stderr, "cross-validation: %s\n", name.c_str());
    choice.add(name, name == alone ? start.own : data, std::move(fit));
  };
  Tuning tuning = without_training(options.tuning);
  add(unchanged, [&, tuning](const Rows& rows) {
    return adapt(from, data, rows, BackgroundSource::kept, tuning, false);
  });
  tuning.correct = true;
  if (aligned)
    add(corrected,
        [&, tuning, room](const Rows& rows) { return adapt(from, data, rows, room, tuning); });
  const bool many = split.train.size() >= TuneOptions::min_records_alone;
  for (const double l2_penalty : penalties) {
    if (!many && aligned && l2_penalty < min_penalty_of_few) continue;
    tuning.l2_penalty = l2_penalty;
    add(format("fine-tuned, L2 penalty %g over N", l2_penalty),
        [&, tuning, room](const Rows& rows) { return adapt(from, data, rows, room, tuning); });
  }
  if (many && with_alone)
    add(alone, [&](const Rows& rows) { return fit_alone(from, start.own, rows, options); });
}

TrainingRows rows_of(const std::vector<Start>& starts) {
  TrainingRows out;
  for (const Start& start : starts) {
    if (!can_be_tuned(start.model.first().name))
      throw Error(ExitCode::failed,
                  "a model of type " + start.model.first().name +
                      " cannot be tuned; expected mean-shape, factorised, mlp or pca-mlp");
    const TrainingRows found = rows_to_train(start.data, start.model.first().features.inputs);
    Rows both;
    std::ranges::set_intersection(out.rows, found.rows, std::back_inserter(both));
    if (&start == &starts.front())
      out = found;
    else
      out.rows = both;
  }
  return out;
}

// Adds the alignment to the chosen model. If there are enough records, also adds the domain test
// and the uncertainty.
void finish(Estimator& model, const Dataset& data, const Split& split,
            const std::vector<HeldOut>& assessed, std::uint64_t seed) {
  const Rows all = all_rows(data.size());
  const Inputs inputs = model.features.inputs;
  const bool has_spd = inputs != Inputs::radar;
  const bool uncertainty = split.train.size() >= min_cross_fitted;
  const bool domain = split.train.size() >= DomainReference::min_records;
  if (!wants_alignment(model.name)) {
    model.alignment = {};
    if (has_spd && domain)
      model.alignment =
          Alignment(model.features.layout(), observe(data, all, model.features), split.train);
  }
  const Matrix views = model.views(data, all, true);
  if (domain) model.domain = DomainReference(model.alignment, data, views, split.train, inputs);
  if (uncertainty)
    model.uncertainty = fit_uncertainty(model, data, views, split.train, assessed, seed);
}

// Keeps the uncertainty and the domain reference of an unchanged estimator, because they were
// learnt from more records.
void keep_statements(Estimator& model, const Estimator& from) {
  model.uncertainty = from.uncertainty, model.domain = from.domain;
}

// Tunes a fallback estimator (without antennas, or for the SPD alone). If `by_alone` is true, fits
// this estimator only to the new records, as was done for the first estimator. The penalty is not
// cross-validated, because fallback estimators are rarely used. If there are few records, the
// networks stay unchanged, and positions are corrected only if the first estimator changed.
Estimator tune_other(const Estimator& from, const Dataset& data, const Split& split,
                     const TuneOptions& options, bool learns, bool by_alone) {
  const bool few = are_few(from, split);
  Tuning tuning = options.tuning;
  tuning.l2_penalty = few ? INFINITY : usual_penalty, tuning.correct = few && learns;
  const auto fit = [&](const Rows& rows) {
    return by_alone ? fit_alone(from, data, rows, options)
                    : adapt(from, data, rows, BackgroundSource::kept, tuning);
  };
  Estimator out = fit(split.train);
  if (!by_alone && tuning.networks_stay() && !tuning.correct) {
    keep_statements(out, from);
    return out;
  }
  const std::array halves{make_fold(split.train, 0, 2, 0), make_fold(split.train, 1, 2, 0)};
  const std::array models{fit(halves[0].train), fit(halves[1].train)};
  finish(out, data, split, {{models[0], halves[0].test}, {models[1], halves[1].test}}, tuning.seed);
  return out;
}

// Describes the gain of the chosen candidate over the best candidate of another start model, which
// has the candidates [first, last).
std::string compared(const Choice& choice, const std::string& best, const std::string& other,
                     std::size_t first, std::size_t last) {
  constexpr double clear_errors = 2;
  const auto [gain, error] = choice.gain_over(first, last);
  return format(
      "gain of start model %s over %s on the same folds: %+.3f +- %.3f (IoU - 2.4 x lateral error "
      "in "
      "m)%s\n",
      printable(best).c_str(), printable(other).c_str(), gain, error,
      gain < clear_errors * error ? "; not significant" : "");
}

// Joins the lists of the training records of the old model and of the new model.
TrainingRecords both(const TrainingRecords& old, TrainingRecords seen) {
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
  require_map(data, from.first().scene.grid, "the model");
  const Features& f = from.first().features;
  const Layout used = f.layout();
  for (const auto& [found, expected] : {std::pair{&data.spd(), &used.spd},
                                        {&data.radar(), &used.radar},
                                        {&data.array(), &used.array}})
    if (expected->count > 0 && found->axis.count == 0)
      throw Error(ExitCode::failed, printable(data.path()) + ": has no " + expected->name +
                                        ", which " + printable(path) + " needs (" +
                                        name_of(f.inputs) + ")");
  match_axes(data, f.axes, f.inputs);
  from.response.convert(data);
}

TunedModel tune(const std::vector<Start>& starts, const TuneOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  const TrainingRows usable = rows_of(starts);
  const Rows& rows = usable.rows;
  if (rows.size() < TuneOptions::min_records)
    throw Error(ExitCode::failed,
                std::to_string(rows.size()) + " usable records; tuning needs at least 10");
  const Split split = make_split(rows, options.split);
  const SceneModel assessed_by =
      scene_for(starts.front().model.first(), starts.front().data, split.train);
  Choice choice(assessed_by, split, options.split);
  // Index of the first candidate of each start model, then the number of candidates.
  std::vector<std::size_t> first{0};
  for (const Start& start : starts) {
    try_all(choice, start, split, options, better_room(start, assessed_by, split, options),
            first.back() == 0);
    first.push_back(choice.size());
  }
  if (choice.size() == 0)
    throw Error(ExitCode::usage, options.only + ": no candidate has this name");
  choice.choose(plainly(are_few(starts.front().model.first(), split)));
  TunedModel out;
  out.left_out = usable.left_out;
  out.table = choice.table(), out.chosen = choice.chosen();
  const auto best =
      static_cast<std::size_t>(std::ranges::upper_bound(first, out.chosen) - first.begin()) - 1;
  for (std::size_t k = 0; k < starts.size() && starts.size() > 1; ++k) {
    if (k != best && first[k] < first[k + 1])
      out.starts += compared(choice, starts[best].name, starts[k].name, first[k], first[k + 1]);
    for (std::size_t i = first[k]; i < first[k + 1]; ++i)
      out.table[i].name = starts[k].name + ": " + out.table[i].name;
  }
  const TrainedModel& from = starts[best].model;
  const bool by_alone = choice.is(alone);
  const Dataset& data = by_alone ? starts[best].own : starts[best].data;
  TrainedModel& model = out.model;
  model.estimators.push_back(choice.fit());
  model.split = options.split;
  model.first().fit.seed = options.tuning.seed;
  model.training = both(from.training, training_records(data, split));
  model.data_hash = data.hash;
  model.response = by_alone ? ModelResponse(data) : from.response;
  model.exclusions = data.exclusions;
  const bool stayed = split.train.size() < min_cross_fitted && choice.is(unchanged);
  if (stayed)
    keep_statements(model.first(), from.first());
  else
    finish(model.first(), data, split, choice.held_out(), options.tuning.seed);
  for (std::size_t k = 1; k < from.estimators.size(); ++k)
    model.estimators.push_back(
        tune_other(from.estimators[k], data, split, options, !stayed, by_alone));
  model.first().train_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

std::string to_text(const TunedModel& tuned) {
  std::string out = format("%-44s %15s %15s %8s\n", "model", "IoU", "lateral m", "train s");
  for (std::size_t i = 0; i < tuned.table.size(); ++i) {
    const auto& m = tuned.table[i].metrics;
    out += format("%-44s %15s %15s %8.2f%s\n", tuned.table[i].name.c_str(),
                  formatted(m[metric_iou], " +-").c_str(),
                  formatted(m[metric_lateral_m], " +-").c_str(), tuned.table[i].train_s,
                  i == tuned.chosen ? "  <- chosen" : "");
  }
  return out + tuned.starts;
}

}  // namespace echofuse::recon
