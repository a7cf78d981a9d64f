// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <deque>
#include <filesystem>

#include "acquire/record/run_names.hpp"
#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/settings.hpp"
#include "recon/cli/commands.hpp"
#include "recon/cli/train_settings.hpp"
#include "recon/data/late_truth.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/metrics/mirrored_camera.hpp"
#include "recon/predict/empty_room.hpp"
#include "recon/predict/predict.hpp"
#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"
#include "recon/train/tune.hpp"

namespace echofuse::recon {
namespace {

struct Arguments : TrainOptions {
  std::vector<std::string> runs, assignments, from;
  std::string out, empty;
};

// CLI11 validator. Returns an empty string if `text` is a valid model name, otherwise an error
// message.
std::string is_candidate(const std::string& text) {
  try {
    candidate_of(text, {});
    return {};
  } catch (const Error& error) {
    return error.what();
  }
}

// Throws Error(usage) if --from is combined with an option that is already fixed by the start
// model.
void check_from(const CLI::App& app, const std::vector<std::string>& assignments) {
  const auto refuse = [](const std::string& what) {
    throw Error(
        ExitCode::usage,
        what + " cannot be combined with --from, because the start model defines the value");
  };
  for (const char* option : {"--model", "--inputs", "--empty", "--epochs"})
    if (app.get_option(option)->count() > 0) refuse(option);
  for (const std::string& text : assignments)
    if (!text.starts_with("test_share=") && !text.starts_with("gap=") &&
        !text.starts_with("doubtful=") && !text.starts_with("lossy=") &&
        !text.starts_with("mirrored="))
      refuse("--set " + text);
}

Dataset load_runs(const Arguments& a) {
  Dataset data = load(a.runs);
  apply_doubts(data, a);
  if (a.mirrored == "refuse")
    if (const std::string why = mirrored_camera(data); !why.empty())
      throw Error(ExitCode::failed, why + "; --set mirrored=take uses the maps as they are");
  if (const std::string text = a.fit.quiet ? "" : late_truth(data); !text.empty())
    std::fprintf(stderr, "%s\n", text.c_str());
  return data;
}

TrainedModel tune_model(const Arguments& a, bool test_share_given) {
  std::deque<TrainedModel> models;
  for (const std::string& path : a.from) models.push_back(load_model(path));
  // Converts the records for each start model separately, because the axes of the models may
  // differ.
  const Dataset loaded = load_runs(a);
  Dataset own = loaded;
  ModelResponse(own).convert(own);
  std::deque<Dataset> tables;
  std::vector<Start> starts;
  for (const std::string& path : a.from) {
    const TrainedModel& model = models[starts.size()];
    Dataset& data = tables.emplace_back(loaded);
    match_for_tuning(model, path, data);
    starts.push_back({model, data, own, std::filesystem::path(path).stem()});
  }
  TuneOptions options;
  options.split = a.split;
  // Keeps no validation records, because the fine-tuning penalty is chosen by cross-validation. All
  // records are then available for fine-tuning.
  options.split.validation_share = 0;
  if (!test_share_given) options.split.test_share = 0;
  options.tuning.seed = a.fit.seed, options.quiet = a.fit.quiet;
  TunedModel tuned = tune(starts, options);
  if (!a.fit.quiet)
    std::fprintf(stderr, "%s%s%s%s", tuned.left_out.c_str(), tuned.left_out.empty() ? "" : "\n",
                 printable_lines(to_text(tuned)).c_str(),
                 tuned.model.first().uncertainty
                     ? ""
                     : "not calibrated: at least 50 records are needed to "
                       "estimate the errors of the maps\n");
  return std::move(tuned.model);
}

Dataset load_to_train(Arguments& a, double radar_bin_m) {
  Dataset data = load_runs(a);
  if (a.model.empty()) a.model = usual_model(shows_sides(data, inputs_of(a.inputs)));
  if (!a.empty.empty() && a.model != "auto" && !wants_alignment(candidate_of(a.model, {}).model))
    throw Error(ExitCode::usage, "--empty: " + a.model +
                                     " does not use a background; use a factorised or mean-shape "
                                     "model");
  if (!a.empty.empty() && radar_bin_m > 0)
    throw Error(ExitCode::usage,
                "--empty cannot be combined with radar_bin_m; use runs that were recorded with "
                "wide radar bins");
  ModelResponse(data).convert(data);
  if (!a.empty.empty()) {
    EmptyRoom room = load_empty_room(data, a.empty);
    if (!room.left_out.empty() && !a.fit.quiet) std::fprintf(stderr, "%s\n", room.left_out.c_str());
    a.background = std::move(room.records);
  }
  if (radar_bin_m > 0) rebin_radar(data, radar_bins(radar_bin_m));
  return data;
}

// Predicts the map of one training record, to check that the written model file works.
void predict_one(const TrainedModel& model, const std::vector<std::string>& runs) {
  for (const std::string& run : runs) {
    const record::RunReader file(record::old_run(run));
    if (file.info().uuid != model.training.runs[model.training.run.front()]) continue;
    const std::int64_t index = model.training.index.front();
    Dataset one = load_part(file, index, 1, sensors_of(model.first().features.inputs),
                            [](std::int64_t, const std::string&) {});
    if (one.size() == 0 || one.records[0].index != index) continue;
    predict(model, prepare_records(model, std::move(one)).data, {0});
    return;
  }
}

constexpr std::ptrdiff_t min_records = 100;

ExitCode train_and_save(Arguments& a, const CLI::App& app, const Common& common) {
  a.split.seed = a.fit.seed;
  a.fit.quiet = common.quiet;
  const bool tuning = !a.from.empty();
  if (tuning) check_from(app, a.assignments);
  TrainSettings settings(a);
  take(a.assignments, settings);
  check_can_save(a.out);
  const TrainedModel model = tuning ? tune_model(a, settings.test_share_given)
                                    : train(load_to_train(a, settings.radar_bin_m), a);
  save_model(model, a.out, [&](const TrainedModel& written) { predict_one(written, a.runs); });
  const auto trained =
      std::ranges::count(model.training.part, static_cast<std::uint8_t>(Subset::train));
  if (!tuning && trained < min_records)
    std::fprintf(stderr, "%s: trained on only %td records; about 1000 are recommended\n",
                 a.out.c_str(), trained);
  if (!common.quiet)
    std::fprintf(stderr, "%s: model %s, inputs %s, trained in %.1f s%s%s\n", a.out.c_str(),
                 model.first().name.c_str(), name_of(model.first().features.inputs).c_str(),
                 model.train_s(),
                 model.first().log.best_epoch > 0 || model.first().log.loss.empty()
                     ? ""
                     : "; the network was never better than a prediction of the mean map",
                 model.first().log.interrupted ? "; interrupted, saved the best epoch so far" : "");
  return model.first().log.interrupted ? ExitCode::interrupted : ExitCode::ok;
}

}  // namespace

Command add_train(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  a->model.clear();
  app.add_option("run", a->runs, "run files for the training; all runs must have the same axes")
      ->type_name("RUN")
      ->required();
  app.add_option("--out", a->out, "model file to write")->type_name("MODEL")->required();
  app.add_option(
         "--model", a->model,
         "kind of model, one of: " + model_help() +
             ", or auto (the cheapest model within one standard error of the best model); N is the "
             "number of components, of units in a hidden layer, or of neighbours; default: " +
             usual_model(true) + " if the runs have " + needs_of_sides + "; otherwise " +
             usual_model(false))
      ->check([](const std::string& text) { return text == "auto" ? "" : is_candidate(text); });
  app.add_option("--from", a->from,
                 "fine-tune this model on the given runs, e.g. for a new room; at least 10 records "
                 "are needed; cross-validation chooses how much the weights may change; may be "
                 "repeated: the model with the best result is kept")
      ->type_name("MODEL")
      ->allow_extra_args(false);
  app.add_option("--empty", a->empty,
                 "run recorded in the empty training room; with this option, the trained model can "
                 "be adapted to other rooms (reconstruct --empty)")
      ->type_name("RUN");
  app.add_option("--epochs", a->fit.epochs,
                 "maximum number of epochs; default: 30 to 100, depending on --model")
      ->check(CLI::Range(1, 100000));
  add_split_options(app, *a, a->assignments);
  app.add_flag_callback(
      "--settings",
      [] {
        std::fputs(train_settings_help().c_str(), stdout);
        throw CLI::Success();
      },
      "print every setting with its meaning, range and default value, then exit");
  more_options(app, {"--empty", "--inputs", "--epochs", "--seed", "--set", "--settings"});
  add_examples(app,
               {"echofuse-recon train scenes.sqlite --out fused.safetensors",
                "echofuse-recon train monday.sqlite --split blocked --out fused.safetensors",
                "echofuse-recon train new.sqlite --from old.safetensors --out new.safetensors"},
               "3 config, 6 disk, 130 interrupted");
  a->fallback = true;
  return [a, &app, &common] { return train_and_save(*a, app, common); };
}

}  // namespace echofuse::recon
