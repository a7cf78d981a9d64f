// SPDX-License-Identifier: MIT
#include "sim/cli/plan_arguments.hpp"

namespace echofuse::sim {

void add_plan_options(CLI::App& app, PlanArguments& a) {
  app.add_option("--config", a.config, "TOML file of settings");
  app.add_option("--set", a.settings, "key=value, over the file's")->allow_extra_args(false);
}

CLI::Option* add_twin_options(CLI::App& app, PlanArguments& a) {
  app.add_option("--laboratory", a.laboratory, "which of the twin's laboratories")
      ->check(CLI::NonNegativeNumber);
  return app.add_option("--twin", a.twin, "FILE of ranges that laboratories draw from, or default");
}

void read_plan(const PlanArguments& a, Plan& plan, Settings& settings) {
  bind(settings, plan);
  if (!a.config.empty()) settings.read_file(a.config);
  for (const auto& assignment : a.assignments()) settings.set(assignment);
  resolve_twin(settings, plan);
  validate(plan.conditions);
  if (plan.twin.empty()) return;
  if (plan.laboratories > 0)
    throw Error(ExitCode::config, "laboratories is for data sets; choose one: laboratory");
  plan.conditions = laboratories_of(plan).front();
  plan.twin.clear();
  plan.laboratory = 0;
}

}  // namespace echofuse::sim
