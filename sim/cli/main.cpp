// SPDX-License-Identifier: MIT
// The program echofuse-sim simulates data sets, and laboratories with devices. Each add_...
// function defines one subcommand and sets the function that runs it.
#include <toml++/toml.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <functional>
#include <iostream>
#include <nlohmann/json.hpp>
#include <optional>

#include "acquire/measurement/response.hpp"
#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/lab/lab.hpp"
#include "sim/twin/twin.hpp"

namespace {

using namespace echofuse;
using Command = std::function<ExitCode(bool quiet)>;

// Returns the instrument response, the axes and the baseline stored in a calibration file as
// KEY=VALUE settings. Throws Error(config) if the file contains no response.
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
    throw Error(ExitCode::config, path +
                                      ": contains no instrument response; expected a file written "
                                      "by `echofuse-acquire calibrate`");
  const auto add = [&](std::string_view key, double value) {
    out.push_back(std::string(key) + format("=%.17g", value));
  };
  if (const auto baseline_m = file["radar"]["baseline_m"].value<double>())
    add("baseline_m", *baseline_m);
  if (const toml::table* axes = file["axes"].as_table())
    for (const auto& [key, value] : *axes) add(key.str(), value.value_or(0.0));
  return out;
} catch (const toml::parse_error& e) {
  throw Error(ExitCode::config, path + ": not TOML: " + std::string(e.description()));
}

// Command-line arguments that set the values of a sim::Plan: --config, --like and --set.
struct PlanArguments {
  std::string config, like;
  std::vector<std::string> settings;

  std::vector<std::string> assignments() const {
    std::vector<std::string> all = like.empty() ? std::vector<std::string>{} : settings_like(like);
    all.insert(all.end(), settings.begin(), settings.end());
    return all;
  }
};

void add_plan_options(CLI::App& app, PlanArguments& a) {
  app.add_option("--config", a.config, "TOML file of simulator settings")->type_name("FILE");
  app.add_option(
         "--set", a.settings,
         "override a simulator setting; `echofuse-sim config` lists all settings; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

// Reads the settings into `plan`. If the plan has a twin, replaces its conditions with those
// sampled for the selected laboratory. Throws Error(config) if the plan has several laboratories.
void read_plan(const PlanArguments& a, sim::Plan& plan, Settings& settings) {
  bind(settings, plan);
  if (!a.config.empty()) settings.read_file(a.config);
  for (const auto& assignment : a.assignments()) settings.set(assignment);
  resolve_twin(settings, plan);
  validate(plan.conditions);
  if (plan.twin.empty()) return;
  if (plan.laboratories > 0)
    throw Error(
        ExitCode::config,
        "setting `laboratories` is valid only for data sets; set `laboratory` to select one");
  plan.conditions = sim::laboratories_of(plan).front();
  plan.twin.clear();
  plan.laboratory = 0;
}

struct DatasetArguments : PlanArguments {
  sim::DatasetOptions options;
  std::string part;
  std::optional<std::int64_t> records, people, letters, two_people, empty, objects, seed;
};

// If the command line contains record counts, replaces all record counts of the plan. Throws
// Error(usage) if the counts contradict each other or are all 0.
void apply_counts(const DatasetArguments& a, sim::Plan& plan) {
  const bool by_kind = a.people || a.letters || a.two_people || a.empty || a.objects;
  if (!plan.scenes.empty() && (by_kind || a.records))
    throw Error(ExitCode::usage,
                "the scene list " + plan.scenes +
                    " determines the records; remove the record counts from the command line");
  if (by_kind) {
    plan.people = a.people.value_or(0);
    plan.letters = a.letters.value_or(0);
    plan.two_people = a.two_people.value_or(0);
    plan.empty = a.empty.value_or(0);
    plan.objects = a.objects.value_or(0);
  } else if (a.records) {
    plan.people = *a.records / 4;
    plan.letters = *a.records - plan.people;
    plan.two_people = plan.empty = plan.objects = 0;
  }
  const auto count = static_cast<std::int64_t>(scenes_of(plan).size());
  if (a.records && *a.records != count)
    throw Error(ExitCode::usage, "--records " + std::to_string(*a.records) + " differs from " +
                                     std::to_string(count) +
                                     ", the sum of the other record counts");
  if (count == 0)
    throw Error(ExitCode::usage, "no records requested; set at least one record count above 0");
}

sim::Plan make_plan(DatasetArguments& a) {
  sim::Plan plan;
  Settings settings;
  bind(settings, plan);
  if (!a.config.empty()) {
    a.options.config_text = read_config_text(a.config);
    settings.read_text(a.options.config_text, a.config);
  }
  for (const auto& assignment : a.assignments()) settings.set(assignment);
  resolve_twin(settings, plan);
  if (a.seed) plan.seed = *a.seed;
  apply_counts(a, plan);
  return plan;
}

ExitCode run_dataset(DatasetArguments& a) {
  using SteadyClock = std::chrono::steady_clock;
  catch_interrupts();
  const sim::Plan plan = make_plan(a);
  const auto start = SteadyClock::now();
  if (!a.part.empty()) a.options.part = JobPart::of(a.part);
  const std::int64_t written = sim::write_dataset(plan, a.options);
  const double seconds = std::chrono::duration<double>(SteadyClock::now() - start).count();
  if (!a.options.quiet)
    std::cout << printable(a.options.out) << ": " << written << " records in "
              << human_duration(seconds) << "\n";
  if (!a.options.quiet && plan.objects > 0) std::cout << object_text(plan.conditions) << "\n";
  const auto all = static_cast<std::int64_t>(scenes_of(plan).size());
  const std::int64_t expected = a.options.part ? a.options.part->range(all).size() : all;
  return written == expected ? ExitCode::ok : ExitCode::interrupted;
}

void add_dataset(CLI::App& app, Command& command) {
  auto* sub = app.add_subcommand("dataset", "create a run file of simulated records");
  auto a = std::make_shared<DatasetArguments>();
  a->options.threads = static_cast<int>(usable_cores());
  const auto count = CLI::Range(std::int64_t{0}, std::int64_t{10'000'000});
  sub->add_option("--out", a->options.out,
                  "run file to create; an existing file is not overwritten")
      ->type_name("RUN")
      ->required();
  const sim::Plan plan;
  sub->add_option("--records", a->records,
                  "number of records (default: " + std::to_string(plan.people + plan.letters) +
                      "); a quarter of them show one person, the others a person holding a letter")
      ->check(count);
  sub->add_option("--people", a->people, "number of records that show one person")->check(count);
  sub->add_option("--letters", a->letters, "number of records that show a person holding a letter")
      ->check(count);
  sub->add_option("--two-people", a->two_people, "number of records that show two people")
      ->check(count);
  sub->add_option("--empty", a->empty,
                  "number of empty-room records; set background_counts for training")
      ->check(count);
  sub->add_option("--objects", a->objects,
                  "number of records that show the object; --set object=FILE names its OBJ file")
      ->check(count);
  sub->add_option("--seed", a->seed, "random seed; default: " + std::to_string(plan.seed))
      ->check(CLI::Range(0.0, max_seed));
  add_plan_options(*sub, *a);
  sub->add_option("--like", a->like,
                  "simulate the instrument response, axes and baseline of this calibration file")
      ->type_name("FILE");
  sub->add_option("--part", a->part, part_help);
  more_options(*sub, {"--config", "--like", "--part"});
  add_examples(*sub,
               {"echofuse-sim dataset --out scenes.sqlite --records 1000",
                "echofuse-sim dataset --out empty.sqlite --empty 20 --set background_counts=200"},
               "3 config, 6 disk, 130 interrupted");
  sub->callback([&command, a] {
    command = [a](bool quiet) {
      a->options.quiet = quiet;
      return run_dataset(*a);
    };
  });
}

struct LabArguments : PlanArguments {
  sim::LabOptions options;
  // program to run while the laboratory is in operation, and its arguments
  std::vector<std::string> command;
};

void print_sent(const std::string& sent) {
  const auto all = nlohmann::ordered_json::parse(sent);
  for (const char* device : {"tdc", "radar", "depth"}) {
    std::cout << device << " sent:";
    for (const auto& [what, count] : all[device].items()) std::cout << " " << what << " " << count;
    std::cout << "\n";
  }
}

ExitCode run_lab(LabArguments& a, bool quiet) {
  catch_interrupts();
  sim::Plan plan;
  Settings settings;
  read_plan(a, plan, settings);
  // Adds depth noise by default, because a real camera never returns the same image twice.
  if (!settings.given("depth_noise_m") && plan.conditions.depth_noise_m == 0)
    plan.conditions.depth_noise_m = 0.0005;
  if (!settings.given("radar_psf")) plan.conditions.radar_psf = a.options.conditions.radar_psf;
  a.options.conditions = plan.conditions;
  if (!plan.scenes.empty()) {
    a.options.schedule.list = scenes_of(plan);
    a.options.schedule.kind = plan.scenes;
  }
  if (a.options.schedule.kind == "object")
    plan.objects = 1, scenes_of(plan);  // throws Error(config) if no mesh is set
  if (!quiet && plan.objects > 0) std::cerr << object_text(plan.conditions) << "\n";
  a.options.schedule.seed = plan.seed;
  port::SystemLoop loop;
  sim::Lab lab(loop, a.options);
  if (!a.command.empty()) return sim::serve_command(lab, a.command, quiet);
  if (!quiet)
    std::cerr << "the laboratory is running; press Ctrl-C to stop it. To record from it, run:\n";
  std::cout << lab.daemon_command() << std::endl;
  lab.serve(interrupted);
  print_sent(lab.sent());
  return ExitCode::ok;
}

void add_lab(CLI::App& app, Command& command) {
  auto* sub = app.add_subcommand("lab", "start a laboratory of simulated devices");
  auto a = std::make_shared<LabArguments>();
  auto& o = a->options;
  sub->add_option("--dir", o.dir, "folder for lab.toml and for the links to the simulated devices")
      ->type_name("FOLDER")
      ->capture_default_str();
  sub->add_option("--scene", o.schedule.kind, "kind of scene in front of the devices")
      ->check(CLI::IsMember(
          {"person", "letter", "mixed", "two_people", "empty", "reflector", "object"}))
      ->capture_default_str();
  sub->add_option(
         "--hold", o.schedule.hold_s,
         "duration of each scene, s; scenes change at the start of a slot; 0: show one scene only")
      ->check(CLI::Range(0.0, 0.0) | CLI::Range(0.01, 86'400.0))
      ->capture_default_str();
  sub->add_option("--window", o.window_s,
                  "length of a record, s; the photon counts in the settings are counts per record")
      ->check(CLI::Range(0.05, 3600.0))
      ->capture_default_str();
  sub->add_option("--laser-rate-hz", o.tagging.laser_rate_hz, "number of laser pulses per second")
      ->check(CLI::Range(1.0, 1e9))
      ->capture_default_str();
  sub->add_option("--radar-cfg", o.radar_cfg,
                  "TI .cfg file of the radar, or the name of an installed .cfg file; default: the "
                  "installed file of the board with a range resolution of 50 cm; SDK 3.4 is "
                  "simulated if the name ends with _sdk3.4.cfg, otherwise SDK 3.5");
  sub->add_option("--radar-board", o.radar_board, "TI radar board to simulate")
      ->check(CLI::IsMember({"isk", "aop", "ods"}))
      ->capture_default_str();
  sub->add_option("--faults", o.faults,
                  "TOML file that lists the device faults to simulate and their times")
      ->type_name("FILE");
  sub->add_option(
         "--log", o.log,
         "log the data that the simulated devices send in this file, one JSON object per line")
      ->type_name("FILE");
  add_plan_options(*sub, *a);
  sub->add_option("command", a->command,
                  "run this command while the laboratory is running, then stop the laboratory")
      ->option_text("-- COMMAND ...");
  more_options(
      *sub, {"--config", "--laser-rate-hz", "--radar-cfg", "--radar-board", "--faults", "--log"});
  add_examples(*sub,
               {"echofuse-sim lab --scene mixed --hold 3",
                "echofuse-sim lab --dir . --scene reflector -- bash"},
               "3 config; if COMMAND is given, the exit code of COMMAND");
  sub->callback([&command, a] { command = [a](bool quiet) { return run_lab(*a, quiet); }; });
}

void add_config(CLI::App& app, Command& command) {
  auto* sub = app.add_subcommand(
      "config", "print all simulator settings, each with its meaning, range and value");
  struct Arguments : PlanArguments {
    std::string ranges;
    bool json = false;
  };
  auto a = std::make_shared<Arguments>();
  add_plan_options(*sub, *a);
  sub->add_option("--twin", a->ranges,
                  "print the parameter ranges of this digital twin, a TOML file or `default`")
      ->type_name("FILE");
  sub->add_flag("--json", a->json,
                "print the value, the range and the meaning of every setting as JSON");
  add_examples(*sub,
               {"echofuse-sim config", "echofuse-sim config --set twin=default --set laboratory=3"},
               "3 config");
  sub->callback([&command, a] {
    command = [a](bool) {
      sim::Plan plan;
      Settings settings;
      if (!a->ranges.empty()) {
        std::cout << (a->ranges == "default" ? sim::default_twin()
                                             : to_text(sim::twin_named(a->ranges)));
        return ExitCode::ok;
      }
      read_plan(*a, plan, settings);
      std::cout << (a->json ? settings.json() : settings.resolved(true));
      return ExitCode::ok;
    };
  });
}

ExitCode run(int argc, char** argv) {
  CLI::App app("simulate data sets, or a laboratory of devices", "echofuse-sim");
  app.set_version_flag("--version", version_line("echofuse-sim"));
  app.require_subcommand(1);
  bool quiet = false;
  app.add_flag("-q,--quiet", quiet, "print errors only");
  Command command;
  add_dataset(app, command);
  add_lab(app, command);
  add_config(app, command);
  try {
    parse_command_line(app, argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage;
  }
  return command(quiet);
}

}  // namespace

int main(int argc, char** argv) {
  return echofuse::run_main("echofuse-sim", [&] { return run(argc, argv); });
}
