// SPDX-License-Identifier: MIT
#include "acquire/import/import.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <memory>
#include <regex>
#include <utility>

#include "acquire/import/imported_run.hpp"
#include "acquire/import/picoquant.hpp"
#include "acquire/import/radar_recording.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/run/daemon.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

// Plays a recording in virtual time, as a device that ends. Samples are delivered at the time of
// the previous ones.
class RecordedDevice final : public Driver {
 public:
  // `latest_s` is the latest plausible time of a sample. start() reports `doubt` as a warning if it
  // is not empty.
  RecordedDevice(port::Loop& loop, Recording& recording, double latest_s, std::string doubt)
      : timer_(loop),
        recording_(recording),
        device_(recording.device()),
        latest_s_(latest_s),
        doubt_(std::move(doubt)) {}
  void start(SampleSink& sink) override {
    if (!doubt_.empty()) sink.on_event(device_.sensor, Severity::warning, doubt_);
    sink.on_state(device_.sensor, DeviceState::streaming, device_);
    read(sink);
  }
  void stop() override { timer_.cancel(); }
  std::vector<Counter> counters() const override { return recording_.counters(); }

 private:
  void read(SampleSink& sink) {
    timer_.at(recording_.at(), [this, &sink] {
      const bool more = recording_.next(sink);
      if (seconds(recording_.at()) > latest_s_)
        throw Error(ExitCode::failed,
                    printable(device_.address) + ": its times reach " +
                        std::to_string(std::llround(seconds(recording_.at()))) +
                        " s, which gives more slots than the file has bytes; check whether a time "
                        "is damaged, or use a longer slot (--set run.window_s)");
      if (more) return read(sink);
      timer_.at(recording_.at(), [this, &sink] { end(sink); });
    });
  }
  void end(SampleSink& sink) {
    for (const std::string& text : recording_.doubts())
      sink.on_event(device_.sensor, Severity::warning, text);
    sink.on_state(device_.sensor, DeviceState::ended, device_);
  }
  port::Timer timer_;
  Recording& recording_;
  DeviceInfo device_;
  double latest_s_;
  std::string doubt_;
};

void take_cfg(Config& config, const std::string& recording, const std::string& cfg) {
  RegularFile(recording, ExitCode::failed);  // throws if the recording does not exist
  const std::string adjacent = fs::path(recording).replace_extension(".cfg").string();
  const std::string path =
      cfg.empty() && fs::exists(adjacent) ? adjacent : here_or_installed(cfg).string();
  // The configured cfg is not used, because the recording needs the cfg of its own board.
  if (path.empty())
    throw Error(ExitCode::config, printable(recording) +
                                      ": the board's .cfg is missing; copy it to " +
                                      printable(adjacent) + ", or give its path with --cfg");
  config.radar.cfg_name = path;
  config.radar.cfg_text = read_config_text(path);
  record::Antennas antennas;
  for (const auto& place : parse_profile(config.radar).array)
    antennas.push_back({.x = static_cast<double>(place.x), .y = static_cast<double>(place.y)});
  if (antennas.size() != config.antennas.size()) config.antennas = antennas;
}

using Recordings = PerSensor<std::unique_ptr<Recording>>;

// Returns one error for each recording that gives no valid record, one per line.
std::string empty_recordings(const record::RunReader& run, const Recordings& recordings) {
  const record::RunSummary made = run.summary();
  const record::FusedRecord last = run.read(made.records - 1);
  std::string out;
  for (const auto& recording : recordings) {
    if (!recording) continue;
    const DeviceInfo device = recording->device();
    if (made.valid[device.sensor] > 0 && recording->usable()) continue;
    out += (out.empty() ? "" : "\n") + printable(device.address) + ": nothing to import: ";
    for (const std::string& text : recording->doubts()) out += printable(text) + "; ";
    out += last.sync[device.sensor].text();
  }
  return out;
}

// Imports recordings, which may differ in length. Records after the end of a recording contain no
// data of its sensor.
std::string import_streams(const Config& config, const ImportOptions& options,
                           const RunStart& began, const Recordings& recordings) {
  // Latest plausible time of a sample: 1000 slots, plus one slot per byte of the files, because no
  // recorder writes less than a byte per slot.
  double latest_s = 1000 * config.window_s;
  std::string names, doubt = began.doubt;
  for (const auto& file : options.files) {
    names.append(names.empty() ? "" : " ").append(fs::path(file).filename().string());
    latest_s += static_cast<double>(fs::file_size(file)) * config.window_s;
  }
  if (options.files.size() > 1)
    doubt += (doubt.empty() ? "" : "; ") +
             std::string("both recordings are assumed to begin at the same time");
  refuse_bad_target(options.out);
  NewFile file(options.out, NewFile::Staged{});
  port::VirtualLoop loop(began.utc, HostTime{});
  RunOptions run;
  run.meta = {{"imported_from", names}};
  run.kept_slot = loop.now();
  run.recording = [&](Sensor s) {
    return std::make_unique<RecordedDevice>(loop, *recordings[s], latest_s,
                                            std::exchange(doubt, {}));
  };
  record_import(config, run, loop, file);
  const std::string nothing = empty_recordings(record::RunReader(file.path()), recordings);
  const bool all = std::ranges::count(nothing, '\n') + 1 == std::ssize(options.files);
  if (!nothing.empty() && all) throw Error(ExitCode::failed, nothing);
  const std::string made = publish_import(file);
  if (!nothing.empty()) throw Error(ExitCode::partial, made + "\n" + nothing);
  return made;
}

}  // namespace

UtcTime parse_utc(const std::string& text) {
  static const std::regex pattern(R"((\d{4})-(\d{1,2})-(\d{1,2}))"
                                  R"((?:[T ](\d{1,2}):(\d{1,2}):(\d{1,2})(\.\d+)?)?)"
                                  R"((?:Z|([+-])(\d\d):?(\d\d))?)");
  std::smatch part;
  const bool matches = std::regex_match(text, part, pattern);
  const auto number = [&](std::size_t i) {
    return matches && part[i].matched ? std::stoi(part[i]) : 0;
  };
  std::tm tm{};
  tm.tm_year = number(1) - 1900, tm.tm_mon = number(2) - 1, tm.tm_mday = number(3);
  tm.tm_hour = number(4), tm.tm_min = number(5), tm.tm_sec = number(6);
  const std::time_t local_s = ::timegm(&tm);  // changes the day if the date does not exist
  if (tm.tm_year < 70 || tm.tm_year > 350 || tm.tm_mday != number(3) || number(2) > 12 ||
      number(4) > 23 || number(5) > 59 || number(6) > 60 || number(9) > 14 || number(10) > 59)
    throw Error(ExitCode::usage, printable(text) + ": expected a time such as " +
                                     "2024-02-07T12:34:56Z or 2024-02-07T13:34:56+01:00");
  const auto east = (part[8] == "-" ? -1 : 1) *
                    (std::chrono::hours(number(9)) + std::chrono::minutes(number(10)));
  return std::chrono::seconds(local_s) - east +
         from_seconds(part[7].matched ? std::stod(part[7]) : 0);
}

namespace {

std::string lower_case_extension(const std::string& path) {
  std::string out = fs::path(path).extension().string();
  std::transform(out.begin(), out.end(), out.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return out;
}

[[noreturn]] void refuse_kind(const std::string& path, const std::string& kind) {
  throw Error(ExitCode::usage,
              printable(path) +
                  (kind == ".ttbin"   ? ": only the Time Tagger library can read .ttbin; start "
                                        "`echofuse-bridge-timetagger --file FILE` and record from it"
                   : kind == ".phu"   ? ": .phu files cannot be imported; convert the histograms "
                                        "with echofuse.write_run (Python) or to a folder of arrays"
                   : fs::exists(path) ? ": expected NAME.dat (radar), NAME.ptu or one folder"
                                      : ": no such file or folder"));
}

std::string import_folder(Config config, const ImportOptions& options) {
  const std::string& folder = options.files[0];
  const bool kept = is_kept(folder);
  if (!options.cfg.empty()) throw Error(ExitCode::usage, "--cfg cannot be used with a folder");
  if (!kept && !fs::exists(fs::path(folder) / "run.toml"))
    throw Error(ExitCode::failed, printable(folder) +
                                      ": contains neither run.toml (arrays) nor "
                                      "run.times (raw capture)");
  if (kept && !options.began.empty())
    throw Error(ExitCode::usage,
                "--began cannot be used with raw captures, because they contain the start time");
  if (kept) return import_kept(std::move(config), folder, options.out);
  return import_arrays(
      folder, options.out,
      options.began.empty() ? std::nullopt : std::optional(parse_utc(options.began)));
}

}  // namespace

std::string import_recordings(Config config, const ImportOptions& options) {
  if (options.files.size() == 1 && fs::is_directory(options.files[0]))
    return import_folder(std::move(config), options);
  config.tdc.address = config.radar.cli = config.radar.data = config.depth.address = "";
  config.radar.address = "";
  Recordings recordings;
  RunStart began;
  if (!options.began.empty()) began.utc = parse_utc(options.began);
  const auto begins = [&](std::optional<UtcTime> utc, const std::string& doubt) {
    if (options.began.empty() && began.doubt.empty() && utc) began = {*utc, doubt};
  };
  constexpr const char* local_time =
      "start time: taken from the PicoQuant file as local time of this machine; set it "
      "with --began UTC";
  constexpr const char* ambiguous_local_time =
      "start time: taken from the PicoQuant file as local time, which occurred twice at the end of "
      "summer time; the true start may be an hour later; set it with --began UTC";
  for (const std::string& path : options.files) {
    const std::string kind = lower_case_extension(path);
    if (kind == ".dat") {
      if (!config.radar.data.empty())
        throw Error(ExitCode::usage, "two radar recordings; expected one per sensor");
      config.radar.cli = config.radar.data = path;
      take_cfg(config, path, options.cfg);
      recordings[Sensor::radar] =
          std::make_unique<RadarRecording>(path, parse_profile(config.radar));
    } else if (kind == ".ptu") {
      if (!config.tdc.address.empty())
        throw Error(ExitCode::usage, "two time tagger recordings; expected one per sensor");
      config.tdc.address = path;
      config.histogram.start_channel = options.start;
      config.histogram.click_channel = options.click;
      auto tags = std::make_unique<PicoquantTags>(path, config.histogram);
      begins(tags->began(), tags->has_ambiguous_start() ? ambiguous_local_time : local_time);
      recordings[Sensor::spd] = std::move(tags);
    } else {
      refuse_kind(path, kind);
    }
  }
  begins(config.radar.data.empty() ? std::optional(modified(config.tdc.address)) : std::nullopt,
         "start time unknown: the file's modification time is used; set it with --began UTC");
  // The file was last modified at the end of the recording, so the start time is the modification
  // time minus the duration of the recording.
  if (options.began.empty() && began.doubt.empty()) {
    RadarRecording whole(config.radar.data, parse_profile(config.radar));
    SampleSink no_sink;
    while (whole.next(no_sink)) {
    }
    begins(modified(config.radar.data) - whole.at(),
           "start time unknown: the file's modification time is used as the end time; set the "
           "start with --began UTC");
  }
  return import_streams(config, options, began, recordings);
}

}  // namespace echofuse::acquire
