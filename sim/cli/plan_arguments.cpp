// SPDX-License-Identifier: MIT
#include "sim/cli/plan_arguments.hpp"

#include <toml++/toml.h>

#include <cstdio>

#include "acquire/measurement/response.hpp"

namespace echofuse::sim {

std::vector<std::string> settings_like(const std::string& path) try {
  std::vector<std::pair<std::string, std::string>> stated;
  const toml::table file = toml::parse(read_config_text(path), path);
  if (const toml::table* section = file["response"].as_table())
    for (const auto& [key, value] : *section)
      stated.emplace_back(std::string(key.str()), value.value<std::string>().value_or(""));
  const record::Response response = record::response_of(stated);
  std::vector<std::string> out;
  for (const auto& [key, text] : response.meta()) {
    const std::string number = text.substr(0, text.find(" +-"));
    if (key.starts_with("irf_")) out.push_back(key + "=" + number);
    if (key == "radar_cell_m") out.push_back("radar_resolution_m=" + number);
    if (key == "radar_taps") out.push_back(key + "=" + number);
  }
  if (out.empty())
    throw Error(ExitCode::config,
                path + ": states no response; expected a file of echofuse-acquire calibrate");
  if (const toml::table* axes = file["axes"].as_table())
    for (const auto& [key, value] : *axes) {
      char number[40];
      std::snprintf(number, sizeof number, "=%.17g", value.value_or(0.0));
      out.push_back(std::string(key.str()) + number);
    }
  return out;
} catch (const toml::parse_error& e) {
  throw Error(ExitCode::config, path + ": not TOML: " + std::string(e.description()));
}

void add_plan_options(CLI::App& app, PlanArguments& a) {
  app.add_option("--config", a.config, "TOML file of settings")->type_name("FILE");
  app.add_option("--set", a.settings, "over the file's")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

CLI::Option* add_twin_options(CLI::App& app, PlanArguments& a) {
  app.add_option("--laboratory", a.laboratory, "which of the twin's laboratories")
      ->check(CLI::NonNegativeNumber);
  return app.add_option("--twin", a.twin, "FILE of ranges that laboratories draw from, or default")
      ->type_name("FILE");
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
