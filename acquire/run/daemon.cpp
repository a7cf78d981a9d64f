// SPDX-License-Identifier: MIT
#include "acquire/run/daemon.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <utility>

#include "acquire/intake/intake.hpp"
#include "acquire/intake/scheduler.hpp"
#include "acquire/record/columns.hpp"
#include "acquire/run/disk.hpp"
#include "acquire/run/doubt_hook.hpp"
#include "acquire/run/journal.hpp"
#include "acquire/run/new_run.hpp"
#include "acquire/run/status.hpp"
#include "drivers/port/raw_tap.hpp"
#include "drivers/util/console.hpp"

namespace echofuse::acquire {
namespace {

constexpr auto tick_pause = std::chrono::milliseconds(50);
// Delay from the creation of the run file to slot 0. Data that arrived while the file was being
// created are read during this delay.
constexpr auto settle_time = std::chrono::milliseconds(100);

// Longest wait for the current slot after SIGTERM. The run must be closed within 5 s of the signal;
// the remaining second is for the devices and the disk.
constexpr auto close_limit = std::chrono::seconds(4);

std::string event_text(DeviceState state, const std::string& address) {
  if (state == DeviceState::connecting) return "connecting to " + address;
  if (state == DeviceState::streaming) return "connected to " + address;
  if (state == DeviceState::ended) return address + " has ended";
  return "not connected to " + address + ", trying again";
}

// Threading: run() must be called on the loop's thread, and all callbacks run there. Drivers and
// the writer may use additional threads.
class Daemon final : private SampleSink {
 public:
  Daemon(const Config& config, const RunOptions& options, port::Loop& loop)
      : config_(config),
        options_(options),
        loop_(loop),
        label_(config.label),
        log_(loop),
        devices_(loop, config, *this, keep_raw(options), options.recording) {}

  // If an exception ended the run, stops the devices without closing further slots.
  ~Daemon() override {
    timer_.cancel();
    devices_.abandon();
  }

  ExitCode run();

 private:
  // State that exists once the run file has been created.
  struct ActiveRun {
    ActiveRun(const SlotGrid& grid, const Config& config, const RunOptions& options,
              port::Loop& loop, std::unique_ptr<record::RunWriter> file)
        : scheduler(grid, options.count, options.kept_closings),
          journal(std::move(file), loop),
          status(grid.first, config.window_s, options.count, options.quiet, options.show_status) {}
    Scheduler scheduler;
    Journal journal;
    Backlog due;
    StatusLine status;
  };

  void on_tags(const TagBlock& block) override { intake_.slots.add(block); }
  void on_histogram(HistogramFrame frame) override { intake_.slots.add(frame); }
  void on_radar(RadarFrame frame) override { intake_.slots.add(frame); }
  void on_depth(DepthFrame frame) override { intake_.slots.add(std::move(frame)); }
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;

  port::RawKeeper* keep_raw(const RunOptions& options);
  void report_raw_trouble();
  [[noreturn]] static void refuse_interrupted();
  void require_devices() const;
  void count_down();
  void begin();
  std::unique_ptr<record::RunWriter> make(const std::string& out, const std::string& uuid) {
    return make_run(config_, out, options_.meta, uuid, loop_);
  }
  void describe_run();
  void begin_next(std::int64_t slot);
  void put_late();
  void put_counters();
  void report_file();
  void interrupt(HostTime now);
  void warn_of_full_disk();
  void announce(Sensor sensor);
  void log(Severity severity, const std::string& source, const std::string& text,
           bool recovery = false) {
    log_.put(severity, source, text, recovery);
  }
  void arm();
  void tick();
  void close_due(HostTime now);
  void close_slot(const DueSlot& due, HostTime now);
  void end();

  const Config& config_;
  const RunOptions& options_;
  port::Loop& loop_;
  port::Timer timer_{loop_};
  std::string file_;
  std::string label_;
  RunLog log_;
  std::optional<port::RawKeeper> raw_;
  Devices devices_;
  Intake intake_{config_, config_.window_s, devices_.clocks()};
  DoubtHook on_doubt_{options_.on_doubt,
                      {config_.alert.lasting_s(config_.window_s), config_.alert.disk_free_gb},
                      [this](const std::string& text) { log(Severity::warning, "run", text); }};
  std::optional<ActiveRun> recording_;
  RunTotals totals_;
  std::int64_t first_slot_ = 0;  // number of the slot that is record 0 of the current run
  std::int64_t files_ = 0;
  bool discards_ = false;  // true if the run was interrupted before slot 0
  bool ending_ = false;    // true once SIGINT or SIGTERM has arrived
  bool done_ = false;      // true once all slots have been closed or the journal has failed
  std::string status_ = "complete";
};

ExitCode Daemon::run() {
  refuse_late_clock(loop_.utc());
  refuse_bad_target(options_.out);
  if (!options_.kept_slot) devices_.take("run", options_.out);
  if (raw_) raw_->note("run", loop_.now(), "start", loop_.utc().count());
  devices_.start();
  if (!options_.recording) {
    // Slot 0 of a raw capture has a fixed time, even if a device sends no valid data.
    double wait_s = config_.connect_timeout_s;
    if (options_.kept_slot)
      wait_s = std::min(wait_s, seconds(*options_.kept_slot - settle_time - loop_.now()));
    devices_.wait(wait_s);
    devices_.refuse_misconfigured();
    require_devices();
  }
  if (options_.countdown_s > 0) count_down();
  begin();
  arm();
  loop_.run_until([this] { return done_; });
  if (discards_) recording_->journal.discard(), refuse_interrupted();
  end();
  return options_.strict && totals_.not_ok > 0 ? ExitCode::partial : ExitCode::ok;
}

void Daemon::refuse_interrupted() {
  throw Error(ExitCode::interrupted, "interrupted before the first slot; nothing was recorded");
}

// Throws Error(device) if no device delivers data or a required device delivers none. The message
// lists the missing devices.
void Daemon::require_devices() const {
  if (interrupted()) refuse_interrupted();
  std::string missing, required;
  bool any = false;
  for (const Sensor s : all_sensors) {
    any = any || devices_[s].delivers();
    if (!devices_[s].configured || devices_[s].delivers()) continue;
    std::string& list = config_.required().contains(s) ? required : missing;
    list += (list.empty() ? "" : "\n") + devices_.describe(s);
  }
  if (!required.empty())
    throw Error(ExitCode::device, "a required device delivered no data within " +
                                      human_duration(config_.connect_timeout_s) + "\n" + required);
  if (!any)
    throw Error(ExitCode::device, "no device delivered data within " +
                                      human_duration(config_.connect_timeout_s) + "\n" + missing);
  if (!missing.empty()) spdlog::warn("starting without {}", missing);
}

// Waits so that people can take their positions in the scene. Devices keep running.
void Daemon::count_down() {
  for (std::int64_t left_s = options_.countdown_s; left_s > 0 && !interrupted(); --left_s) {
    spdlog::info("the first slot begins in {} s", left_s);
    loop_.run_until(interrupted, loop_.now() + std::chrono::seconds(1));
  }
  require_devices();
}

port::RawKeeper* Daemon::keep_raw(const RunOptions& options) {
  if (options.keep_raw.empty()) return nullptr;
  raw_.emplace(options.keep_raw, loop_.make_worker());
  raw_->put_text("lab.toml", config_.resolved);
  raw_->put_text("radar.cfg", config_.radar.cfg_text);
  if (!config_.calibration.entries.empty())
    write_calibration(options.keep_raw + "/calibration.toml", config_.calibration);
  return &*raw_;
}

void Daemon::report_raw_trouble() {
  const std::string trouble = raw_ ? raw_->take_trouble() : "";
  if (!trouble.empty()) log(Severity::error, "raw", trouble);
}

void Daemon::begin() {
  auto file = make(options_.out, options_.uuid);
  const auto length = from_seconds(config_.window_s);
  const SlotGrid grid{options_.kept_slot.value_or(first_slot(loop_.now() + settle_time, length)),
                      length};
  if (raw_) raw_->note("run", grid.first, "slots", length.count());
  recording_.emplace(grid, config_, options_, loop_, std::move(file));
  intake_.begin(grid.first);
  log_.attach(recording_->journal);
  describe_run();
  warn_of_full_disk();
  report_file();
  notify_ready(config_.window_s);
}

void Daemon::describe_run() {
  recording_->journal.put_config(config_);
  recording_->journal.put_axes(intake_.slots.axes());
  for (const Sensor s : all_sensors)
    if (devices_[s].state == DeviceState::streaming)
      announce(s);
    else if (devices_[s].configured)
      log(Severity::warning, name_of(s),
          "no data at the start of the run: " + devices_.describe(s));
}

void Daemon::begin_next(std::int64_t slot) {
  put_counters();
  first_slot_ = slot;
  recording_->journal.begin_next([this] { return make(options_.next_out(), {}); });
  describe_run();
}

void Daemon::report_file() {
  const std::string file = recording_->journal.path();
  if (std::exchange(file_, file) == file) return;
  if (++files_ > 1 && !options_.kept_slot) devices_.name_run("run", file);
  if (!options_.kept_slot) spdlog::info("recording to {}, slots of {} s", file, config_.window_s);
  if (options_.opened) options_.opened(file);
  if (files_ == 1) on_doubt_.take_run("started", "recording", loop_.utc(), file);
}

void Daemon::warn_of_full_disk() {
  const PlannedRun plan{.folder = std::filesystem::path(options_.out).parent_path(),
                        .record_bytes = record::record_bytes(intake_.slots.axes()),
                        .window_s = config_.window_s,
                        .count = options_.count};
  constexpr double day_s = 86'400;
  const auto free = static_cast<double>(free_bytes(plan.folder).value_or(1ull << 62));
  const Finding space = space_finding(free, plan, day_s);
  if (space.grade != Grade::ok) log(Severity::warning, "disk", space.found);
}

void Daemon::announce(Sensor sensor) {
  const DeviceInfo& info = devices_[sensor].info;
  recording_->journal.put_device(info);
  if (!intake_.slots.announce(info))
    log(Severity::error, name_of(sensor),
        "its axes differ from those at the start of the run; its samples are ignored");
  recording_->journal.put_axes(intake_.slots.axes());
}

void Daemon::on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) {
  const bool fault = state == DeviceState::faulted || state == DeviceState::misconfigured;
  log(fault ? Severity::warning : Severity::info, name_of(sensor), event_text(state, info.address),
      recording_ && state == DeviceState::streaming);
  // The clock fit is kept when a device reconnects, because buffered samples still have times of
  // the old clock. ClockFit detects a restarted clock.
  if (recording_ && state == DeviceState::streaming) announce(sensor);
  if (state != DeviceState::ended) return;
  intake_.end(sensor, loop_.now());
  const auto ended = [](const auto& device) { return device.state == DeviceState::ended; };
  if (options_.recording && devices_.all(ended)) recording_->scheduler.finish(loop_.now());
}

void Daemon::on_event(Sensor sensor, Severity severity, const std::string& text) {
  log(severity, name_of(sensor), text);
}

void Daemon::arm() {
  HostTime next = loop_.now() + tick_pause;
  if (!recording_->scheduler.done()) next = std::min(next, recording_->scheduler.next_deadline());
  timer_.at(next, [this] { tick(); });
}

void Daemon::tick() {
  ActiveRun& r = *recording_;
  const HostTime now = loop_.now();
  if (interrupted() && !std::exchange(ending_, true)) interrupt(now);
  close_due(now);
  r.journal.refresh_anchor(log_);
  report_raw_trouble();
  report_file();
  const std::int64_t written = r.journal.written();
  if (std::exchange(totals_.written, written) != written) {
    notify_advance(written);
    if (options_.progress) options_.progress(written);
  }
  totals_.label = r.journal.label().value_or(label_);
  totals_.free_bytes = r.journal.free_bytes();
  r.status.update(now, totals_);
  on_doubt_.take_disk(totals_.free_bytes, loop_.utc(), r.journal.path());
  on_doubt_.update(now);
  done_ = (r.scheduler.done() && r.due.empty()) || r.journal.failed();
  if (!done_) arm();
}

void Daemon::close_due(HostTime now) {
  ActiveRun& r = *recording_;
  r.due.put(r.scheduler.tick(now));
  while (const auto due = r.due.next(r.journal.crowded())) close_slot(*due, now);
}

// Makes the current slot the last one, or the previous slot if the current one would take longer
// than close_limit. Before slot 0, ends the run immediately, without a file.
void Daemon::interrupt(HostTime now) {
  Scheduler& scheduler = recording_->scheduler;
  const SlotGrid& grid = scheduler.grid();
  if (now < grid.first && !options_.kept_slot) {
    discards_ = true;
    return scheduler.finish(now - grid.length);
  }
  const bool too_long = now < grid.first || grid.end(grid.slot_of(now)) - now > close_limit;
  const double left_s = seconds(std::max(grid.first, grid.end(grid.slot_of(now)) + grace) - now);
  if (too_long)
    spdlog::info("slot abandoned: {:.0f} s left", left_s);
  else
    spdlog::info("finishing the slot, {:.1f} s left; press Ctrl-C again to stop immediately",
                 left_s);
  if (too_long) status_ = "stopped:interrupted";
  scheduler.finish(too_long ? now - grid.length : now);
}

void Daemon::close_slot(const DueSlot& due, HostTime now) {
  if (raw_) raw_->note("run", now, due.stalled ? "stalled" : "closed", due.index);
  record::FusedRecord record = intake_.close(due);
  record.index -= first_slot_;
  const std::int64_t index = record.index;
  record.statistics.closed_late_s = seconds(recording_->scheduler.lateness(due.index, now));
  record.slot_utc = recording_->journal.utc_of(record.slot_start);
  record.label = label_;
  totals_.take(record, config_.configured(), [&](Sensor sensor, Severity severity) {
    log(severity, name_of(sensor),
        "record " + std::to_string(record.index) + ": " + record.sync[sensor].text(), true);
  });
  on_doubt_.take(record, config_.configured(), recording_->journal.path());
  spdlog::debug("record {}: valid {}, {} clicks, {} radar frames, {} depth frames", record.index,
                record.valid.bits(), record.sync[Sensor::spd].used, record.sync[Sensor::radar].used,
                record.sync[Sensor::depth].used);
  if (!recording_->journal.put(std::move(record)))
    log(Severity::error, "run file",
        "record " + std::to_string(index) + ": data dropped, " + recording_->journal.delay_cause());
  put_late();
  const bool is_last = recording_->scheduler.done() && recording_->due.empty();
  if (index + 1 == options_.slots_a_file && !is_last) begin_next(due.index + 1);
}

// Writes the number of late samples of each record. Late samples that belong to the previous run
// are included only in the counters of that run.
void Daemon::put_late() {
  record::LateCounts late;
  for (const auto& [slot, counts] : intake_.slots.take_late())
    if (slot >= first_slot_) late[slot - first_slot_] = counts;
  recording_->journal.put_late(std::move(late));
}

// Writes the drivers' counters. Writes and logs the counts of unassigned samples.
void Daemon::put_counters() {
  PerSensor<std::vector<Counter>> counters;
  for (const Sensor s : all_sensors) counters[s] = devices_.counters(s);
  const UnassignedSamples unassigned = intake_.slots.take_unassigned();
  recording_->journal.put_counters(counters, unassigned);
  report_unassigned(log_, unassigned);
}

void Daemon::end() {
  ActiveRun& r = *recording_;
  notify_stopping();
  devices_.stop();
  if (raw_) {
    const port::RawKeeper::Counts bytes = raw_->finish();
    report_raw_trouble();
    log(bytes.dropped > 0 ? Severity::error : Severity::info, "raw",
        std::to_string(bytes.kept) + " bytes recorded in " + options_.keep_raw + ", " +
            std::to_string(bytes.dropped) + " not recorded");
    if (!std::filesystem::exists(options_.keep_raw))
      log(Severity::error, "raw", options_.keep_raw + " was moved or removed during the run");
  }
  intake_.slots.finish();
  put_late();
  put_counters();
  on_doubt_.finish(loop_.now());  // before the file is closed: its warnings become events
  // All reports of the end follow, also if the file cannot be closed.
  std::exception_ptr failure;
  std::string reason = status_;
  try {
    if (!r.journal.finish(status_))
      spdlog::warn(
          "{}: in use by another program; the last records stay in {}-wal until you run "
          "`echofuse-acquire info`",
          r.journal.path(), r.journal.path());
  } catch (const std::exception& error) {
    failure = std::current_exception(), reason = error.what();
  }
  on_doubt_.take_run("ended", reason, loop_.utc(), r.journal.path());
  on_doubt_.finish(loop_.now());
  report_file();
  totals_.written = r.journal.written();
  if (options_.progress) options_.progress(totals_.written);
  r.status.finish(loop_.now(), totals_);
  if (failure) std::rethrow_exception(failure);
  if (options_.kept_slot) return;  // an import reports its file itself
  const std::string files = files_ > 1 ? " in " + std::to_string(files_) + " runs" : "";
  spdlog::info("{}: {}{}, {}{}; received: {} tags, {} radar frames, {} depth frames",
               r.journal.path(), count_text(totals_.written, options_.count), files, status_,
               totals_.doubts(), devices_[Sensor::spd].samples, devices_[Sensor::radar].samples,
               devices_[Sensor::depth].samples);
}

}  // namespace

ExitCode record_run(const Config& config, const RunOptions& options, port::Loop& loop) {
  return Daemon(config, options, loop).run();
}

}  // namespace echofuse::acquire
