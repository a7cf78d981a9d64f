// SPDX-License-Identifier: MIT
#include <malloc.h>
#include <spdlog/details/os.h>
#include <spdlog/sinks/ansicolor_sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "acquire/calibrate/calibrate.hpp"
#include "acquire/commands/commands.hpp"
#include "acquire/commands/options.hpp"
#include "acquire/config/config.hpp"
#include "acquire/devices/device_check.hpp"
#include "acquire/doctor/doctor.hpp"
#include "acquire/import/import.hpp"
#include "acquire/measurement/response.hpp"
#include "acquire/record/recover.hpp"
#include "acquire/record/run_names.hpp"
#include "acquire/run/new_run.hpp"
#include "acquire/run/viewer.hpp"
#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/output_queue.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* program = "echofuse-acquire";

// `messages` must outlive the default logger, which writes to it.
void set_up_log(const Options& o, const OutputQueue& messages) {
  using Sink = spdlog::sinks::ansicolor_sink<spdlog::details::console_mutex>;
  const bool colours = isatty(STDERR_FILENO) && spdlog::details::os::is_color_terminal();
  auto log = std::make_shared<spdlog::logger>(
      program, std::make_shared<Sink>(messages.stream(), colours ? spdlog::color_mode::always
                                                                 : spdlog::color_mode::never));
  log->set_formatter(log_format());
  log->set_level(o.quiet     ? spdlog::level::err
                 : o.verbose ? spdlog::level::debug
                             : spdlog::level::info);
  spdlog::set_default_logger(log);
}

// Returns the path given by --config, otherwise the first configuration file found.
ConfigPlace place_of(const Options& o) {
  return o.config.empty() ? require_config() : ConfigPlace{o.config, "--config"};
}

Config load(const Options& o) {
  const ConfigPlace place = place_of(o);
  if (place.name != "--config" && place.name != "./lab.toml")
    spdlog::info("configuration: {}", place.path);
  return load_config(place.path, o.assignments);
}

// Returns true if the key names a fact of the run, an attribute of exported files or a key that the
// programs write.
bool is_reserved_meta(const std::string& key) {
  constexpr std::string_view reserved =
      " uuid started_utc ended_utc status window_s host config_text config_resolved radar_cfg "
      "version notes operator meta detector_dead_time_ps wal_key schema "
      "Conventions CLASS NAME REFERENCE_LIST DIMENSION_LIST ";
  const auto is_key = [&](const auto& entry) { return entry.first == key; };
  return key.starts_with('_') || key.ends_with("_offset_m") ||
         std::ranges::any_of(record::RadarMounting{}.meta(), is_key) ||
         reserved.find(' ' + key + ' ') != reserved.npos;
}

void plan_count(Options& o, const Config& config) {
  const auto slots = [&](double time_s) {
    return static_cast<std::int64_t>(std::ceil(time_s / config.window_s - 1e-9));
  };
  if (o.duration_s > 0) o.run.count = slots(o.duration_s);
  if (o.every_s > 0) o.run.slots_a_file = slots(o.every_s);
}

// Returns the path of a new run file. `numbered` is true if the file is one of several created by
// `run --every`.
std::string path_of(const std::string& out, bool numbered, const Config& config) {
  if (utf8_text(out) != out)
    throw Error(ExitCode::usage, "--out " + printable(out) + ": expected UTF-8");
  if (out.empty()) return record::next_run(config.run_folder);
  return numbered ? record::next_of(out) : record::new_run(out);
}

// Prints the events of `run --json` during the run: one JSON object per line.
class Events {
 public:
  void begin() { out_.emplace(STDOUT_FILENO, left_out); }
  void put(const nlohmann::ordered_json& event) {
    if (!out_ || out_->put(line_of(event)) || std::exchange(reported_, true)) return;
    spdlog::warn(
        "--json: the program that reads stdout is too slow or has stopped; the oldest events are "
        "dropped");
  }
  // Ignores EPIPE, because the reading program may exit before the run ends. Rethrows `failure`,
  // the reason for the end of the run, if there is one.
  void end(const std::exception_ptr& failure) {
    const int error = out_ ? out_->close() : 0;
    if (failure) std::rethrow_exception(failure);
    if (error != 0 && error != EPIPE)
      throw Error(ExitCode::failed, std::string("stdout: cannot write: ") + std::strerror(error));
  }

 private:
  static std::string line_of(nlohmann::ordered_json event) {
    event["schema"] = 1;
    return event.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  }
  static std::string left_out(std::size_t count) {
    return line_of({{"event", "left out"}, {"events", count}});
  }
  std::optional<OutputQueue> out_;
  bool reported_ = false;
};

// Runs `body` and returns its exit code, or that of its exception, which is stored in `failure`.
ExitCode code_of(const std::function<ExitCode()>& body, std::exception_ptr& failure) {
  try {
    return body();
  } catch (const Error& error) {
    failure = std::current_exception();
    return error.code();
  } catch (const std::exception&) {
    failure = std::current_exception();
    return ExitCode::failed;
  }
}

// Checks the entries of --meta, which take precedence over the configuration, and adds them to the
// run.
void take_meta(Options& o, const Config& config) {
  for (const auto& pair : o.meta) {
    const auto equals = pair.find('=');
    if (equals == 0 || equals == std::string::npos)
      throw Error(ExitCode::usage, "--meta " + pair + ": expected key=value");
    const std::string key = pair.substr(0, equals);
    if (is_reserved_meta(key))
      throw Error(ExitCode::usage, "--meta " + pair + ": " + key +
                                       " is a name that echofuse uses itself; choose another name");
    for (const auto& [before, value] : o.run.meta)
      if (before == key) throw Error(ExitCode::usage, "--meta " + key + ": given twice");
    o.run.meta.emplace_back(key, pair.substr(equals + 1));
  }
  const auto meta = complete_meta(o.run.meta, config);
  if (const std::string fault =
          record::fault_of_width(meta, static_cast<double>(config.histogram.bin_width_ps));
      !fault.empty())
    throw Error(ExitCode::usage, "--meta: " + fault);
  if (!record::is_response(meta))
    throw Error(ExitCode::usage,
                "--meta: expected a response as `calibrate` prints it: irf_fwhm_ps above 0; "
                "radar_cell_m above 0 with radar_taps, 3 to 64 numbers with a peak of 1");
}

ExitCode run(Options& o) {
  std::optional<TemporaryFolder> thrown_away;
  if (o.align) {
    o.assignments.push_back("run.window_s=0.1");
    o.run.out = thrown_away.emplace().path() + "/align";
    o.view = true;
  }
  if (!o.model.empty() && !o.view) throw Error(ExitCode::usage, "--model requires --view");
  if (!o.model.empty() && !std::filesystem::exists(o.model))
    throw Error(ExitCode::usage, "--model " + o.model + ": no such file");
  const Config config = load(o);
  take_meta(o, config);
  plan_count(o, config);
  const bool rotates = o.run.slots_a_file > 0;
  o.run.next_out = [&config, out = o.run.out, rotates] { return path_of(out, rotates, config); };
  o.run.out = o.run.next_out();
  o.run.quiet = o.quiet;
  if (!o.align) o.run.on_doubt = config.on_doubt;
  if (!o.run.keep_raw.empty()) o.run.keep_raw = std::filesystem::absolute(o.run.keep_raw).string();
  catch_interrupts();
  // Makes the allocator return memory to the system after a large burst of samples.
  mallopt(M_TRIM_THRESHOLD, 256 << 10);
  std::optional<Viewer> viewer;
  if (o.view)
    viewer.emplace(rotates ? std::filesystem::path(o.run.out).parent_path().string() : o.run.out,
                   rotates ? o.run.slots_a_file : o.run.count, o.model);
  port::SystemLoop loop;
  std::int64_t on_disk = -1;
  Events events;
  if (o.json) events.begin();
  bool begun = false;  // true once a run file exists
  o.run.opened = [&](const std::string& file) {
    begun = true;
    events.put({{"event", "run"}, {"file", utf8_text(file)}, {"window_s", config.window_s}});
  };
  o.run.progress = [&](std::int64_t records) {
    if (std::exchange(on_disk, records) != records)
      events.put({{"event", "records"}, {"on_disk", records}});
  };
  std::exception_ptr failure;
  const ExitCode code = code_of([&] { return record_run(config, o.run, loop); }, failure);
  events.put({{"event", "end"},
              {"on_disk", std::max<std::int64_t>(on_disk, 0)},
              {"code", static_cast<int>(code)}});
  if (viewer && begun && code != ExitCode::interrupted) viewer->leave();
  events.end(failure);
  return code;
}

// Loads the configuration of a command that can run without one. Returns nothing if no file was
// found and neither --config nor --set was given.
std::optional<Config> load_if_any(const Options& o) {
  if (o.config.empty() && o.assignments.empty() && !find_config()) return std::nullopt;
  return load(o);
}

ExitCode devices(const Options& o) {
  catch_interrupts();
  port::SystemLoop loop;
  return list_devices(load_if_any(o), loop, o.json);
}

ExitCode doctor(Options& o) {
  catch_interrupts();
  const auto config = load_if_any(o);
  if (config) plan_count(o, *config);
  port::SystemLoop loop;
  return examine(config, {.count = o.run.count, .json = o.json}, loop);
}

ExitCode show_config(const Options& o) {
  const ConfigPlace place = place_of(o);
  const Config config = load_config(place.path, o.assignments);
  const std::string head = "# " + printable(place.path) + " (" + place.name + ")\n";
  std::fputs((head + config.shown).c_str(), stdout);
  return ExitCode::ok;
}

ExitCode check_config(const Options& o) {
  const ConfigPlace place = place_of(o);
  const Config config = load_config(place.path, o.assignments);
  if (!config.unfinished.empty()) refuse(config.unfinished);
  if (!config.radar.cli.empty())
    for (const auto& warning : parse_profile(config.radar).warnings)
      spdlog::warn("{}", printable(warning));
  std::printf("%s: ok\n", printable(place.path).c_str());
  return ExitCode::ok;
}

ExitCode info(const Options& o) {
  const std::string file = record::old_run(o.file);
  record::recover(file);
  const std::string text = describe_run(file, o.json);
  o.json ? static_cast<void>(std::fputs(text.c_str(), stdout)) : print(text);
  return ExitCode::ok;
}

ExitCode calibrate_sensors(Options& o) {
  CalibrateOptions& k = o.calibrate;
  if (o.reflector == "each") k.mounting = Mounting::each;
  if (!o.only.empty()) k.only = o.only == "spd" ? Sensor::spd : Sensor::radar;
  if (!o.side.empty()) k.side = o.side == "left" ? Side::left : Side::right;
  const Config config = load_config(place_of(o).path, o.assignments, k.check || k.side);
  o.calibrate.json = o.json;
  catch_interrupts();
  port::SystemLoop loop;
  return calibrate(config, o.calibrate, loop);
}

ExitCode annotate(const Options& o) {
  if (o.text.has_value() == o.label.has_value())
    throw Error(ExitCode::usage, "expected either TEXT or --label TEXT");
  if (o.text && o.text->find_first_not_of(" \t\r\n") == std::string::npos)
    throw Error(ExitCode::usage, "the note is empty");
  const std::string file = record::old_run(o.file);
  record::recover(file);
  std::printf("%s\n", printable_lines(annotate_run(file, o.text, o.label)).c_str());
  return ExitCode::ok;
}

ExitCode verdicts(const Options& o) {
  std::fputs(describe_verdicts(o.json).c_str(), stdout);
  return ExitCode::ok;
}

// Lists the runs in FOLDER. If FOLDER is not given, uses run.folder of the configuration, or the
// working directory if run.folder is not set.
ExitCode list(const Options& o) {
  std::string folder = o.folder;
  if (folder.empty()) {
    const auto config = load_if_any(o);
    folder = config && !config->run_folder.empty() ? config->run_folder : ".";
  }
  const Catalogue found = list_runs(folder, system_clock, o.json);
  o.json ? static_cast<void>(std::fputs(found.text.c_str(), stdout)) : print(found.text);
  if (!found.left_out.empty()) spdlog::warn("not listed: {}", found.left_out);
  return ExitCode::ok;
}

// Returns the configuration of `import`. If NumPy arrays are imported with --out, no configuration
// is needed. Otherwise --config is used if it is given. If --config is not given, a raw capture
// uses its own configuration, and any other import uses the first configuration file found, or the
// installed one.
Config config_of_import(const Options& o) {
  const std::string& first = o.import.files[0];
  if (o.config.empty() && is_kept(first)) return kept_config(first, o.assignments);
  if (std::filesystem::is_directory(first) && !is_kept(first) && !o.run.out.empty()) return {};
  const auto found = o.config.empty() ? find_config() : std::nullopt;
  return load_config(!o.config.empty() ? o.config
                     : found           ? found->path
                                       : (data_folder() / "lab.toml").string(),
                     o.assignments);
}

ExitCode import_files(Options& o) {
  const Config config = config_of_import(o);
  o.import.out = path_of(o.run.out, false, config);
  catch_interrupts();
  spdlog::info("{}", import_recordings(config, o.import));
  return ExitCode::ok;
}

ExitCode dispatch(const std::string& command, Options& o) {
  OutputQueue messages(STDERR_FILENO, [](std::size_t count) {
    return (isatty(STDERR_FILENO) ? "\r\033[K" : "") + std::to_string(count) +
           " log lines dropped (terminal blocked)\n";
  });
  set_up_log(o, messages);
  o.run.show_status = [&messages](std::string line) { messages.put(std::move(line), true); };
  if (command == "run") return run(o);
  if (command == "devices") return devices(o);
  if (command == "doctor") return doctor(o);
  if (command == "config check") return check_config(o);
  if (command == "config show") return show_config(o);
  if (command == "info") return info(o);
  if (command == "calibrate") return calibrate_sensors(o);
  if (command == "annotate") return annotate(o);
  if (command == "list") return list(o);
  if (command == "verdicts") return verdicts(o);
  return import_files(o);
}

int main(int argc, char** argv) {
  Options options;
  CLI::App app(
      "record data of a single-photon detector, a radar and a depth camera in one run file",
      program);
  app.set_version_flag("--version", version_line(program));
  add_commands(app, options);
  try {
    parse_command_line(app, argc, argv);
    if (app.get_subcommands().empty()) throw CLI::RequiredError("a command");
  } catch (const CLI::ParseError& e) {
    return run_main(program, [&] { return app.exit(e) == 0 ? ExitCode::ok : ExitCode::usage; });
  }
  return run_main(program, [&] { return dispatch(command_of(app), options); });
}

}  // namespace
}  // namespace echofuse::acquire

int main(int argc, char** argv) { return echofuse::acquire::main(argc, argv); }
