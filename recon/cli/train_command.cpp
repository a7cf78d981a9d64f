// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <cstdio>

#include "drivers/core/console.hpp"
#include "recon/cli/commands.hpp"
#include "recon/cli/options.hpp"
#include "recon/data/augment.hpp"
#include "recon/estimator/crossvalidate.hpp"
#include "recon/estimator/empty_room.hpp"
#include "recon/estimator/train.hpp"
#include "recon/estimator/tune.hpp"

namespace echofuse::recon {
namespace {

struct Arguments : TrainOptions {
  std::vector<std::string> runs;
  std::string out, from, empty;
  double radar_bin_m = 0;
  std::vector<std::size_t> validate_on_runs;  // counted from 1
  bool force = false;
};

// What the model of --from has settled.
constexpr const char* settled[] = {"--model",
                                   "--candidates",
                                   "--radar-bin",
                                   "--scaling",
                                   "--hidden",
                                   "--basis",
                                   "--epochs",
                                   "--batch",
                                   "--learning-rate",
                                   "--weight-decay",
                                   "--patience",
                                   "--augment",
                                   "--validation-share",
                                   "--weight",
                                   "--validate-on",
                                   "--inputs",
                                   "--empty"};

void check_from(const CLI::App& app) {
  for (const char* option : settled)
    if (app.get_option(option)->count() > 0)
      throw Error(
          ExitCode::usage,
          std::string(option) + " does not go with --from: the model that is tuned has settled it");
}

TrainedModel tune_model(const CLI::App& app, const Arguments& a) {
  const TrainedModel from = load_model(a.from);
  Dataset data = load(a.runs);
  match_for_tuning(from, a.from, data);
  TuneOptions options;
  options.split = a.split;
  // So few records are all needed, and the table that chooses is a judgement already.
  options.split.validation_share = 0;
  if (app.get_option("--test-share")->count() == 0) options.split.test_share = 0;
  options.tuning.seed = a.fit.seed;
  TunedModel tuned = tune(from, data, options);
  if (!a.fit.quiet)
    std::fprintf(
        stderr, "%s%s", to_text(tuned).c_str(),
        tuned.model->uncertainty
            ? ""
            : "not calibrated: fewer than 50 records do not say how far off the maps are\n");
  return std::move(tuned.model);
}

Dataset load_to_train(Arguments& a) {
  Dataset data = load(a.runs);
  if (!a.empty.empty() && a.radar_bin_m > 0)
    throw Error(ExitCode::usage, "--empty does not go with --radar-bin: give runs of such bins");
  if (!a.empty.empty()) state_empty_room(data, a.empty);
  a.validate_on.clear();
  if (a.validate_on_runs.empty()) a.validate_on = {data.sources.size() - 1};
  for (const std::size_t run : a.validate_on_runs) a.validate_on.push_back(run - 1);
  if (a.radar_bin_m > 0) rebin_radar(data, radar_bins(a.radar_bin_m));
  return data;
}

}  // namespace

Command add_train(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  a->model.clear();
  app.add_option("run", a->runs, "run files whose axes agree")->required();
  app.add_option("--out", a->out, "model file to write")->required();
  app.add_option("--model", a->model,
                 model_help() +
                     ", or auto: the cheapest within one standard error of the best; default: " +
                     usual_model(Inputs::fused) + " of both sensors, " + usual_model(Inputs::spd) +
                     " of one")
      ->check([](const std::string& text) { return text == "auto" ? "" : is_candidate(text); });
  app.add_option("--candidates", a->candidates, "auto: the models to try")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(is_candidate);
  app.add_option("--from", a->from,
                 "a model file, of another room: tune it to these records (10 and more), as far "
                 "as a cross-validation among them says");
  app.add_option("--empty", a->empty,
                 "a run of nobody in the same room: models that look at the body take its mean as "
                 "what stands still, and can be taken to other rooms (reconstruct --empty)");
  add_inputs_option(app, a->inputs);
  app.add_option(
         "--radar-bin", a->radar_bin_m,
         "add up the radar's power in bins of so many metres from 0 to 7 m (the paper: 0.5), "
         "without its antennas")
      ->check(CLI::Range(0.01, 3.5));
  add_fit_options(app, a->scaling, a->fit);
  app.add_option("--patience", a->fit.patience,
                 "epochs without progress before stopping; default: 15 (mlp), 100 (factorised)")
      ->check(CLI::Range(1, 100000));
  app.add_option("--seed", a->fit.seed, "of weights, order and random split")
      ->capture_default_str();
  app.add_option("--split", a->split.kind, "random, or blocked for sequences")
      ->check(CLI::IsMember({"random", "blocked"}))
      ->capture_default_str();
  app.add_option("--test-share", a->split.test_share, "held out for evaluate")
      ->check(CLI::Range(0.0, 0.95))
      ->capture_default_str();
  app.add_option("--validation-share", a->split.validation_share, "of the rest, to stop early")
      ->check(CLI::Range(0.0, 0.95))
      ->capture_default_str();
  app.add_option("--gap", a->split.gap, "blocked: records dropped between two parts")
      ->check(CLI::Range(0, 1'000'000))
      ->capture_default_str();
  app.add_option("--weight", a->weights,
                 "how often each run's records count, one number a run (the parts of a data set "
                 "are one); default: once, but if the runs "
                 "that stand for the use are unlike the others: as half of these")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(0.0, 1000.0));
  app.add_option("--validate-on", a->validate_on_runs,
                 "the runs that stand for the use, 1 for the first (the parts of a data set are "
                 "one): they give the validation records; default: the last")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(1, 10000));
  app.add_option("--augment", a->augment,
                 "train on perturbed copies of the records, too: noise (of the radar, down to 10 "
                 "dB); auto chooses without them")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::IsMember(augment_names));
  app.add_flag("--force", a->force, "replace the model that OUT is");
  a->fallback = true;
  app.add_flag("!--no-fallback", a->fallback,
               "train no network beside a fused model for records whose radar is lost");
  return [a, &app, &common] {
    a->split.seed = a->fit.seed;
    a->fit.quiet = common.quiet;
    const bool tuning = !a->from.empty();
    if (tuning) check_from(app);
    if (a->model.empty()) a->model = usual_model(inputs_of(a->inputs));
    if (!a->empty.empty() && a->model != "auto" &&
        !wants_alignment(candidate_of(a->model, {}).model))
      throw Error(ExitCode::usage, "--empty: " + a->model +
                                       " takes the records as they are; a factorised model or the "
                                       "silhouette knows what stands still");
    if (a->fit.hidden && a->model != "auto" &&
        kind_of(candidate_of(a->model, {}).model).size != ModelKind::Size::hidden)
      throw Error(ExitCode::usage,
                  "--hidden: " + a->model + " has no such layers; mlp and pca-mlp have");
    const Existing existing = a->force ? Existing::replace : Existing::keep;
    check_can_save(a->out, existing);
    const TrainedModel model = tuning ? tune_model(app, *a) : train(load_to_train(*a), *a);
    save_model(model, a->out, existing);
    if (!common.quiet)
      std::fprintf(stderr, "%s: %s on %s, trained in %.1f s%s%s\n", a->out.c_str(),
                   model->name.c_str(), name_of(model->features.inputs).c_str(), model.train_s(),
                   model->log.best_epoch > 0 || model->log.loss.empty()
                       ? ""
                       : "; never better than the mean map",
                   model->log.interrupted ? "; the best so far" : "");
    return model->log.interrupted ? ExitCode::interrupted : ExitCode::ok;
  };
}

}  // namespace echofuse::recon
