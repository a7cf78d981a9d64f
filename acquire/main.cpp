// SPDX-License-Identifier: MIT
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "acquire/calibrate.hpp"
#include "acquire/config.hpp"
#include "acquire/daemon.hpp"
#include "acquire/devices.hpp"
#include "acquire/doctor.hpp"
#include "acquire/info.hpp"
#include "acquire/live_runs.hpp"
#include "acquire/log_format.hpp"
#include "acquire/mark.hpp"
#include "acquire/record/export.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_names.hpp"
#include "acquire/replay.hpp"
#include "acquire/viewer.hpp"
#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* program = "echofuse-acquire";

constexpr const char* footer =
    "exit codes: 0 ok, 1 failed, 2 usage, 3 config, 4 device, 5 partial (some records "
    "unreadable;\n"
    "            run --strict: of some a sensor was not ok),\n"
    "            6 disk, 130 interrupted (second Ctrl-C, or before the first slot)";

constexpr const char* out_help =
    "run file to make; .sqlite is appended if it has no extension, and %Y%m%d-%H%M%S is the time "
    "(UTC; strftime's fields)";

struct Options {
  std::string config = "lab.toml";
  std::vector<std::string> assignments;
  RunOptions run;
  CalibrateOptions calibrate;
  std::optional<std::string> label, operator_name, text;
  std::vector<std::string> meta;
  std::string resume;
  double duration_s = 0;
  std::string file, to;
  std::vector<std::string> radar, tdc, depth, parts;
  std::optional<std::int64_t> record;
  bool config_given = false;  // --config or --set
  bool json = false, quiet = false, verbose = false, view = false;
};

void set_up_log(const Options& o) {
  auto log = spdlog::stderr_color_mt(program);
  log->set_formatter(log_format());
  log->set_level(o.quiet     ? spdlog::level::err
                 : o.verbose ? spdlog::level::debug
                             : spdlog::level::info);
  spdlog::set_default_logger(log);
}

Config load(const Options& o) { return load_config(o.config, o.assignments); }

void plan_count(Options& o, const Config& config) {
  if (o.duration_s > 0)
    o.run.count = static_cast<std::int64_t>(std::ceil(o.duration_s / config.window_s - 1e-9));
}

ExitCode run(Options& o) {
  Config config = load(o);
  if (o.label) config.label = *o.label;
  o.run.label_given = o.label || std::any_of(o.assignments.begin(), o.assignments.end(),
                                             [](auto& a) { return a.starts_with("run.label"); });
  if (o.operator_name) config.operator_name = *o.operator_name;
  for (const auto& pair : o.meta) {
    const auto equals = pair.find('=');
    if (equals == 0 || equals == std::string::npos)
      throw Error(ExitCode::usage, "--meta " + pair + ": expected key=value");
    const std::string key = pair.substr(0, equals);
    for (const auto& [before, value] : o.run.meta)
      if (before == key) throw Error(ExitCode::usage, "--meta " + key + ": given twice");
    o.run.meta.emplace_back(key, pair.substr(equals + 1));
  }
  plan_count(o, config);
  o.run.resume = !o.resume.empty();
  o.run.out = o.run.resume ? std::filesystem::absolute(record::old_run(o.resume)).string()
                           : record::new_run(o.run.out);
  o.run.quiet = o.quiet;
  if (!o.run.keep_raw.empty()) o.run.keep_raw = std::filesystem::absolute(o.run.keep_raw).string();
  catch_interrupts();
  std::optional<Viewer> viewer;
  if (o.view) viewer.emplace(o.run.out, o.run.count);
  const ExitCode code = record_run(config, o.run, SystemClock());
  if (viewer) viewer->leave();
  return code;
}

ExitCode align(Options& o) {
  const TemporaryFolder folder;
  o.assignments.push_back("run.window_s=0.1");
  o.run.out = folder.path() + "/align";
  o.view = true;
  return run(o);
}

// Of commands that do without: none if there is no file and none was asked for.
std::optional<Config> load_if_any(const Options& o) {
  if (!o.config_given && !std::filesystem::exists(o.config)) return std::nullopt;
  return load(o);
}

ExitCode list_devices(const Options& o) {
  catch_interrupts();
  return check_devices(load_if_any(o), SystemClock(), o.json);
}

ExitCode doctor(Options& o) {
  catch_interrupts();
  const auto config = load_if_any(o);
  if (config) plan_count(o, *config);
  return examine(config, {.out = record::new_run(o.run.out), .count = o.run.count, .json = o.json},
                 SystemClock());
}

ExitCode show_config(const Options& o) {
  std::fputs(load(o).shown.c_str(), stdout);
  return ExitCode::ok;
}

ExitCode check_config(const Options& o) {
  load(o);
  std::printf("%s: ok\n", printable(o.config).c_str());
  return ExitCode::ok;
}

ExitCode info(const Options& o) {
  std::fputs(describe_run(o.file, o.json).c_str(), stdout);
  return ExitCode::ok;
}

ExitCode calibrate_sensors(Options& o) {
  const Config config = load_config(o.config, o.assignments, o.calibrate.check);
  if (o.calibrate.out.empty()) o.calibrate.out = config.calibration_path;
  o.calibrate.json = o.json;
  catch_interrupts();
  return calibrate(config, o.calibrate, SystemClock());
}

ExitCode mark(const Options& o) {
  if (o.text.has_value() == o.label.has_value())
    throw Error(ExitCode::usage, "expected either a text or --label TEXT");
  std::printf("%s\n", printable_lines(mark_run(o.file, o.text, o.label)).c_str());
  return ExitCode::ok;
}

ExitCode replay(const Options& o) {
  const Replayed result = !o.radar.empty() ? replay_radar(o.radar, o.json)
                          : !o.tdc.empty() ? replay_tdc(o.tdc, o.json)
                                           : replay_depth(o.depth, o.json);
  std::fputs(result.text.c_str(), stdout);
  if (!result.any)
    throw Error(ExitCode::failed, std::string("no ") + (o.tdc.empty() ? "frame" : "tag") +
                                      " in it: is it a recording of another device?");
  return ExitCode::ok;
}

ExitCode recover(const Options& o) {
  std::printf("%lld records\n", static_cast<long long>(record::recover(o.file)));
  return ExitCode::ok;
}

ExitCode merge(const Options& o) {
  std::vector<std::string> parts;
  for (const auto& part : o.parts) parts.push_back(record::old_run(part));
  const std::string out = record::new_run(o.to);
  std::printf("%lld records\n", static_cast<long long>(record::merge(parts, out)));
  return ExitCode::ok;
}

ExitCode export_run(const Options& o) {
  const record::RunReader reader(o.file);
  const std::string kind = std::filesystem::path(o.to).extension().string();
  if (kind == ".csv" && o.record) {
    record::export_csv(reader, *o.record, o.to);
    return ExitCode::ok;
  }
  if (kind != ".h5" || o.record)
    throw Error(ExitCode::usage,
                "--to " + o.to + ": expected NAME.h5, or NAME.csv with --record N");
  Progress progress("export", static_cast<std::size_t>(reader.count()), o.quiet);
  const auto bad = record::export_h5(reader, o.to, [&](std::int64_t done, std::int64_t) {
    progress.update(static_cast<std::size_t>(done));
  });
  if (bad == 0) return ExitCode::ok;
  spdlog::error("{} records could not be read; they are marked in {}", bad, o.to);
  return ExitCode::partial;
}

void add_config_options(CLI::App& command, Options& o) {
  command.add_option("--config", o.config, "configuration (TOML)")->capture_default_str();
  command.add_option("--set", o.assignments, "key=value, overrides the file; may be repeated")
      ->allow_extra_args(false);
}

void add_output_options(CLI::App& command, Options& o) {
  command.add_flag("-q,--quiet", o.quiet, "print errors only");
  command.add_flag("-v,--verbose", o.verbose, "one line for every record on stderr");
}

void add_length_options(CLI::App& command, Options& o) {
  auto* count = command.add_option("--count", o.run.count, "stop after this many slots")
                    ->check(CLI::PositiveNumber);
  const std::map<std::string, double> units{{"h", 3600}, {"m", 60}, {"min", 60}, {"s", 1}};
  command.add_option("--duration", o.duration_s, "stop after this time: 2h, 30m, 10s")
      ->transform(CLI::AsNumberWithUnit(units, CLI::AsNumberWithUnit::UNIT_REQUIRED))
      ->check(CLI::PositiveNumber)
      ->excludes(count);
}

void add_run(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand("run", "record fused records, one a slot, until Ctrl-C");
  add_config_options(*c, o);
  add_output_options(*c, o);
  auto* target = c->add_option_group("target");
  target->add_option("--out", o.run.out, out_help);
  auto* resume = target->add_option("--resume", o.resume,
                                    "run to continue, with the configuration it was begun with");
  target->require_option(1);
  add_length_options(*c, o);
  c->add_option("--keep-raw", o.run.keep_raw,
                "new folder for the devices' bytes as they came, for `replay`");
  c->add_option("--label", o.label, "label of every record, instead of run.label");
  c->add_option("--operator", o.operator_name, "who records, instead of run.operator");
  c->add_flag("--view", o.view, "start echofuse-view beside, which prints its address");
  c->add_flag("--strict", o.run.strict, "exit code 5 if any record has a sensor that is not ok");
  c->add_option("--meta", o.meta, "key=value, kept in the run; may be repeated")
      ->allow_extra_args(false)
      ->excludes(resume);
}

void add_align(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand(
      "align",
      "point laser and sensors: slots of 0.1 s in a run that is thrown away, and its view");
  add_config_options(*c, o);
  add_output_options(*c, o);
  add_length_options(*c, o);
}

void add_calibrate(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand(
      "calibrate", "measure a reflector at a known distance: by how much each range is too long");
  add_config_options(*c, o);
  auto& k = o.calibrate;
  c->add_option("--distance", k.search.distance_m, "of the reflector from each sensor, m")
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  c->add_option("--window", k.search.window_m, "where its echo may lie, m, centred on the distance")
      ->check(CLI::Range(0.01, 30.0))
      ->capture_default_str();
  c->add_option("--repeat", k.repeats, "how often to measure")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{100'000}))
      ->capture_default_str();
  c->add_option("--time", k.time_s, "s of each measurement")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  auto* out = c->add_option("--out", k.out, "file to write, instead of run.calibration");
  c->add_flag("--check", k.check, "measure and compare with run.calibration; write nothing")
      ->excludes(out);
  c->add_flag("--json", o.json);
}

void add_file_commands(CLI::App& app, Options& o) {
  auto* info = app.add_subcommand("info", "what is in a run file");
  info->add_option("FILE", o.file)->required();
  info->add_flag("--json", o.json);

  auto* exporter = app.add_subcommand("export", "a run as HDF5, or one record as CSV");
  exporter->add_option("FILE", o.file)->required();
  exporter->add_option("--to", o.to, "NAME.h5, or NAME.csv with --record")->required();
  exporter->add_option("--record", o.record, "index of the record for CSV");
  exporter->add_flag("-q,--quiet", o.quiet, "no progress on stderr");

  app.add_subcommand("status", "the runs that are being recorded on this machine")
      ->add_flag("--json", o.json);

  app.add_subcommand("recover", "check a run that a crash left open, and mark it as crashed")
      ->add_option("FILE", o.file)
      ->required();

  auto* merger = app.add_subcommand("merge", "one run of the parts of a simulated data set");
  merger->add_option("PART", o.parts, "of `echofuse-sim dataset --part`, in any order")->required();
  merger->add_option("--out", o.to, "run file to make (never overwritten)")->required();

  auto* marker = app.add_subcommand("mark", "a remark, or another label, into a run that is live");
  marker->add_option("FILE", o.file)->required();
  marker->add_option("TEXT", o.text, "kept as an event, with the time");
  marker->add_option("--label", o.label, "label of the records from the running slot on");

  auto* replay = app.add_subcommand("replay", "recorded device bytes through the live parser");
  auto* kind = replay->add_option_group("device");
  kind->add_option("--radar", o.radar, "recordings of the radar's data port");
  kind->add_option("--tdc", o.tdc, "blocks of a tagger behind a bridge, or NAME.usb");
  kind->add_option("--depth", o.depth, "blocks of a depth camera");
  kind->require_option(1);
  replay->add_flag("--json", o.json);
}

CLI::App* add_doctor(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand("doctor", "would a run go well? Checks machine, disk and devices");
  add_config_options(*c, o);
  c->add_option("--out", o.run.out, "of the run to come; by default in this folder")
      ->default_val("run.sqlite");
  add_length_options(*c, o);
  c->add_flag("--json", o.json);
  c->footer(
      "exit codes: 0 ok or warnings only, 3 configuration, 4 a configured device fails,\n"
      "            6 the disk is too slow or too full (4 if both), 130 interrupted");
  return c;
}

void add_config_commands(CLI::App& app, Options& o) {
  auto* config = app.add_subcommand("config", "look at the configuration");
  config->require_subcommand(1);
  add_config_options(*config->add_subcommand("check", "print all faults, or that there are none"),
                     o);
  add_config_options(
      *config->add_subcommand("show", "check it and print every key with value and origin"), o);
}

// "run", "config show"
std::string command_of(const CLI::App& app) {
  const auto* command = app.get_subcommands()[0];
  const auto below = command->get_subcommands();
  return command->get_name() + (below.empty() ? "" : " " + below[0]->get_name());
}

ExitCode dispatch(const std::string& command, Options& o) {
  set_up_log(o);
  if (!o.file.empty()) o.file = record::old_run(o.file);
  if (command == "run") return run(o);
  if (command == "align") return align(o);
  if (command == "status") {
    std::fputs(describe_live_runs(SystemClock(), o.json).c_str(), stdout);
    return ExitCode::ok;
  }
  if (command == "devices") return list_devices(o);
  if (command == "doctor") return doctor(o);
  if (command == "config check") return check_config(o);
  if (command == "config show") return show_config(o);
  if (command == "info") return info(o);
  if (command == "export") return export_run(o);
  if (command == "calibrate") return calibrate_sensors(o);
  if (command == "mark") return mark(o);
  if (command == "recover") return recover(o);
  if (command == "merge") return merge(o);
  return replay(o);
}

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Records a single-photon detector, a radar and a depth camera into one run file.",
               program);
  app.set_version_flag("--version", std::string(program) + " " + version());
  app.require_subcommand(0, 1);
  app.footer(footer);
  add_run(app, options);
  add_align(app, options);
  add_calibrate(app, options);
  auto* devices =
      app.add_subcommand("devices", "what is attached, and which of the configured devices answer");
  add_config_options(*devices, options);
  devices->add_flag("--json", options.json);
  auto* doctor = add_doctor(app, options);
  add_config_commands(app, options);
  add_file_commands(app, options);
  try {
    app.parse(argc, argv);
    for (const auto* c : {devices, doctor})
      options.config_given |= c->count("--config") + c->count("--set") > 0;
    if (app.get_subcommands().empty()) throw CLI::RequiredError("a command");
  } catch (const CLI::ParseError& e) {
    return run_main(program, [&] { return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage; });
  }
  return run_main(program, [&] { return dispatch(command_of(app), options); });
}

}  // namespace
}  // namespace echofuse::acquire

int main(int argc, char** argv) { return echofuse::acquire::main(argc, argv); }
