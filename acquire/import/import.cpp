// SPDX-License-Identifier: MIT
#include "acquire/import/import.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <functional>
#include <memory>
#include <utility>

#include "acquire/import/imported_run.hpp"
#include "acquire/import/picoquant.hpp"
#include "acquire/import/radar_recording.hpp"
#include "acquire/intake/clock_fit.hpp"
#include "acquire/intake/tag_check.hpp"
#include "acquire/intake/window.hpp"
#include "acquire/run/new_run.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

// Sorts the samples of recordings into slots.
class Slots final : public SampleSink {
 public:
  Slots(const Config& config, const SlotGrid& grid)
      : grid_(grid),
        tag_check_(config.histogram, false,
                   [this](const std::string& text) { tag_faults_.push_back(text); }),
        windows_(grid, config.histogram, clocks_, config.configured()) {}
  void on_tags(const TagBlock& block) override {
    tag_check_.take(block, [this](const TagBlock& repaired) { take_tags(repaired); });
  }
  // Adds the frame unchanged, because RadarRecording has already derived its time from the board's
  // clock.
  void on_radar(RadarFrame frame) override { windows_.add(frame); }
  Windows& windows() { return windows_; }
  void flush() {
    tag_check_.flush([this](const TagBlock& rest) { take_tags(rest); });
  }
  const std::vector<std::string>& finish() {
    windows_.finish();
    tag_check_.finish();
    return tag_faults_;
  }
  // Closes the slots that have ended by `now`. If `last` is true, also closes the slot that
  // contains `now`.
  void close(HostTime now, bool last, const std::function<void(record::FusedRecord)>& take) {
    for (; grid_.end(next_) <= now || (last && grid_.start(next_) <= now); ++next_) {
      if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
      take(windows_.close({next_, false}));
    }
  }

 private:
  void take_tags(const TagBlock& block) {
    clocks_.observe(block);
    windows_.add(block);
  }
  SlotGrid grid_;
  std::vector<std::string> tag_faults_;
  TagCheck tag_check_;
  SensorClocks clocks_;
  Windows windows_;
  std::int64_t next_ = 0;
};

void take_cfg(Config& config, const std::string& recording, const std::string& cfg) {
  const std::string adjacent = fs::path(recording).replace_extension(".cfg").string();
  const std::string path =
      cfg.empty() && fs::exists(adjacent) ? adjacent : here_or_installed(cfg).string();
  if (path.empty()) {
    // The configured cfg is not used, because the recording needs the cfg of its own board.
    config.radar.cfg_text.clear();
  } else {
    config.radar.cfg_name = path;
    config.radar.cfg_text = RegularFile(path, ExitCode::config).rest<std::string>(1 << 20);
  }
  if (config.radar.cfg_text.empty())
    throw Error(ExitCode::config, printable(recording) +
                                      ": the board's .cfg is missing; copy it to " +
                                      printable(adjacent) + ", or give its path with --cfg");
  record::Antennas antennas;
  for (const auto& place : parse_profile(config.radar).array)
    antennas.push_back({.x = static_cast<double>(place.x), .y = static_cast<double>(place.y)});
  if (antennas.size() != config.antennas.size()) config.antennas = antennas;
}

// Stores the counters and warnings of each recording, then finishes the run. Returns the result of
// ImportedRun::finish().
std::string conclude(ImportedRun& import, const std::vector<std::unique_ptr<Recording>>& recordings,
                     const std::vector<std::string>& faults) {
  for (const auto& text : faults) import.doubt("spd: " + text);
  std::string nothing;  // errors of recordings without a valid record
  std::size_t empty = 0;
  for (const auto& r : recordings) {
    const DeviceInfo device = r->device();
    import.put_counters(device.sensor, r->counters());
    std::string causes;
    for (const auto& text : r->doubts()) {
      if (std::ranges::find(faults, text) == faults.end())
        import.doubt(std::string(name_of(device.sensor)) + ": " + text);
      causes += (causes.empty() ? "" : "; ") + text;
    }
    const bool events = import.tags().in_range + import.tags().out_of_range > 0;
    if (import.valid(device.sensor) > 0 && (device.sensor != Sensor::spd || events)) continue;
    ++empty;
    const std::string& cause = import.cause(device.sensor);
    if (!nothing.empty()) nothing += '\n';
    nothing += printable(device.address) + ": nothing to import: " +
               printable(causes + (causes.empty() || cause.empty() ? "" : "; ") + cause);
  }
  if (empty == recordings.size()) throw Error(ExitCode::failed, nothing);
  if (recordings.size() > 1) import.doubt("the recordings are assumed to begin at the same time");
  if (import.tags().out_of_range > 0 && import.tags().in_range == 0)
    import.doubt("spd: no click is within the histogram (tdc.first_bin_ps, tdc.bins)");
  const std::string made = import.finish();
  if (empty > 0) throw Error(ExitCode::partial, made + "\n" + nothing);
  return made;
}

// Imports recordings, which may differ in length. Records after the end of a recording contain no
// data of its sensor.
std::string import_streams(const Config& config, const ImportOptions& options,
                           const RunStart& began,
                           const std::vector<std::unique_ptr<Recording>>& recordings) {
  std::string names;
  for (const auto& file : options.files)
    names.append(names.empty() ? "" : " ").append(fs::path(file).filename().string());
  ImportedRun import(options.out, began,
                     SignalCheck(config.signal, config.window_s, config.nominal_hz()),
                     [&](const std::string& path, const Clock& clock) {
                       return make_run(config, path, {{"imported_from", names}}, "", clock);
                     });
  for (const Sensor s : all_sensors)
    if (config.configured().contains(s)) import.writer().put_policy(s, "optional");
  Slots slots(config, {HostTime{}, from_seconds(config.window_s)});
  // Latest plausible time of a sample: 1000 slots, plus one slot per byte of the files, because no
  // recorder writes less than a byte per slot.
  double longest_s = 1000 * config.window_s;
  for (const auto& file : options.files)
    longest_s += static_cast<double>(fs::file_size(file)) * config.window_s;
  for (const auto& r : recordings) {
    import.writer().put_device(r->device());
    slots.windows().announce(r->device());
  }
  import.put_axes(slots.windows().axes());
  SignalCheck::RecordingEnds ends;
  const auto take = [&](record::FusedRecord record) {
    record.slot_utc = import.utc_of(record.slot_start);
    record.label = config.label;
    import.put(std::move(record), ends);
  };
  std::vector<Recording*> running;
  for (const auto& r : recordings) running.push_back(r.get());
  while (!running.empty()) {
    if (interrupted()) throw Error(ExitCode::interrupted, "interrupted");
    const auto behind = std::min_element(running.begin(), running.end(),
                                         [](auto* a, auto* b) { return a->at() < b->at(); });
    const HostTime now = (*behind)->at();
    const bool more = (*behind)->next(slots);
    if (seconds((*behind)->at()) > longest_s)
      throw Error(ExitCode::failed,
                  printable((*behind)->device().address) + ": its times reach " +
                      std::to_string(std::llround(seconds((*behind)->at()))) +
                      " s, which gives more slots than the file has bytes; check whether a time is "
                      "damaged, or use a longer slot (--set run.window_s)");
    if (more) {
      slots.close(now, false, take);
    } else {
      slots.flush();
      ends[(*behind)->device().sensor] = (*behind)->at();
      running.erase(behind);
    }
  }
  HostTime end{};
  for (const auto& r : recordings) end = std::max(end, r->at());
  slots.close(end, true, take);
  return conclude(import, recordings, slots.finish());
}

}  // namespace

UtcTime parse_utc(const std::string& text) {
  const Error refused(ExitCode::usage, printable(text) + ": expected a time such as " +
                                           "2024-02-07T12:34:56Z or 2024-02-07T13:34:56+01:00");
  std::tm tm{};
  const char* rest = ::strptime(text.c_str(), "%Y-%m-%d", &tm);
  const int day = tm.tm_mday;
  if (rest && (*rest == 'T' || *rest == ' ')) rest = ::strptime(rest + 1, "%H:%M:%S", &tm);
  if (!rest || tm.tm_year < 70 || tm.tm_year > 350) throw refused;
  double fraction = 0;
  if (*rest == '.') {
    const std::size_t digits = std::strspn(rest + 1, "0123456789");
    if (digits == 0) throw refused;
    fraction = std::strtod(std::string(rest, digits + 1).c_str(), nullptr);
    rest += digits + 1;
  }
  const std::time_t local_s = ::timegm(&tm);
  std::chrono::minutes east{};
  if (*rest == '+' || *rest == '-') {
    int hours = 0, minutes = 0, read = 0;
    const char* const pattern = std::strchr(rest, ':') ? "%2d:%2d%n" : "%2d%2d%n";
    if (std::sscanf(rest + 1, pattern, &hours, &minutes, &read) < 2 || hours < 0 || hours > 14 ||
        minutes < 0 || minutes > 59)
      throw refused;
    east = (*rest == '-' ? -1 : 1) * (std::chrono::hours(hours) + std::chrono::minutes(minutes));
    rest += 1 + read;
  } else if (*rest == 'Z') {
    ++rest;
  }
  if (*rest != '\0' || tm.tm_mday != day) throw refused;  // also rejects dates such as 30 February
  return std::chrono::seconds(local_s) - east + from_seconds(fraction);
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

// Imports a raw capture of `run --keep-raw`, or a folder of arrays.
std::string import_folder(Config config, const ImportOptions& options) {
  const std::string& folder = options.files[0];
  const bool kept = is_kept(folder);
  if (!options.cfg.empty()) throw Error(ExitCode::usage, "--cfg cannot be used with a folder");
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
  config.policy = {"optional", "optional", "optional"};
  std::vector<std::unique_ptr<Recording>> recordings;
  RunStart began;
  if (!options.began.empty()) began.utc = parse_utc(options.began);
  const auto begins = [&](std::optional<UtcTime> utc, const std::string& doubt) {
    if (options.began.empty() && began.doubt.empty() && utc) began = {*utc, doubt};
  };
  constexpr const char* local_time =
      "start time: taken from the PicoQuant file as local time of this machine; set it "
      "with --began UTC";
  constexpr const char* local_time_twice =
      "start time: taken from the PicoQuant file as local time, which occurred twice at the end of "
      "summer time; the true start may be an hour later; set it with --began UTC";
  for (const std::string& path : options.files) {
    const std::string kind = lower_case_extension(path);
    if (kind == ".dat") {
      if (!config.radar.data.empty())
        throw Error(ExitCode::usage, "two radar recordings; expected one per sensor");
      config.radar.cli = config.radar.data = path;
      take_cfg(config, path, options.cfg);
      recordings.push_back(std::make_unique<RadarRecording>(path, parse_profile(config.radar)));
    } else if (kind == ".ptu") {
      if (!config.tdc.address.empty())
        throw Error(ExitCode::usage, "two time tagger recordings; expected one per sensor");
      config.tdc.address = path;
      config.histogram.start_channel = options.start;
      config.histogram.click_channel = options.click;
      auto tags = std::make_unique<PicoquantTags>(path, config.histogram);
      begins(tags->began(), tags->began_twice() ? local_time_twice : local_time);
      recordings.push_back(std::move(tags));
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
    SampleSink nobody;
    while (whole.next(nobody)) {
    }
    begins(modified(config.radar.data) - whole.at(),
           "start time unknown: the file's modification time is used as the end time; set the "
           "start with --began UTC");
  }
  return import_streams(config, options, began, recordings);
}

}  // namespace echofuse::acquire
