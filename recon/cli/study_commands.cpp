// SPDX-License-Identifier: MIT
#include <CLI/CLI.hpp>
#include <cstdio>

#include "drivers/program/command_line.hpp"
#include "drivers/program/printable.hpp"
#include "recon/cli/commands.hpp"
#include "recon/study/pareto.hpp"
#include "recon/study/stability.hpp"

namespace echofuse::recon {
namespace {

// A part leaves its file, which the same command without --part takes.
ExitCode part_done(const StudyOptions& options, const char* study) {
  if (!options.quiet)
    std::fprintf(stderr, "%s/%s-%s.csv: written\n", printable(options.out).c_str(), study,
                 options.part->name().c_str());
  return ExitCode::ok;
}

// The option is --part; part_of reads it, and throws Error(usage).
std::shared_ptr<std::string> add_part_option(CLI::App& app) {
  auto out = std::make_shared<std::string>();
  app.add_option("--part", *out, part_help);
  return out;
}
std::optional<JobPart> part_of(const std::string& text) {
  return text.empty() ? std::nullopt : std::optional(JobPart::of(text));
}

void add_common(CLI::App& app, StudyOptions& options) {
  app.add_option("--seeds", options.seeds, "trainings of each model")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
}

Command add_pareto(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<ParetoOptions>();
  const auto part = add_part_option(app);
  app.add_option("train", a->train, "run file to train on")->type_name("RUN")->required();
  app.add_option("test", a->test, "run file to judge by")->type_name("RUN")->required();
  app.add_option("--out", a->out, "folder for pareto.csv and pareto.html; goes on there")
      ->type_name("FOLDER")
      ->required();
  app.add_option("--models", a->models,
                 "as train --model; \":spd\", \":radar\" or \":fused-profile\" behind one")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->capture_default_str();
  app.add_option("--sweep-models", a->sweep_models, "of the sweeps")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->capture_default_str();
  app.add_option("--photons", a->photons, "shares of the photons to sweep")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(1e-9, 1.0))
      ->capture_default_str();
  app.add_option("--records", a->records, "shares of the training records to sweep")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(CLI::Range(1e-9, 1.0))
      ->capture_default_str();
  add_common(app, *a);
  const auto bound = std::make_shared<std::vector<double>>();
  app.add_option("--bound", *bound,
                 "to draw: lateral_error_m of `echofuse-sim study bound`, base; of pose,shape")
      ->delimiter(',')
      ->expected(2)
      ->check(CLI::PositiveNumber);
  more_options(app, {"--sweep-models", "--photons", "--records", "--bound", "--part"});
  add_examples(app, {"echofuse-recon study pareto scenes.sqlite fresh.sqlite --out pareto"});
  return [a, bound, part, &common] {
    a->part = part_of(*part);
    a->quiet = common.quiet;
    a->threads = common.threads;
    const auto rows = study_pareto(*a);
    if (a->part) return part_done(*a, "pareto");
    std::fputs(printable_lines(to_text(rows)).c_str(), stdout);
    write_pareto_page(rows, a->out, *bound);
    return ExitCode::ok;
  };
}

Command add_stability(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<StabilityOptions>();
  const auto part = add_part_option(app);
  app.add_option("--out", a->out, "folder for stability.csv and stability.html; goes on there")
      ->type_name("FOLDER")
      ->required();
  app.add_flag("--quick", a->quick,
               "fewer values of each axis, 1000 training and 300 test records, a narrower network");
  app.add_option(
         "--models", a->models,
         "as train --model; \":spd\", \":radar\" or \":fused-profile\" behind one; the first "
         "sorts the page")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--axes", a->axes, "some of them, as shifted-snr; a wrong one lists all")
      ->delimiter(',')
      ->allow_extra_args(false);
  app.add_option("--records", a->records, "training records; default: 3600")
      ->check(CLI::Range(20, 1'000'000));
  app.add_option("--test-records", a->test_records, "default: 1000")
      ->check(CLI::Range(10, 1'000'000));
  add_common(app, *a);
  app.add_option("--set", a->set, "key=value of the simulator, of the base condition")
      ->allow_extra_args(false);
  app.add_option("--sim", a->sim, "the simulator; default: echofuse-sim beside this program");
  more_options(app, {"--records", "--test-records", "--set", "--sim", "--part"});
  add_examples(app, {"echofuse-recon study stability --quick --out stability"});
  return [a, part, &common] {
    a->part = part_of(*part);
    StabilityOptions options = complete(*a);
    options.quiet = common.quiet;
    options.threads = common.threads;
    const auto rows = study_stability(options);
    if (a->part) return part_done(options, "stability");
    const auto results = summarise_stability(options, rows);
    std::fputs(to_text(results).c_str(), stdout);
    write_stability_page(options, results);
    return ExitCode::ok;
  };
}

}  // namespace

Command add_study(CLI::App& app, const Common& common) {
  app.require_subcommand(1);
  CLI::App* pareto =
      app.add_subcommand("pareto", "accuracy against the time of a map, photons and records");
  CLI::App* stability = app.add_subcommand("stability", "where models fail, on simulated records");
  for (CLI::App* sub : {pareto, stability}) sub->fallthrough();  // --threads, --quiet
  const Command run_pareto = add_pareto(*pareto, common);
  const Command run_stability = add_stability(*stability, common);
  return [=] { return pareto->parsed() ? run_pareto() : run_stability(); };
}

}  // namespace echofuse::recon
