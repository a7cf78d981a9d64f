// SPDX-License-Identifier: MIT
#include "sim/cli/fit_command.hpp"

#include <filesystem>
#include <iostream>
#include <memory>

#include "acquire/record/depth_map.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/atomic_write.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"
#include "sim/fit/fit.hpp"

namespace echofuse::sim {
namespace {

struct FitArguments : PlanArguments {
  FitOptions options;
  std::string run, out;
};

// What a run of `dataset` states of itself; the defaults for any other.
Plan stated_plan(const std::string& run) {
  try {
    return plan_of(run);
  } catch (const Error&) {
    return {};
  }
}

void take_axes(const record::RunReader& run, Conditions& c) {
  const auto spd = run.axis("spd"), radar = run.axis("radar");
  if (!spd || !radar)
    throw Error(ExitCode::failed, run.path() + ": has no axis of the " +
                                      (spd ? "radar" : "detector") + "; fit needs all sensors");
  c.bins = spd->count;
  c.first_bin_ps = spd->start;
  c.bin_width_ps = spd->step;
  c.radar_bins = radar->count;
  c.radar_start_m = radar->start;
  c.radar_step_m = radar->step;
  c.radar_antennas = 0;
  const auto axes = run.axes();
  const record::MapGrid grid = record::map_grid_of(axes);
  c.map_size = grid.size;
  c.map_half_tangent = grid.half_tangent;
}

ExitCode run_fit(FitArguments& a) {
  catch_interrupts();
  if (std::filesystem::exists(a.out))
    throw Error(ExitCode::failed, a.out + " is there already; nothing is overwritten");
  Plan plan = stated_plan(a.run);
  plan.twin.clear();
  plan.laboratory = plan.laboratories = 0;
  Settings settings;
  read_plan(a, plan, settings);
  const record::RunReader run(a.run);
  take_axes(run, plan.conditions);
  plan.conditions.background = "none";
  a.options.nominal = plan.conditions;
  std::vector<record::FusedRecord> records;
  run.for_each([&](const record::FusedRecord& r) {
    records.push_back(r);
    return true;
  });
  const Fit fit = fit_twin(records, a.options);
  std::cout << report_of(fit);
  write_atomically(a.out, twin_of(fit, std::filesystem::path(a.run).filename().string()));
  return ExitCode::ok;
}

}  // namespace

void add_fit(CLI::App& app, Command& command) {
  auto* sub = app.add_subcommand("fit", "what a run tells of its laboratory, as a twin's ranges");
  auto a = std::make_shared<FitArguments>();
  sub->add_option("RUN", a->run, "run file with depth maps and labels")->required();
  sub->add_option("--out", a->out, "TOML file of ranges to write (never overwritten)")->required();
  sub->add_option("--laboratories", a->options.laboratories, "simulated in each of two rounds")
      ->check(CLI::Range(std::int64_t{60}, std::int64_t{10'000}))
      ->capture_default_str();
  sub->add_option("--records", a->options.records, "of each, at most as many as the run has")
      ->check(CLI::Range(std::int64_t{20}, std::int64_t{100'000}))
      ->capture_default_str();
  add_plan_options(*sub, *a);
  sub->add_flag("-q,--quiet", a->options.quiet, "no progress");
  sub->callback([&command, a] { command = [a] { return run_fit(*a); }; });
}

}  // namespace echofuse::sim
