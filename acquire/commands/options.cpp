// SPDX-License-Identifier: MIT
#include "acquire/commands/options.hpp"

#include <cctype>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>

#include "drivers/util/command_line.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* out_help =
    "run file to create; the extension .sqlite is appended if it is missing; time fields such as "
    "%Y%m%d-%H%M%S are replaced by the UTC time, and %% by a percent sign; default: DATE-NNN in "
    "the folder run.folder";

void add_config_options(CLI::App& command, Options& o) {
  command
      .add_option(
          "--config", o.config,
          "configuration file (TOML); default: the first of these files that exists: "
          "$ECHOFUSE_CONFIG, ./lab.toml, ~/.config/echofuse/lab.toml, /etc/echofuse/lab.toml")
      ->type_name("FILE");
  command
      .add_option("--set", o.assignments,
                  "override this key of the configuration file; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

// Converts a duration such as "2h30m" to seconds ("9000"). The units must be in descending order.
// Returns the error message, or an empty string.
std::string to_seconds(std::string& text) {
  const std::map<std::string, double> units{{"h", 3600}, {"m", 60}, {"min", 60}, {"s", 1}};
  std::istringstream in(text);
  double sum_s = 0, unit_before_s = std::numeric_limits<double>::infinity();
  do {
    double number = 0;
    std::string name;
    in >> number >> std::ws;
    while (std::isalpha(in.peek()) != 0) name += static_cast<char>(in.get());
    const auto unit = units.find(name);
    if (unit == units.end() || unit->second >= unit_before_s || (number < 0 && sum_s > 0))
      return "expected numbers with units, e.g. 2h, 30m, 10s or 2h30m";
    unit_before_s = unit->second;
    sum_s += number * unit_before_s;
  } while (!(in >> std::ws).eof());
  std::ostringstream out;
  out << std::setprecision(17) << sum_s;
  text = out.str();
  return {};
}

CLI::Option* add_time(CLI::App& command, const char* name, double& into_s, const char* help) {
  return command.add_option(name, into_s, help)
      ->type_name("TIME")
      ->transform(CLI::Validator(to_seconds, ""))
      ->check(CLI::PositiveNumber)
      ->check([](const std::string& seconds) {
        constexpr double ten_years_s = 87'660.0 * 3600;
        return std::stod(seconds) <= ten_years_s ? "" : "expected at most 87660h (ten years)";
      });
}

void add_run(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand(
      "run", "record a run, with one fused record per time slot, until Ctrl-C is pressed");
  c->add_flag("-v,--verbose", o.verbose, "print one line per record on stderr");
  c->add_flag("--json", o.json, "print events on stdout as one JSON object per line");
  auto* out = c->add_option("--out", o.run.out, out_help)->type_name("RUN");
  c->add_flag("--align", o.align,
              "start the alignment mode: a live view with slots of 0.1 s; no data are saved")
      ->excludes(out);
  auto* count = c->add_option("--count", o.run.count, "stop after this number of slots")
                    ->check(CLI::PositiveNumber);
  add_time(*c, "--duration", o.duration_s, "stop after this time, e.g. 2h, 30m, 10s or 2h30m")
      ->excludes(count);
  add_time(*c, "--every", o.every_s,
           "start a new run file at this interval, e.g. 1h; the file name contains the time if "
           "--out has time fields, otherwise a number (NAME-001, NAME-002, ...)");
  c->add_option("--countdown", o.run.countdown_s,
                "show a countdown of this number of seconds before the first slot")
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{3600}));
  c->add_option("--keep-raw", o.run.keep_raw,
                "also store the raw bytes of the devices in this new folder, which `import` can "
                "convert into a run")
      ->type_name("FOLDER");
  c->add_flag("--view", o.view, "start the live page (echofuse-view) and print its address");
  c->add_option("--model", o.model, "model file for the depth maps that --view shows")
      ->type_name("MODEL");
  add_config_options(*c, o);
  c->add_flag("--strict", o.run.strict,
              "exit with code 5 if any record has a sensor with a doubtful verdict");
  c->add_option("--meta", o.meta,
                "store this key and value in the metadata of the run; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  more_options(
      *c, {"--config", "--verbose", "--json", "--countdown", "--keep-raw", "--strict", "--meta"});
  add_examples(
      *c,
      {"echofuse-acquire run --out monday --set run.label=person",
       "echofuse-acquire run --out %Y%m%d-%H%M%S --every 1h",
       "echofuse-acquire run --out monday --view --model fused.safetensors"},
      "3 config, 4 device, 5 a sensor is not ok (--strict), 6 disk, 130 interrupted (second "
      "Ctrl-C, or before the first slot)");
}

void add_calibrate(CLI::App& app, Options& o) {
  auto* c = app.add_subcommand(
      "calibrate", "measure the range offsets of the sensors with a reflector at a known distance");
  add_config_options(*c, o);
  auto& k = o.calibrate;
  c->add_option("--reflector", o.reflector,
                "position of the reflector, one of: detector (in front of the detector; its "
                "distance from the radar is computed with radar.baseline_m), each (in front of "
                "each sensor in turn; calibrate one sensor at a time with --only)")
      ->check(CLI::IsMember({"detector", "each"}))
      ->capture_default_str();
  c->add_option("--only", o.only,
                "calibrate only this sensor, and keep the stored values of the other sensor")
      ->check(CLI::IsMember({"spd", "radar"}));
  auto* side = c->add_option("--side", o.side,
                             "check that the antenna order is correct, after you have moved the "
                             "reflector to this side by radar.baseline_m")
                   ->check(CLI::IsMember({"left", "right"}));
  c->add_option("--distance", k.search.distance_m,
                "distance between the reflector and the sensor that it faces, m; --side and "
                "--check use by default the distance stored in the calibration file")
      ->each([&k](const std::string&) { k.distance_given = true; })
      ->check(CLI::Range(0.1, 100.0))
      ->capture_default_str();
  c->add_option("--window", k.search.window_m,
                "width of the search window around the expected range of the reflector, m; the "
                "largest measurable offset is half of this width")
      ->check(CLI::Range(0.01, 30.0))
      ->capture_default_str();
  c->add_option("--repeat", k.repeats, "number of measurements")
      ->check(CLI::Range(std::int64_t{3}, std::int64_t{100'000}))
      ->capture_default_str();
  c->add_option("--time", k.time_s, "duration of each measurement, s")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  const CLI::Range error(0.0, 1.0);
  c->add_option("--distance-error", k.distance_error_m,
                "standard error of the reflector position in x, y and z, m")
      ->check(error)
      ->capture_default_str();
  c->add_option("--baseline-error", k.baseline_error_m,
                "standard error of radar.baseline_m (distance between detector and radar), m")
      ->check(error)
      ->capture_default_str();
  auto* check = c->add_flag("--check", k.check,
                            "measure the offsets and compare them with the calibration file "
                            "run.calibration, without writing a file");
  c->add_flag("--json", o.json, "print JSON instead of text");
  side->excludes(check);
  more_options(*c, {"--config", "--set", "--window", "--time", "--distance-error",
                    "--baseline-error", "--side", "--json"});
  add_examples(*c,
               {"echofuse-acquire calibrate --distance 1.0 --repeat 5",
                "echofuse-acquire calibrate --reflector each --only radar",
                "echofuse-acquire calibrate --side right", "echofuse-acquire calibrate --check"},
               "3 config, 4 device failed or reflector not found, 6 disk, 130 interrupted");
}

void add_file(CLI::App& command, Options& o) {
  command.add_option("RUN", o.file, "run file")->type_name("RUN")->required();
}

void add_file_commands(CLI::App& app, Options& o) {
  auto* info = app.add_subcommand("info", "print the contents of a run file");
  add_file(*info, o);
  info->add_flag("--json", o.json, "print JSON instead of text");
  add_examples(*info, {"echofuse-acquire info monday.sqlite"}, "6 disk");

  auto* annotate = app.add_subcommand(
      "annotate", "add a note to a run, or change the label of a run in progress");
  add_file(*annotate, o);
  annotate->add_option("TEXT", o.text,
                       "note to add to the run; its time and author are stored with it");
  annotate->add_option("--label", o.label,
                       "new label of a run in progress, for all records from the current slot on");
  add_examples(*annotate,
               {"echofuse-acquire annotate monday.sqlite \"the lamp is on\"",
                "echofuse-acquire annotate monday.sqlite --label person"},
               "6 disk");

  auto* list = app.add_subcommand(
      "list", "list the runs in a folder, and the state of each run in progress");
  list->add_option("FOLDER", o.folder,
                   "folder of run files; default: run.folder of the configuration if it is set, "
                   "otherwise the working directory");
  list->add_flag("--json", o.json, "print JSON instead of text; no entry is shortened");
  add_examples(*list, {"echofuse-acquire list"}, "3 config");

  auto* verdicts = app.add_subcommand(
      "verdicts", "print all verdicts on the data of a sensor, with their meanings and limits");
  verdicts->add_flag("--json", o.json, "print JSON instead of a Markdown table");
  add_examples(*verdicts, {"echofuse-acquire verdicts"}, "");
}

void add_import(CLI::App& app, Options& o) {
  auto* c =
      app.add_subcommand("import", "convert third-party recordings or raw captures into a run");
  add_config_options(*c, o);
  auto& i = o.import;
  c->add_option("FILE", i.files,
                "one recording per sensor (NAME.dat: bytes of the radar's data port; NAME.ptu: "
                "PicoQuant time tags), or a folder with run.toml and NumPy arrays (spd.npy, "
                "radar.npy, depth.npy), or a folder written by `run --keep-raw`")
      ->required();
  c->add_option("--cfg", i.cfg,
                "configuration file (.cfg) of the radar that was recorded; default: NAME.cfg in "
                "the folder of NAME.dat")
      ->type_name("FILE");
  c->add_option("--out", o.run.out, out_help)->type_name("RUN");
  c->add_option("--began", i.began,
                "start time of the recording in UTC, e.g. 2024-02-07T12:34:56Z; default: taken "
                "from the imported files")
      ->type_name("TIME");
  c->add_option("--start", i.start,
                "channel of the laser pulses in a .ptu file; 0 is the sync channel")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  c->add_option("--click", i.click, "channel of the detector in a .ptu file")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  more_options(*c, {"--config", "--set", "--began", "--start", "--click"});
  add_examples(*c,
               {"echofuse-acquire import capture.dat photons.ptu --out monday",
                "echofuse-acquire import raw --out monday-again"},
               "3 config, 5 one of two recordings has no valid record, 6 disk, 130 interrupted");
}

void add_doctor(CLI::App& app, Options& o) {
  auto* c =
      app.add_subcommand("doctor", "check the machine, the disk and the devices before a run");
  add_config_options(*c, o);
  add_time(*c, "--duration", o.duration_s, "duration of the planned run, e.g. 2h, 30m or 10s");
  c->add_flag("--json", o.json, "print JSON instead of text");
  add_examples(*c, {"echofuse-acquire doctor --duration 2h"},
               "3 config, 4 a configured device fails, 6 the disk is too slow or too full (4 if a "
               "device fails as well), 130 interrupted; warnings do not change the exit code");
}

void add_config_commands(CLI::App& app, Options& o) {
  auto* config = app.add_subcommand("config", "check or print the configuration");
  config->require_subcommand(1);
  add_config_options(*config, o);
  auto* check = config->add_subcommand("check", "report all errors in the configuration");
  add_examples(*check, {"echofuse-acquire config check"}, "3 config");
  auto* show = config->add_subcommand(
      "show", "check the configuration, and print every key with its value and origin");
  add_examples(*show, {"echofuse-acquire config show --set run.window_s=1"}, "3 config");
}

void add_devices(CLI::App& app, Options& o) {
  auto* c =
      app.add_subcommand("devices", "list the attached devices, and check the configured devices");
  add_config_options(*c, o);
  c->add_flag("--json", o.json, "print JSON instead of text");
  add_examples(*c, {"echofuse-acquire devices"},
               "3 config, 4 a configured device does not answer, 130 interrupted");
}

}  // namespace

void add_commands(CLI::App& app, Options& o) {
  app.require_subcommand(0, 1);
  add_run(app, o);
  add_calibrate(app, o);
  add_devices(app, o);
  add_doctor(app, o);
  add_config_commands(app, o);
  add_file_commands(app, o);
  add_import(app, o);
  app.add_flag("-q,--quiet", o.quiet, "print errors only");
}

std::string command_of(const CLI::App& app) {
  const auto* command = app.get_subcommands()[0];
  const auto below = command->get_subcommands();
  return command->get_name() + (below.empty() ? "" : " " + below[0]->get_name());
}

}  // namespace echofuse::acquire
