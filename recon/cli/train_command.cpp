// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <deque>
#include <filesystem>

#include "acquire/record/run_names.hpp"
#include "drivers/program/command_line.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/settings.hpp"
#include "recon/cli/commands.hpp"
#include "recon/cli/train_settings.hpp"
#include "recon/data/response.hpp"
#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"
#include "recon/train/tune.hpp"
#include "recon/use/empty_room.hpp"
#include "recon/use/predict.hpp"

namespace echofuse::recon {
namespace {

struct Arguments : TrainOptions {
  std::vector<std::string> runs, assignments, from;
  std::string out, empty;
};

// For CLI11 the answer is empty if the text names a model, else it says what is wrong.
std::string is_candidate(const std::string& text) {
  try {
    candidate_of(text, {});
    return {};
  } catch (const Error& error) {
    return error.what();
  }
}

// Refuses settings that the model of --from has fixed.
void check_from(const CLI::App& app, const std::vector<std::string>& assignments) {
  const auto refuse = [](const std::string& what) {
    throw Error(ExitCode::usage,
                what + " does not go with --from: the model that is tuned has settled it");
  };
  for (const char* option : {"--model", "--inputs", "--empty", "--epochs"})
    if (app.get_option(option)->count() > 0) refuse(option);
  for (const std::string& text : assignments)
    if (!text.starts_with("test_share=") && !text.starts_with("gap=") &&
        !text.starts_with("doubtful=") && !text.starts_with("lossy="))
      refuse("--set " + text);
}

Dataset load_runs(const Arguments& a) {
  Dataset data = load(a.runs);
  apply_doubts(data, a);
  return data;
}

TrainedModel tune_model(const Arguments& a, bool test_share_given) {
  std::deque<TrainedModel> models;
  for (const std::string& path : a.from) models.push_back(load_model(path));
  // Each model has the records as it wants them.
  const Dataset loaded = load_runs(a);
  Dataset own = loaded;
  bring_to_response(own, widest_response(own));
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
  // With so few records all are needed, and the table that chooses is a test already.
  options.split.validation_share = 0;
  if (!test_share_given) options.split.test_share = 0;
  options.tuning.seed = a.fit.seed, options.quiet = a.fit.quiet;
  TunedModel tuned = tune(starts, options);
  if (!a.fit.quiet)
    std::fprintf(
        stderr, "%s%s%s%s", tuned.left_out.c_str(), tuned.left_out.empty() ? "" : "\n",
        printable_lines(to_text(tuned)).c_str(),
        tuned.model->uncertainty
            ? ""
            : "not calibrated: fewer than 50 records do not say how far off the maps are\n");
  return std::move(tuned.model);
}

Dataset load_to_train(Arguments& a, double radar_bin_m) {
  Dataset data = load_runs(a);
  if (a.model.empty()) a.model = usual_model(inputs_of(a.inputs), data.zones.size());
  if (!a.empty.empty() && a.model != "auto" && !wants_alignment(candidate_of(a.model, {}).model))
    throw Error(ExitCode::usage, "--empty: " + a.model +
                                     " takes the records as they are; a factorised model or the "
                                     "mean-shape knows what stands still");
  if (!a.empty.empty() && radar_bin_m > 0)
    throw Error(ExitCode::usage, "--empty does not go with radar_bin_m: give runs of such bins");
  bring_to_response(data, widest_response(data));
  const std::string left_out = a.empty.empty() ? "" : state_empty_room(data, a.empty);
  if (!left_out.empty() && !a.fit.quiet) std::fprintf(stderr, "%s\n", left_out.c_str());
  if (radar_bin_m > 0) rebin_radar(data, radar_bins(radar_bin_m));
  return data;
}

// Makes a map of one record that the model was trained on, as reconstruct does.
void predict_one(const TrainedModel& model, const std::vector<std::string>& runs) {
  for (const std::string& run : runs) {
    const record::RunReader file(record::old_run(run));
    if (file.info().uuid != model.seen.runs[model.seen.run.front()]) continue;
    const std::int64_t index = model.seen.index.front();
    Dataset one = load_part(file, index, 1, sensors_of(model->features.inputs),
                            [](std::int64_t, const std::string&) {});
    if (one.size() == 0 || one.index[0] != index) continue;
    predict(model, prepare_records(model, std::move(one)).data, {0});
    return;
  }
}

constexpr std::ptrdiff_t least_records = 100;

}  // namespace

Command add_train(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  a->model.clear();
  app.add_option("run", a->runs, "run files whose axes agree")->type_name("RUN")->required();
  app.add_option("--out", a->out, "model file to write")->type_name("MODEL")->required();
  app.add_option("--model", a->model,
                 model_help() +
                     ", or auto: the cheapest within one standard error of the best; default: " +
                     usual_model(Inputs::fused) + " of both sensors or zones, " +
                     usual_model(Inputs::spd) + " of one sensor")
      ->check([](const std::string& text) { return text == "auto" ? "" : is_candidate(text); });
  app.add_option(
         "--from", a->from,
         "a model file, of another room: tune it to these records (10 and more), as far "
         "as a cross-validation among them says; of several the one from which it comes out "
         "best")
      ->type_name("MODEL")
      ->allow_extra_args(false);
  app.add_option("--empty", a->empty,
                 "a run of nobody in the same room: models that look at the body take its mean as "
                 "what stands still, and can be taken to other rooms (reconstruct --empty)")
      ->type_name("RUN");
  app.add_option("--epochs", a->fit.epochs, "default: 60 (mlp), 100 (factorised)")
      ->check(CLI::Range(1, 100000));
  add_split_options(app, *a, a->assignments);
  app.add_flag_callback(
      "--settings",
      [] {
        std::fputs(train_settings_help().c_str(), stdout);
        throw CLI::Success();
      },
      "print every setting with its meaning, range and default");
  more_options(app, {"--empty", "--inputs", "--epochs", "--seed", "--set", "--settings"});
  add_examples(app,
               {"echofuse-recon train scenes.sqlite --out fused.safetensors",
                "echofuse-recon train monday.sqlite --split blocked --out fused.safetensors",
                "echofuse-recon train new.sqlite --from old.safetensors --out new.safetensors"},
               "3 config, 6 disk, 130 interrupted");
  a->fallback = true;
  return [a, &app, &common] {
    a->split.seed = a->fit.seed;
    a->fit.quiet = common.quiet;
    const bool tuning = !a->from.empty();
    if (tuning) check_from(app, a->assignments);
    TrainSettings settings(*a);
    take(a->assignments, settings);
    check_can_save(a->out);
    const TrainedModel model = tuning ? tune_model(*a, settings.test_share_given)
                                      : train(load_to_train(*a, settings.radar_bin_m), *a);
    save_model(model, a->out, [&](const TrainedModel& written) { predict_one(written, a->runs); });
    const auto trained =
        std::ranges::count(model.seen.part, static_cast<std::uint8_t>(Part::train));
    if (!tuning && trained < least_records)
      std::fprintf(stderr, "%s: trained on %td records only; a model needs about a thousand\n",
                   a->out.c_str(), trained);
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
