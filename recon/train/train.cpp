// SPDX-License-Identifier: MIT
#include "recon/train/train.hpp"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <iterator>
#include <optional>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/program/console.hpp"
#include "recon/data/response.hpp"
#include "recon/numbers/text.hpp"
#include "recon/train/crossvalidate.hpp"
#include "recon/train/fit_uncertainty.hpp"

namespace echofuse::recon {
namespace {

// In front of a room the SPD alone sees nearly everything, but only a network learns it.
constexpr const char* fallback_candidate = "pca-mlp-256-256";
constexpr std::uint64_t fold_stream = 0x666f6c64;  // "fold"

// The choice uses the training records alone: the test records choose nothing.
std::string choose(const Dataset& data, const Split& split, const TrainOptions& options) {
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  std::sort(rows.begin(), rows.end());
  Rng rng = make_rng(options.split.seed, fold_stream);
  if (options.split.kind != "blocked") std::shuffle(rows.begin(), rows.end(), rng);
  const auto table = crossvalidate(data, rows, options);
  const std::size_t chosen = cheapest_within_one_se(table);
  if (!options.fit.quiet) std::fputs(to_choice_table(table, chosen).c_str(), stderr);
  return table[chosen].name;
}

constexpr std::uint64_t weight_stream = 0x77656967;  // "weig"

// Repeats each row as often as its run counts.
Rows weighted(const Dataset& data, const Rows& rows, const TrainOptions& options) {
  if (options.weights.empty()) return rows;
  if (options.weights.size() != data.sources.size())
    throw Error(ExitCode::usage, "weights: " + std::to_string(options.weights.size()) +
                                     " numbers for " + std::to_string(data.sources.size()) +
                                     " runs; one each");
  Rng rng = make_rng(options.split.seed, weight_stream);
  std::uniform_real_distribution<double> chance(0, 1);
  Rows out;
  for (const std::size_t row : rows)
    for (double left = options.weights[data.source_of(row)] - chance(rng); left > 0; --left)
      out.push_back(row);
  if (out.size() < 2)
    throw Error(ExitCode::usage, "weights: hardly any record is left to train on");
  return out;
}

// Returns the rows of the runs that stand for the use, or all rows if no run was named.
Rows of_use(const Dataset& data, const TrainOptions& options) {
  Rows out;
  for (const std::size_t run : options.validate_on) {
    if (run >= data.sources.size())
      throw Error(ExitCode::usage, "validate_on " + std::to_string(run + 1) + ": there are " +
                                       std::to_string(data.sources.size()) + " runs");
    for (std::size_t i = 0; i < data.sources[run].count; ++i)
      out.push_back(data.sources[run].first + i);
  }
  std::sort(out.begin(), out.end());
  return out;
}

Rows common(const Rows& rows, const Rows& wanted) {
  Rows out;
  for (const std::size_t row : rows)
    if (wanted.empty() || std::binary_search(wanted.begin(), wanted.end(), row)) out.push_back(row);
  return out;
}

// Both lists are in order.
Rows without(const Rows& rows, const Rows& unwanted) {
  Rows out;
  std::ranges::set_difference(rows, unwanted, std::back_inserter(out));
  return out;
}

Rows in_order(Rows rows) {
  std::sort(rows.begin(), rows.end());
  return rows;
}

bool looks_at_body(const std::string& candidate, const TrainOptions& options) {
  return wants_alignment(candidate_of(candidate, options.fit).model);
}

constexpr double share_of_use = 0.5;  // weight of its records over that of the others; measured
constexpr double most_times = 100;    // most times that a record counts
constexpr std::size_t others_least = 100;  // least number of others to tell that it is unlike them
constexpr double most_p = 0.05;            // by chance; few records cannot give a small one

// A few records of the target room are swamped by many others, so they count more often if a test
// tells both apart. Otherwise each record counts once.
std::vector<double> weights_of(const Dataset& data, const Split& split, Inputs inputs,
                               const TrainOptions& options) {
  const Rows use = of_use(data, options);
  if (!options.weights.empty() || use.empty()) return options.weights;
  const Rows few = common(split.train, use);
  const Rows others = without(split.train, use);
  if (few.empty() || others.size() < others_least) return {};
  const double times = std::min(most_times, share_of_use * static_cast<double>(others.size()) /
                                                static_cast<double>(few.size()));
  if (times <= 1) return {};
  const Preprocessing preprocessing(data, split.train, inputs,
                                    learn_scene(data.depth, split.train, data.map), true);
  const DomainReference reference(preprocessing.alignment, data, preprocessing.views, others,
                                  inputs);
  if (!reference.known()) return {};
  const DomainShift shift = reference.judge(preprocessing.alignment, part_of(data, few),
                                            take_rows(preprocessing.views, few));
  if (shift.p > most_p || shift.differences.empty()) return {};
  std::vector<double> weights(data.sources.size(), 1);
  for (const std::size_t run : options.validate_on) weights[run] = times;
  if (!options.fit.quiet)
    std::fprintf(stderr,
                 "the runs that stand for the use are unlike the others (%s): each of their "
                 "records counts %.1f times; --set weights= says otherwise\n",
                 shift.p_text().c_str(), times);
  return weights;
}

void say(const TrainOptions& options, const std::string& text) {
  if (!options.fit.quiet) std::fprintf(stderr, "%s\n", text.c_str());
}

// Describes one of the estimators of a model.
struct Wanted {
  std::string name;  // candidate
  Inputs inputs;
  std::string scaling;
  FitOptions fit;
  std::size_t enough_validation;  // records that tell of its errors
};

// Returns the estimators that a training makes, in the order in which they are asked. The first is
// as named. If that one takes the radar's antennas, the next is the same with the range profile
// alone. If it takes both sensors, the last is a network for the SPD alone, for records whose radar
// is lost.
std::vector<Wanted> wanted_of(const Dataset& data, const std::string& name,
                              const TrainOptions& options) {
  constexpr std::size_t enough = 500, enough_of_spd = 150;  // the SPD's model is seldom used
  const Inputs inputs = inputs_of(options.inputs);
  const bool aligned = looks_at_body(name, options);
  std::vector<Wanted> out{{name, inputs, options.scaling, options.fit, enough}};
  if (!options.fallback || !both_sensors(inputs) ||
      ignores_inputs(candidate_of(name, options.fit).model))
    return out;
  if (inputs == Inputs::fused && aligned && data.array_axis.count > 0)
    out.push_back({name, Inputs::fused_profile, options.scaling, options.fit, enough});
  FitOptions of_spd;
  of_spd.seed = options.fit.seed, of_spd.quiet = options.fit.quiet;
  of_spd.epochs = options.fit.epochs;
  out.push_back({fallback_candidate, Inputs::spd, "record", of_spd, enough_of_spd});
  return out;
}

// Rows of a training. `fit`: rows that networks learn from, with repetitions. `used`: rows that
// stand for the later use; the model's errors are stated for them.
struct Material {
  Split fit, used;
  std::function<Split(Split)> with_others;  // adds the other runs to a part of the used records
};

Estimator train_one(const Wanted& wanted, const Dataset& data, const Material& material,
                    const Scene& scene, const TrainOptions& options) {
  const auto& [name, inputs, scaling, fit, enough_validation] = wanted;
  const bool aligned = wants_alignment(candidate_of(name, fit).model);
  const bool uncertainties = options.uncertainty && has_enough_records(material.used);
  const std::string which = name + " on " + name_of(inputs);
  say(options, which + ": aligning " + std::to_string(data.size()) + " records, then learning");
  const Preprocessing preprocessing(data, material.fit.train,
                                    aligned ? inputs : without_antennas(inputs), scene,
                                    uncertainties || aligned, options.config);
  Estimator out = fit_model(data, material.fit, preprocessing, name, inputs, scaling, fit);
  out.alignment = preprocessing.alignment;
  if (!uncertainties || out.log.interrupted) return out;
  if (inputs != Inputs::spd || options.inputs == name_of(Inputs::spd))
    out.domain = DomainReference(preprocessing.alignment, data, preprocessing.views,
                                 in_order(material.used.train), inputs);
  say(options, which + ": how far off its maps are, by records that it has not seen");
  FitOptions quiet = fit;
  quiet.quiet = true;
  std::size_t models = 0;
  out.uncertainty = fit_uncertainty(
      out, data, preprocessing.views, material.used, options.split,
      [&](const Split& part) {
        say(options, "  model " + std::to_string(++models) + " of a part of the records");
        return fit_model(data, material.with_others(part), preprocessing, wanted.name,
                         wanted.inputs, wanted.scaling, quiet);
      },
      enough_validation);
  return out;
}

TrainedModel train_split(const Dataset& data, const Split& split, const std::string& name,
                         const TrainOptions& options) {
  // The statements about the model are made for its use.
  Split used = split, fit_split = split;
  used.train = common(split.train, of_use(data, options));
  fit_split.train = weighted(data, split.train, options);
  // The other runs train with any part of the use's records.
  const auto with_others = [&](Split part) {
    Rows others = without(split.train, used.train);
    others.insert(others.end(), part.train.begin(), part.train.end());
    part.train = weighted(data, in_order(std::move(others)), options);
    return part;
  };
  const Material material{fit_split, used, with_others}, plain{split, used, with_others};
  const Scene scene = learn_scene(data.depth, fit_split.train, data.map);
  if (!scene.has_body() && !options.fit.quiet) std::fprintf(stderr, "%s\n", no_body);
  TrainedModel model;
  model.split = options.split;
  model.seen = seen_records(data, split);
  model.data_hash = data.hash;
  model.radar_response = widest_response(data);
  model.any_response = options.any_response;
  for (const Wanted& wanted : wanted_of(data, name, options)) {
    if (!model.estimators.empty() && interrupted()) break;
    const bool of_spd = wanted.inputs == Inputs::spd && !model.estimators.empty();
    Estimator one = train_one(wanted, data, of_spd ? plain : material, scene, options);
    if (!model.estimators.empty() && interrupted()) break;  // half trained
    model.estimators.push_back(std::move(one));
  }
  model->log.interrupted |= interrupted();
  return model;
}

Split split_of(const Dataset& data, const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  // Other models do not take the antennas' lags.
  const bool one_antenna = options.model != "auto" && !looks_at_body(options.model, options);
  SplitOptions how = options.split;
  if (data.sources.size() > 1) how.validate_on = of_use(data, options);
  if (inputs == Inputs::fused && !one_antenna && data.arrays_differ)
    say(options, "the runs differ in the radar's antennas: of the radar, the profile is taken");
  const TrainingRows rows = rows_to_train(data, one_antenna ? without_antennas(inputs) : inputs);
  if (!rows.left_out.empty()) say(options, rows.left_out);
  if (how.kind == "random" && how.test_share > 0)
    if (const std::string text = alike_neighbours(data, rows.rows); !text.empty())
      say(options, text);
  return make_split(rows.rows, how);
}

}  // namespace

TrainedModel train(const Dataset& data, const TrainOptions& options) {
  const Split split = split_of(data, options);
  const std::string name = options.model == "auto" ? choose(data, split, options) : options.model;
  TrainOptions with_weights = options;
  if (looks_at_body(name, options))
    with_weights.weights = weights_of(data, split, inputs_of(options.inputs), options);
  return train_split(data, split, name, with_weights);
}

}  // namespace echofuse::recon
