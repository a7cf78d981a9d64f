// SPDX-License-Identifier: MIT
#include "recon/train/train.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "drivers/util/console.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/train/crossvalidate.hpp"
#include "recon/train/fit_uncertainty.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t fold_stream = 0x666f6c64;  // "fold" in ASCII

// Chooses a model by cross-validation on the training and validation records, never on test
// records.
std::string choose(const Dataset& data, const Split& split, const TrainOptions& options) {
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  std::sort(rows.begin(), rows.end());
  if (options.split.kind != "blocked")
    rows = drawn(std::move(rows), options.split.seed, fold_stream);
  const auto table = crossvalidate(data, rows, options);
  const std::size_t chosen = cheapest_within_one_se(table);
  if (!options.fit.quiet) std::fputs(to_choice_table(table, chosen).c_str(), stderr);
  return table[chosen].name;
}

bool aligns_inputs(const std::string& candidate, const TrainOptions& options) {
  return wants_alignment(candidate_of(candidate, options.fit).model);
}

void say(const TrainOptions& options, const std::string& text) {
  if (!options.fit.quiet) std::fprintf(stderr, "%s\n", text.c_str());
}

// Name, inputs and options of one estimator to train.
struct TrainingPlan {
  std::string name;
  Inputs inputs;
  std::string scaling;
  FitOptions fit;
  // Number of validation records that suffice to estimate the errors of the estimator.
  std::size_t enough_validation;
};

// Returns the estimators to train, in the order in which they are tried for a record. The first is
// `name`. If options.fallback is set, two fallback estimators may follow: `name` without antenna
// samples, and a network for the SPD alone.
std::vector<TrainingPlan> plans_of(const Dataset& data, const std::string& name,
                                   const TrainOptions& options) {
  // The network for the SPD alone needs fewer validation records, because it is rarely used.
  constexpr std::size_t enough = 500, enough_of_spd = 150;
  const Inputs inputs = inputs_of(options.inputs);
  const bool aligned = aligns_inputs(name, options);
  std::vector<TrainingPlan> out{{name, inputs, options.scaling, options.fit, enough}};
  if (!options.fallback || !both_sensors(inputs) ||
      ignores_inputs(candidate_of(name, options.fit).model))
    return out;
  if (inputs == Inputs::fused && aligned && data.array().axis.count > 0)
    out.push_back({name, Inputs::fused_profile, options.scaling, options.fit, enough});
  FitOptions of_spd;
  of_spd.seed = options.fit.seed, of_spd.quiet = options.fit.quiet;
  of_spd.epochs = options.fit.epochs;
  out.push_back(
      {usual_model(shows_sides(data, Inputs::spd)), Inputs::spd, "record", of_spd, enough_of_spd});
  return out;
}

Estimator train_one(const TrainingPlan& expected, const Dataset& data, const Split& split,
                    const SceneModel& scene, const TrainOptions& options) {
  const auto& [name, inputs, scaling, fit, enough_validation] = expected;
  const bool aligned = wants_alignment(candidate_of(name, fit).model);
  const bool uncertainties = options.uncertainty && has_enough_records(split) &&
                             !ignores_inputs(candidate_of(name, fit).model);
  const std::string which = name + " on " + name_of(inputs);
  say(options, which + ": aligning " + std::to_string(data.size()) + " records, then fitting");
  const Preprocessing preprocessing(data, split.train, aligned ? inputs : without_antennas(inputs),
                                    scene, uncertainties || aligned, options.background);
  Estimator out = fit_model(data, split, preprocessing, name, inputs, scaling, fit);
  out.alignment = preprocessing.alignment;
  if (!uncertainties || out.log.interrupted) return out;
  if (inputs != Inputs::spd || options.inputs == name_of(Inputs::spd))
    out.domain =
        DomainReference(preprocessing.alignment, data, preprocessing.views, split.train, inputs);
  say(options, which + ": estimating its errors on held-out records");
  FitOptions quiet = fit;
  quiet.quiet = true;
  std::size_t models = 0;
  out.uncertainty = fit_uncertainty(
      out, data, preprocessing.views, split, options.split,
      [&](const Split& part) {
        say(options, "  fitting model " + std::to_string(++models) + " to part of the records");
        return fit_model(data, part, preprocessing, expected.name, expected.inputs,
                         expected.scaling, quiet);
      },
      enough_validation);
  return out;
}

TrainedModel train_split(const Dataset& data, const Split& split, const SceneModel& scene,
                         const std::string& name, const TrainOptions& options) {
  if (!scene.has_body() && !options.fit.quiet) std::fprintf(stderr, "%s\n", no_body);
  TrainedModel model;
  model.split = options.split;
  model.training = training_records(data, split);
  model.data_hash = data.hash;
  model.response = ModelResponse(data, options.any_response);
  model.exclusions = data.exclusions;
  for (const TrainingPlan& plan : plans_of(data, name, options)) {
    if (!model.estimators.empty() && interrupted()) break;
    Estimator one = train_one(plan, data, split, scene, options);
    // If training was interrupted, the estimator `one` is incomplete.
    if (!model.estimators.empty() && interrupted()) break;
    model.estimators.push_back(std::move(one));
  }
  model.first().log.interrupted |= interrupted();
  return model;
}

Rows usable_rows(const Dataset& data, const TrainOptions& options) {
  const Inputs inputs = inputs_to_train(options);
  if (inputs == Inputs::fused && data.array().differs)
    say(options,
        "the radar antennas differ between the runs: only the radar range profile is used");
  TrainingRows usable = rows_to_train(data, inputs);
  if (!usable.left_out.empty()) say(options, usable.left_out);
  return std::move(usable.rows);
}

// Prints a warning if the split makes the scores optimistic.
void warn_of_split(const Dataset& data, const Rows& rows, const Split& split,
                   const SceneModel& scene, const SplitOptions& options) {
  const bool random = options.kind == "random" && !split.test.empty();
  std::string text = random ? similar_neighbours(data, rows) : "";
  if (text.empty()) text = recurring_scenes(data, split, scene);
  if (!text.empty()) std::fprintf(stderr, "%s\n", text.c_str());
}

}  // namespace

Inputs inputs_to_train(const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  return options.model == "auto" || aligns_inputs(options.model, options)
             ? inputs
             : without_antennas(inputs);
}

TrainedModel train(const Dataset& data, const TrainOptions& options) {
  const bool loud = !options.fit.quiet;
  const Rows rows = usable_rows(data, options);
  const Split split = make_split(rows, options.split);
  const SceneModel scene = learn_scene(data.depth(), split.train, data.map);
  if (loud) warn_of_split(data, rows, split, scene, options.split);
  const std::string name = options.model == "auto" ? choose(data, split, options) : options.model;
  return train_split(data, split, scene, name, options);
}

}  // namespace echofuse::recon
