// SPDX-License-Identifier: MIT
#include "acquire/daemon.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <filesystem>
#include <utility>
#include <vector>

#include "acquire/devices.hpp"
#include "acquire/scheduler.hpp"
#include "acquire/status.hpp"
#include "acquire/window.hpp"
#include "acquire/writer.hpp"
#include "drivers/core/console.hpp"

namespace echofuse::acquire {
namespace {

constexpr auto tick_pause = std::chrono::milliseconds(50);
// What the devices sent while the file was being made is read before the first slot starts.
constexpr auto settle_time = std::chrono::milliseconds(100);
constexpr auto anchor_pause = std::chrono::minutes(1);

spdlog::level::level_enum level_of(Severity s) {
  constexpr spdlog::level::level_enum levels[] = {spdlog::level::info, spdlog::level::warn,
                                                  spdlog::level::err};
  return levels[static_cast<std::size_t>(s)];
}

void refuse_bad_target(const std::filesystem::path& out) {
  if (std::filesystem::exists(out))
    throw Error(ExitCode::failed, out.string() +
                                      ": exists already; runs are never overwritten, choose "
                                      "another name");
  if (!std::filesystem::is_directory(out.parent_path()))
    throw Error(ExitCode::disk, out.string() + ": its folder does not exist");
}

// Threading: everything runs on the thread that calls run(); drivers and the writer have threads of
// their own behind their interfaces.
class Daemon final : private SampleSink {
 public:
  Daemon(const Config& config, const RunOptions& options, const Clock& clock)
      : config_(config), options_(options), clock_(clock), devices_(io_, config, clock, *this) {}

  void run();

 private:
  struct Recording {  // exists from the first slot on
    Recording(const SlotGrid& grid, const Config& config, const RunOptions& options,
              std::unique_ptr<record::RunWriter> file)
        : scheduler(grid, Scheduler::default_grace(grid.length), options.count),
          windows(grid, config.histogram, config.configured()),
          writer(std::move(file)),
          status(grid.first, options.count, options.quiet) {}
    Scheduler scheduler;
    Windows windows;
    Writer writer;
    StatusLine status;
  };

  void on_tags(const TagBlock& block) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;

  void require_devices() const;
  void begin();
  void announce(Sensor sensor);
  void put_anchor();
  void log(Severity severity, const std::string& source, const std::string& text);
  void arm();
  void tick();
  void close_slot(const DueSlot& due, std::chrono::nanoseconds late);
  void note_change_of(const record::FusedRecord& record);
  void put_counters(std::array<std::vector<Counter>, sensor_count> counters, const Strays& strays);
  void end();

  boost::asio::io_context io_;  // first: destroyed last
  boost::asio::steady_timer timer_{io_};
  const Config& config_;
  const RunOptions& options_;
  const Clock& clock_;
  Devices devices_;
  std::optional<Recording> recording_;
  std::vector<std::string> axes_written_;
  std::array<std::string, sensor_count> identities_;  // of the devices written
  std::vector<Writer::Job> waiting_;                  // events from before the file existed
  HostTime anchor_mono_{};
  UtcTime anchor_utc_{};
  RunTotals totals_;
  std::uint32_t last_valid_ = 0;
};

void Daemon::run() {
  refuse_bad_target(options_.out);
  devices_.start();
  devices_.wait(config_.connect_timeout_s);
  require_devices();
  begin();
  io_.restart();
  arm();
  io_.run();
  end();
}

// Starts with what is there, and says what is not; with nothing there is nothing to start.
void Daemon::require_devices() const {
  if (interrupted())
    throw Error(ExitCode::interrupted, "interrupted before the first slot; nothing was recorded");
  std::string missing;
  bool any = false;
  for (const Sensor s : all_sensors) {
    any = any || devices_[s].delivers();
    if (devices_[s].configured && !devices_[s].delivers())
      missing += (missing.empty() ? "" : "\n") + devices_.describe(s);
  }
  if (!any)
    throw Error(ExitCode::device, "no device delivers after " +
                                      human_duration(config_.connect_timeout_s) + "\n" + missing);
  if (!missing.empty()) spdlog::warn("starting without {}", missing);
}

void Daemon::begin() {
  record::RunInfo info;
  info.config_text = config_.text;
  info.config_resolved = config_.resolved;
  info.radar_cfg = config_.radar.cfg_text;
  info.version = version();
  info.operator_name = config_.operator_name;
  info.window_s = config_.window_s;
  auto file = std::make_unique<record::RunWriter>(options_.out, info);
  const SlotGrid grid{clock_.now() + settle_time, from_seconds(config_.window_s)};
  recording_.emplace(grid, config_, options_, std::move(file));
  put_anchor();
  for (auto& job : std::exchange(waiting_, {})) recording_->writer.put(std::move(job));
  last_valid_ = config_.configured();
  for (const Sensor s : all_sensors)
    if (devices_[s].state == DeviceState::streaming)
      announce(s);
    else if (devices_[s].configured)
      log(Severity::warning, name_of(s), "not there at the start: " + devices_.describe(s));
  spdlog::info("recording into {}, slots of {} s", options_.out, config_.window_s);
}

// A device answers: its identity and axes go into the run.
void Daemon::announce(Sensor sensor) {
  const DeviceInfo& info = devices_[sensor].info;
  const std::string identity = info.address + '\n' + info.model + '\n' + info.serial + '\n' +
                               info.firmware;  // one row a device, not one a reconnection
  if (std::exchange(identities_[static_cast<std::size_t>(sensor)], identity) != identity)
    recording_->writer.put([info](record::RunWriter& run) { run.put_device(info); });
  if (!recording_->windows.announce(info))
    log(Severity::error, name_of(sensor), "came back with another axis; its samples are not used");
  for (const Axis& axis : recording_->windows.axes()) {
    if (std::find(axes_written_.begin(), axes_written_.end(), axis.name) != axes_written_.end())
      continue;
    axes_written_.push_back(axis.name);
    recording_->writer.put([axis](record::RunWriter& run) { run.put_axis(axis); });
  }
}

void Daemon::put_anchor() {
  anchor_mono_ = clock_.now();
  anchor_utc_ = clock_.utc();
  recording_->writer.put([mono = anchor_mono_, utc = anchor_utc_](record::RunWriter& run) {
    run.put_anchor(mono, utc);
  });
}

// Everything goes to the terminal; warnings and errors into the run as well.
void Daemon::log(Severity severity, const std::string& source, const std::string& text) {
  spdlog::log(level_of(severity), "{}: {}", source, text);
  if (severity == Severity::info) return;
  Writer::Job job = [=, utc = clock_.utc()](record::RunWriter& run) {
    run.put_event(utc, severity, source, text);
  };
  if (recording_)
    recording_->writer.put(std::move(job));
  else
    waiting_.push_back(std::move(job));
}

void Daemon::on_tags(const TagBlock& block) {
  if (!recording_) return;
  totals_.tags += block.tags.size();
  recording_->windows.add(block);
}

void Daemon::on_radar(RadarFrame frame) {
  if (!recording_) return;
  ++totals_.radar_frames;
  recording_->windows.add(frame);
}

void Daemon::on_depth(DepthFrame frame) {
  if (!recording_) return;
  ++totals_.depth_frames;
  recording_->windows.add(std::move(frame));
}

void Daemon::on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) {
  log(state == DeviceState::faulted ? Severity::warning : Severity::info, name_of(sensor),
      std::string(name_of(state)) + " " + info.address);
  if (!recording_) return;
  if (sensor == Sensor::spd) recording_->windows.tag_gap();
  if (state == DeviceState::streaming) announce(sensor);
}

void Daemon::on_event(Sensor sensor, Severity severity, const std::string& text) {
  log(severity, name_of(sensor), text);
}

void Daemon::arm() {
  const HostTime next = std::min(recording_->scheduler.next_deadline(), clock_.now() + tick_pause);
  timer_.expires_at(std::chrono::steady_clock::time_point(next));
  timer_.async_wait([this](const boost::system::error_code& error) {
    if (!error) tick();
  });
}

void Daemon::tick() {
  Recording& r = *recording_;
  const HostTime now = clock_.now();
  if (interrupted()) r.scheduler.finish(now);
  HostTime deadline = r.scheduler.next_deadline();
  for (const DueSlot& due : r.scheduler.tick(now)) {
    close_slot(due, now - deadline);
    deadline += r.scheduler.grid().length;
  }
  if (now - anchor_mono_ >= anchor_pause) put_anchor();
  totals_.written = r.writer.written();
  r.status.update(now, totals_);
  if (r.scheduler.done() || r.writer.failed())
    io_.stop();
  else
    arm();
}

void Daemon::close_slot(const DueSlot& due, std::chrono::nanoseconds late) {
  record::FusedRecord record = recording_->windows.close(due);
  record.books.closed_late_s = seconds(late);
  record.slot_utc = anchor_utc_ + (record.slot_start - anchor_mono_);
  record.label = config_.label;
  ++totals_.records;
  totals_.valid = record.valid;
  for (const auto& sync : record.sync) totals_.lost += sync.lost;
  spdlog::debug("record {}: valid {}, {} clicks, {} radar frames, {} depth frames", record.index,
                record.valid, record.sync[0].used, record.sync[1].used, record.sync[2].used);
  note_change_of(record);
  if (!recording_->writer.put(std::move(record)))
    log(Severity::error, "run file",
        "record " + std::to_string(due.index) + ": its data are given up, the disk is too slow");
}

// One line when a sensor drops out or comes back, not one for every record.
void Daemon::note_change_of(const record::FusedRecord& record) {
  for (const Sensor s : all_sensors) {
    const bool before = (last_valid_ >> static_cast<unsigned>(s)) & 1u;
    if (before == record.has(s)) continue;
    log(before ? Severity::warning : Severity::info, name_of(s),
        "record " + std::to_string(record.index) + ": " +
            record.sync[static_cast<std::size_t>(s)].verdict);
  }
  last_valid_ = record.valid;
}

// What of all that the devices sent is in no record, and why.
void Daemon::put_counters(std::array<std::vector<Counter>, sensor_count> counters,
                          const Strays& strays) {
  for (const Sensor s : all_sensors) {
    const auto i = static_cast<std::size_t>(s);
    counters[i].push_back({"late", strays.late[i]});
    counters[i].push_back({"outside", strays.outside[i]});
    counters[i].push_back({"duplicate", strays.duplicate[i]});
  }
  recording_->writer.put([counters = std::move(counters)](record::RunWriter& run) {
    for (const Sensor s : all_sensors)
      for (const Counter& c : counters[static_cast<std::size_t>(s)])
        run.put_counter(name_of(s), c.name, c.value);
  });
}

void Daemon::end() {
  Recording& r = *recording_;
  std::array<std::vector<Counter>, sensor_count> counters;
  for (const Sensor s : all_sensors) counters[static_cast<std::size_t>(s)] = devices_.counters(s);
  devices_.stop();
  r.windows.finish();
  const Strays& strays = r.windows.strays();
  put_counters(std::move(counters), strays);
  const auto count = [&](const char* what, const std::array<std::uint64_t, sensor_count>& n) {
    if (n[0] + n[1] + n[2] > 0)
      log(Severity::warning, "run",
          std::to_string(n[0]) + " tags, " + std::to_string(n[1]) + " radar frames, " +
              std::to_string(n[2]) + " depth frames " + what);
  };
  count("came after their slot was closed", strays.late);
  count("came twice", strays.duplicate);
  r.writer.finish("complete");
  totals_.written = r.writer.written();
  r.status.finish(clock_.now(), totals_);
  spdlog::info("{}: {} records, complete; arrived: {} tags, {} radar frames, {} depth frames",
               options_.out, totals_.written, devices_[Sensor::spd].samples,
               devices_[Sensor::radar].samples, devices_[Sensor::depth].samples);
}

}  // namespace

void record_run(const Config& config, const RunOptions& options, const Clock& clock) {
  Daemon(config, options, clock).run();
}

}  // namespace echofuse::acquire
