// SPDX-License-Identifier: MIT
#include "acquire/import/import.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <functional>
#include <memory>
#include <utility>

#include "acquire/import/picoquant.hpp"
#include "acquire/import/radar_recording.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/run/clock_fit.hpp"
#include "acquire/run/resume.hpp"
#include "acquire/run/signal_check.hpp"
#include "acquire/run/window.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/program.hpp"
#include "drivers/program/regular_file.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;

// The time of the recording, for the file that is made of it.
class RecordingClock final : public Clock {
 public:
  explicit RecordingClock(UtcTime began) : began_(began) {}
  HostTime now() const override { return now_; }
  UtcTime utc() const override { return began_ + now_; }
  void set(HostTime now) { now_ = now; }

 private:
  UtcTime began_;
  HostTime now_{};
};

struct Beginning {
  UtcTime utc{};
  std::string doubt;  // empty: it was given
};

UtcTime modified(const std::string& path) {
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) return {};
  return std::chrono::seconds(found.st_mtim.tv_sec) +
         std::chrono::nanoseconds(found.st_mtim.tv_nsec);
}

// One run that grows out of recordings.
class Import {
 public:
  Import(const Config& config, const ImportOptions& options, const Beginning& began)
      : file_((refuse_bad_target(options.out), options.out), NewFile::Staged{}),
        clock_(began.utc),
        signal_(config.signal, config.window_s) {
    std::string names;
    for (const auto& file : options.files)
      names.append(names.empty() ? "" : " ").append(fs::path(file).filename().string());
    refuse_late_clock(began.utc);
    run_ = make_run(config, file_.path(), {{"imported_from", names}}, "", clock_);
    for (const Sensor s : all_sensors)
      if (config.configured().contains(s)) run_->put_policy(s, "optional");
    run_->put_anchor({}, began.utc);
    if (!began.doubt.empty()) doubt(began.doubt);
  }

  void put_device(const DeviceInfo& device) { run_->put_device(device); }
  void put_axes(const std::vector<Axis>& axes) {
    axes_ = axes;
    for (const Axis& axis : axes_) run_->put_axis(axis);
  }
  void put(record::FusedRecord record, const std::string& label) {
    signal_.judge(record, axes_);
    record.label = label;
    clock_.set(std::max(clock_.now(), record.slot_end));
    for (const Sensor s : all_sensors) {
      valid_[s] += record.has(s);
      if (!record.has(s)) verdict_[s] = record.sync[s].verdict;
    }
    tags_ += record.spd_counts;
    values_ += record.spd.size() + record.radar.size() + record.array.size();
    batch_.push_back(std::move(record));
    if (constexpr std::size_t most = 256, most_values = 1 << 20;
        batch_.size() == most || values_ > most_values)
      flush();
  }
  void doubt(const std::string& text) {
    run_->put_event(clock_.utc(), Severity::warning, "import", text);
    lines_.append("\n").append(printable(text));
  }
  void put_counters(Sensor sensor, const std::vector<Counter>& counters) {
    for (const Counter& c : counters) counted_.push_back({name_of(sensor), c.name, c.value});
  }
  // True if any record has data of this sensor.
  bool has(Sensor s) const {
    return s == Sensor::spd ? tags_.in_range + tags_.out_of_range > 0 : valid_[s] > 0;
  }
  const std::string& verdict(Sensor s) const { return verdict_[s]; }
  std::string finish() {
    flush();
    if (tags_.out_of_range > 0 && tags_.in_range == 0)
      doubt("spd: no click lies within tdc.first_bin_ps and tdc.bins");
    if (has(Sensor::spd) && valid_[Sensor::spd] == 0)
      doubt("spd: no record is valid: " + verdict_[Sensor::spd]);
    run_->put_counters(counted_);
    const std::string records = std::to_string(run_->records());
    run_->close_as_one_file("complete");
    file_.publish();
    std::string counts;
    for (const Sensor s : all_sensors)
      if (valid_[s] > 0)
        counts.append(", ").append(name_of(s)).append(" in ").append(std::to_string(valid_[s]));
    return printable(file_.place()) + ": " + records + " records" + counts + lines_;
  }
  UtcTime utc_of(HostTime t) const { return clock_.utc() - clock_.now() + t; }

 private:
  void flush() {  // in one transaction: each waits for the disk
    run_->append(batch_);
    batch_.clear(), values_ = 0;
  }

  NewFile file_;
  RecordingClock clock_;
  SignalCheck signal_;
  std::unique_ptr<record::RunWriter> run_;
  std::vector<Axis> axes_;
  std::vector<record::Counted> counted_;
  PerSensor<std::int64_t> valid_{};
  TagCounts tags_;
  PerSensor<std::string> verdict_{};        // verdict of the last record without the sensor
  std::vector<record::FusedRecord> batch_;  // not yet written
  std::size_t values_ = 0;                  // in it
  std::string lines_;
};

// Samples of recordings into slots.
class Slots final : public SampleSink {
 public:
  Slots(const Config& config, const SlotGrid& grid)
      : grid_(grid), windows_(grid, config.histogram, clocks_, config.configured()) {}
  void on_tags(const TagBlock& block) override {
    clocks_.observe(block);
    windows_.add(block);
  }
  void on_radar(RadarFrame frame) override { windows_.add(frame); }  // dated by its clock already
  Windows& windows() { return windows_; }
  // All that ended by then, and with `last` the slot that runs.
  void close(HostTime now, bool last, const std::function<void(record::FusedRecord)>& take) {
    for (; grid_.end(next_) <= now || (last && grid_.start(next_) <= now); ++next_) {
      if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; nothing was written");
      take(windows_.close({next_, false}));
    }
  }

 private:
  SlotGrid grid_;
  SensorClocks clocks_;
  Windows windows_;
  std::int64_t next_ = 0;
};

void take_cfg(Config& config, const std::string& recording, const std::string& cfg) {
  const std::string beside = fs::path(recording).replace_extension(".cfg").string();
  const std::string path =
      cfg.empty() && fs::exists(beside) ? beside : here_or_installed(cfg).string();
  if (path.empty()) {
    config.radar.cfg_text.clear();  // the board's own is needed, not any
  } else {
    config.radar.cfg_name = path;
    config.radar.cfg_text = RegularFile(path, ExitCode::config).rest<std::string>(1 << 20);
  }
  if (config.radar.cfg_text.empty())
    throw Error(ExitCode::config, printable(recording) + ": without the .cfg that the board had; " +
                                      "put it beside as " + printable(beside) +
                                      ", or name it by --cfg");
  record::Antennas antennas;
  for (const auto& place : parse_profile(config.radar).array)
    antennas.push_back({.x = static_cast<double>(place.x), .y = static_cast<double>(place.y)});
  if (antennas.size() != config.antennas.size()) config.antennas = antennas;
}

// The recording that ends first is closed by the other; what is missing is marked by its absence.
std::string import_streams(const Config& config, const ImportOptions& options,
                           const Beginning& began,
                           const std::vector<std::unique_ptr<Recording>>& recordings) {
  Import import(config, options, began);
  Slots slots(config, {HostTime{}, from_seconds(config.window_s)});
  double longest_s = 1000 * config.window_s;  // and a slot a byte, of which no recorder writes less
  for (const auto& file : options.files)
    longest_s += static_cast<double>(fs::file_size(file)) * config.window_s;
  for (const auto& r : recordings) {
    import.put_device(r->device());
    slots.windows().announce(r->device());
  }
  import.put_axes(slots.windows().axes());
  const auto take = [&](record::FusedRecord record) {
    record.slot_utc = import.utc_of(record.slot_start);
    import.put(std::move(record), config.label);
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
                      " s, more slots than it has bytes: is one damaged? A longer slot (--set "
                      "run.window_s) makes fewer");
    if (more)
      slots.close(now, false, take);
    else
      running.erase(behind);
  }
  HostTime end{};
  for (const auto& r : recordings) end = std::max(end, r->at());
  slots.close(end, true, take);
  slots.windows().finish();
  std::string nothing;  // texts of recordings that gave no record anything
  std::size_t empty = 0;
  for (const auto& r : recordings) {
    const DeviceInfo device = r->device();
    import.put_counters(device.sensor, r->counters());
    std::string causes;
    for (const auto& text : r->doubts()) {
      import.doubt(std::string(name_of(device.sensor)) + ": " + text);
      causes += (causes.empty() ? "" : "; ") + text;
    }
    if (import.has(device.sensor)) continue;
    ++empty;
    const std::string& verdict = import.verdict(device.sensor);
    nothing += (nothing.empty() ? "" : "\n") + printable(device.address) + ": nothing to import: " +
               printable(causes + (causes.empty() || verdict.empty() ? "" : "; ") + verdict);
  }
  if (empty == recordings.size()) throw Error(ExitCode::failed, nothing);
  if (recordings.size() > 1)
    import.doubt("that the recordings begin at the same time is taken for granted");
  const std::string made = import.finish();
  if (empty > 0) throw Error(ExitCode::partial, made + "\n" + nothing);
  return made;
}

std::string import_histograms(Config config, const ImportOptions& options,
                              const PicoquantHistograms& histograms, const Beginning& began) {
  const double length_s = histograms.curves.front().length_s;
  if (!(length_s >= 1e-3 && length_s * static_cast<double>(histograms.curves.size()) < 1e9))
    throw Error(ExitCode::failed, printable(options.files[0]) + ": its acquisition time cannot be");
  config.window_s = length_s;
  Import import(config, options, began);
  import.put_device(histograms.device);
  import.put_axes(histograms.device.axes);
  const SlotGrid grid{HostTime{}, from_seconds(length_s)};
  for (std::size_t i = 0; i < histograms.curves.size(); ++i) {
    const PicoquantCurve& curve = histograms.curves[i];
    record::FusedRecord r;
    r.index = static_cast<std::int64_t>(i);
    r.slot_start = grid.start(r.index);
    r.slot_end = grid.end(r.index);
    r.slot_utc =
        curve.recorded && options.began.empty() ? *curve.recorded : import.utc_of(r.slot_start);
    r.spd = curve.counts;
    r.spd.resize(histograms.device.axes[0].count);
    for (const Sensor s : all_sensors) r.sync[s].verdict = "not configured";
    for (const std::uint32_t n : curve.counts) r.spd_counts.in_range += n;
    const std::uint64_t clicks = r.spd_counts.tags = r.spd_counts.in_range;
    r.valid.insert(Sensor::spd);
    r.sync[Sensor::spd] = {0, length_s, clicks, 0, "ok"};
    if (curve.sync_hz && *curve.sync_hz > 0)
      r.signal.clicks_a_pulse = static_cast<double>(clicks) / (*curve.sync_hz * length_s);
    import.put(std::move(r), config.label);
  }
  import.doubt("spd: histograms of another program: neither starts nor lost events are known");
  return import.finish();
}

}  // namespace

UtcTime parse_utc(const std::string& text) {
  std::tm tm{};
  const char* rest = ::strptime(text.c_str(), "%Y-%m-%d", &tm);
  if (rest && (*rest == 'T' || *rest == ' ')) rest = ::strptime(rest + 1, "%H:%M:%S", &tm);
  double fraction = 0;
  if (rest && *rest == '.') {
    char* end = nullptr;
    fraction = std::strtod(rest, &end);
    rest = end;
  }
  if (!rest || (*rest != '\0' && std::string(rest) != "Z") || tm.tm_year < 70 || tm.tm_year > 350)
    throw Error(ExitCode::usage, text + ": expected a time like 2024-02-07T12:34:56Z");
  return std::chrono::seconds(::timegm(&tm)) + from_seconds(fraction);
}

std::string import_recordings(Config config, const ImportOptions& options) {
  const auto kind_of = [](const std::string& path) {
    std::string kind = fs::path(path).extension().string();
    std::transform(kind.begin(), kind.end(), kind.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    return kind;
  };
  const bool folder = options.files.size() == 1 && fs::is_directory(options.files[0]);
  const bool kept = folder && is_kept(options.files[0]);
  if (folder && !options.cfg.empty())
    throw Error(ExitCode::usage, "--cfg does not go with a folder");
  if (kept && !options.began.empty())
    throw Error(ExitCode::usage, "--began does not go with kept bytes, which tell their times");
  if (kept) return import_kept(std::move(config), options.files[0], options.out);
  if (folder)
    return import_arrays(options.files[0], options.out,
                         options.began.empty() ? UtcTime{} : parse_utc(options.began));
  config.tdc.address = config.radar.cli = config.radar.data = config.depth.address = "";
  config.policy = {"optional", "optional", "optional"};
  std::vector<std::unique_ptr<Recording>> recordings;
  Beginning began;
  if (!options.began.empty()) began.utc = parse_utc(options.began);
  const auto begins = [&](std::optional<UtcTime> utc, const std::string& doubt) {
    if (options.began.empty() && began.doubt.empty() && utc) began = {*utc, doubt};
  };
  constexpr const char* local_time =
      "when it began is PicoQuant's local time, taken in this machine's time zone; --began UTC "
      "says "
      "it exactly";
  for (const std::string& path : options.files) {
    const std::string kind = kind_of(path);
    if (kind == ".dat") {
      if (!config.radar.data.empty())
        throw Error(ExitCode::usage, "two recordings of a radar; expected one of each sensor");
      config.radar.cli = config.radar.data = path;
      take_cfg(config, path, options.cfg);
      recordings.push_back(std::make_unique<RadarRecording>(path, parse_profile(config.radar)));
    } else if (kind == ".ptu" || kind == ".phu") {
      if (!config.tdc.address.empty() || (kind == ".phu" && options.files.size() > 1))
        throw Error(ExitCode::usage, kind == ".phu" ? "a .phu is imported by itself"
                                                    : "two recordings of a time tagger; expected "
                                                      "one of each sensor");
      config.tdc.address = path;
      if (kind == ".phu") {
        const PicoquantHistograms histograms = read_histograms(path);
        begins(histograms.curves.front().recorded, local_time);
        begins(modified(path), "when it began is not known: the file's time is taken");
        return import_histograms(config, options, histograms, began);
      }
      config.histogram.start_channel = options.start;
      config.histogram.click_channel = options.click;
      auto tags = std::make_unique<PicoquantTags>(path, config.histogram);
      begins(tags->began(), local_time);
      recordings.push_back(std::move(tags));
    } else {
      throw Error(ExitCode::usage,
                  printable(path) +
                      (kind == ".ttbin"   ? ": only the Time Tagger's library reads .ttbin: start "
                                            "`echofuse-bridge-timetagger --file` with it and record"
                       : fs::exists(path) ? ": expected NAME.dat (radar), NAME.ptu, NAME.phu or "
                                            "one folder"
                                          : ": no such file or folder"));
    }
  }
  begins(config.radar.data.empty() ? std::optional(modified(config.tdc.address)) : std::nullopt,
         "when it began is not known: the file's time is taken; --began UTC says it");
  if (options.began.empty() && began.doubt.empty()) {  // a file is written until its end
    RadarRecording whole(config.radar.data, parse_profile(config.radar));
    SampleSink nobody;
    while (whole.next(nobody)) {
    }
    begins(modified(config.radar.data) - whole.at(),
           "when it began is not known: the file's time is taken for its end; --began UTC says it");
  }
  return import_streams(config, options, began, recordings);
}

}  // namespace echofuse::acquire
