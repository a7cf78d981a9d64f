// SPDX-License-Identifier: MIT
#include "sim/cli/study_commands.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "sim/study/bound.hpp"
#include "sim/study/fidelity.hpp"

namespace echofuse::sim {
namespace {

template <class Options>
struct StudyArguments : PlanArguments {
  Options options;
  std::string out, part;
};

// A part leaves its files, which the same command without --part takes.
template <class Options>
ExitCode part_done(const StudyArguments<Options>& a) {
  if (!a.options.quiet)
    std::fprintf(stderr, "%s: %s is written\n", printable(a.out).c_str(),
                 a.options.parts.part->name().c_str());
  return ExitCode::ok;
}

ExitCode run_fidelity(StudyArguments<FidelityOptions>& a) {
  catch_interrupts();
  const auto rows = study_fidelity(a.options);
  if (a.options.parts.part) return part_done(a);
  for (const auto& r : rows)
    std::printf("%-14s %-12s %9.4f +- %.4f of the noise's variance%s\n", r.axis.c_str(),
                r.value.c_str(), r.error, r.standard_error,
                r.us > 0 ? ("  " + std::to_string(std::lround(r.us)) + " us").c_str() : "");
  std::printf("chosen: %lld rays for %g photons\n",
              static_cast<long long>(rays_of(a.options.conditions)),
              a.options.conditions.signal_photons);
  write_fidelity(rows, a.out);
  return ExitCode::ok;
}

ExitCode run_bound(StudyArguments<BoundOptions>& a) {
  catch_interrupts();
  const auto rows = study_bound(a.options);
  if (a.options.parts.part) return part_done(a);
  std::printf("%-12s %8s %-6s %32s %21s\n", "axis", "value", "known",
              "sigma of x: median (quartiles)", "mean error: x lateral");
  for (const auto& r : rows)
    std::printf("%-12s %8g %-6s %12.4f (%.4f .. %.4f) m %10.4f %7.4f m\n", r.axis.c_str(), r.value,
                r.known.c_str(), r.x_median_m, r.x_lower_m, r.x_upper_m, r.x_error_m,
                r.lateral_error_m);
  write_bound(rows, a.out);
  return ExitCode::ok;
}

template <class Options>
void add_one_study(CLI::App& study, Command& command, const std::string& name,
                   const std::string& what, ExitCode (*run)(StudyArguments<Options>&)) {
  auto* sub = study.add_subcommand(name, what);
  auto a = std::make_shared<StudyArguments<Options>>();
  sub->add_option("--out", a->out, "folder for " + name + ".csv")->required();
  sub->add_option("--scenes", a->options.scenes)
      ->check(CLI::Range(std::int64_t{2}, std::int64_t{10'000}))
      ->capture_default_str();
  sub->add_option("--seed", a->options.seed)->capture_default_str();
  sub->add_option("--part", a->part, part_help);
  add_plan_options(*sub, *a);
  sub->add_flag("-q,--quiet", a->options.quiet, "no progress");
  sub->callback([&command, a, run] {
    command = [a, run] {
      Plan plan;
      Settings settings;
      read_plan(*a, plan, settings);
      for (const char* key :
           {"seed", "people", "letters", "two_people", "empty", "objects", "scenes"})
        if (settings.given(key))
          throw Error(ExitCode::config, std::string(key) +
                                            ": a study draws its own scenes; --scenes says how "
                                            "many, --seed which");
      a->options.conditions = plan.conditions;
      auto& parts = a->options.parts;
      if (!a->part.empty()) parts.part = JobPart::of(a->part);
      parts.folder = a->out;
      parts.settings =
          "scenes of seed " + std::to_string(a->options.seed) + "\n" + settings.resolved();
      std::error_code error;
      std::filesystem::create_directories(a->out, error);
      if (error) throw Error(ExitCode::disk, a->out + ": " + error.message());
      return run(*a);
    };
  });
}

}  // namespace

void add_study(CLI::App& app, Command& command) {
  auto* study = app.add_subcommand("study", "how much detail a scene needs, and what it tells");
  study->require_subcommand(1);
  add_one_study(*study, command, "fidelity",
                "each approximation against a finer one, in units of noise, beside its time",
                run_fidelity);
  add_one_study(*study, command, "bound", "the least error of a lateral position that noise allows",
                run_bound);
}

}  // namespace echofuse::sim
