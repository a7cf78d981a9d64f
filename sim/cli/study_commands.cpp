// SPDX-License-Identifier: MIT
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "drivers/program/command_line.hpp"
#include "drivers/program/console.hpp"
#include "sim/cli/plan_arguments.hpp"
#include "sim/study/bound.hpp"
#include "sim/study/fidelity.hpp"

namespace echofuse::sim {
namespace {

struct StudyArguments : PlanArguments {
  std::string out;
  std::optional<std::int64_t> scenes;  // each study has its own default
  std::uint64_t seed = 1;
};

ExitCode run_fidelity(const FidelityOptions& options, const std::string& folder) {
  const auto rows = study_fidelity(options);
  for (const auto& r : rows)
    std::printf("%-14s %-12s %9.4f +- %.4f of the noise's variance%s\n", r.axis.c_str(),
                r.value.c_str(), r.error, r.standard_error,
                r.us > 0 ? ("  " + std::to_string(std::lround(r.us)) + " us").c_str() : "");
  std::printf("chosen: %lld rays for %g photons\n",
              static_cast<long long>(rays_of(options.conditions)),
              options.conditions.signal_photons);
  write_fidelity(rows, folder);
  return ExitCode::ok;
}

ExitCode run_bound(const BoundOptions& options, const std::string& folder) {
  const auto rows = study_bound(options);
  std::printf("%-12s %8s %-6s %32s %21s\n", "axis", "value", "known",
              "sigma of x: median (quartiles)", "mean error: x lateral");
  for (const auto& r : rows)
    std::printf("%-12s %8g %-6s %12.4f (%.4f .. %.4f) m %10.4f %7.4f m\n", r.axis.c_str(), r.value,
                r.known.c_str(), r.x_median_m, r.x_lower_m, r.x_upper_m, r.x_error_m,
                r.lateral_error_m);
  write_bound(rows, folder);
  return ExitCode::ok;
}

template <class Options>
void add_one_study(CLI::App& study, Command& command, const std::string& name,
                   const std::string& what, const std::string& example,
                   const std::shared_ptr<StudyArguments>& a,
                   ExitCode (*run)(const Options&, const std::string& folder)) {
  CLI::App* sub = study.add_subcommand(name, what);
  add_examples(*sub, {example.c_str()});
  sub->callback([&command, a, run] {
    command = [a, run](bool quiet) {
      catch_interrupts();
      Plan plan;
      Settings settings;
      read_plan(*a, plan, settings);
      for (const char* key :
           {"seed", "people", "letters", "two_people", "empty", "objects", "scenes"})
        if (settings.given(key))
          throw Error(ExitCode::config, std::string(key) +
                                            ": a study draws its own scenes; --scenes says how "
                                            "many, --seed which");
      Options options;
      options.conditions = plan.conditions;
      options.scenes = a->scenes.value_or(options.scenes);
      options.seed = a->seed, options.quiet = quiet;
      std::error_code error;
      std::filesystem::create_directories(a->out, error);
      if (error) throw Error(ExitCode::disk, a->out + ": " + error.message());
      return run(options, a->out);
    };
  });
}

}  // namespace

void add_study(CLI::App& app, Command& command) {
  auto* study = app.add_subcommand("study", "how much detail a scene needs, and what it tells");
  study->require_subcommand(1);
  const auto a = std::make_shared<StudyArguments>();
  study->add_option("--out", a->out, "folder for the study's table")
      ->type_name("FOLDER")
      ->required();
  study->add_option("--scenes", a->scenes, "default: 40 of fidelity, 100 of bound")
      ->check(CLI::Range(std::int64_t{2}, std::int64_t{10'000}));
  study->add_option("--seed", a->seed, "of the scenes and the noise")->capture_default_str();
  add_plan_options(*study, *a);
  add_one_study(*study, command, "fidelity",
                "each approximation against a finer one, in units of noise, beside its time",
                "echofuse-sim study fidelity --out fidelity", a, run_fidelity);
  add_one_study(*study, command, "bound", "the least error of a lateral position that noise allows",
                "echofuse-sim study bound --out bound", a, run_bound);
}

}  // namespace echofuse::sim
