// SPDX-License-Identifier: MIT
#include "acquire/run/journal.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <utility>

#include "acquire/record/columns.hpp"
#include "acquire/run/disk.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

constexpr auto anchor_pause = std::chrono::minutes(1);
// Smallest jump of the system clock that is reported. A shorter jump may be due to a pause of the
// process between reading the two clocks.
constexpr auto min_step = std::chrono::milliseconds(500);
// The journal fails if the number of waiting jobs reaches this multiple of its capacity.
constexpr std::size_t hard_limit = 10;
// Maximum wait for another program's write transaction when the run ends.
constexpr std::chrono::seconds last_wait{2};

constexpr unsigned max_lines = 100;
constexpr std::chrono::seconds stretch{10};

spdlog::level::level_enum level_of(Severity s) {
  constexpr spdlog::level::level_enum levels[] = {spdlog::level::info, spdlog::level::warn,
                                                  spdlog::level::err};
  return levels[static_cast<std::size_t>(s)];
}

}  // namespace

Journal::Journal(std::unique_ptr<record::RunWriter> run, port::Loop& loop, std::size_t capacity)
    : run_(std::move(run)),
      capacity_(capacity),
      clock_(loop),
      closer_(loop.make_worker()),
      worker_(loop.make_worker()) {
  run_->wait_with(lock_wait_);
  anchors_.push_back(put_anchor());
}

Journal::~Journal() { stop(); }

bool Journal::put(record::FusedRecord record) {
  const bool room = waiting_ < capacity_;
  if (!room) record::give_up(record, record.valid, delay_cause());
  ++put_;
  put([this, r = std::move(record)](record::RunWriter& run) mutable { write(run, r); });
  return room;
}

// Runs on the worker thread.
void Journal::write(record::RunWriter& run, record::FusedRecord& record) {
  const UtcTime slot_end = record.slot_utc + (record.slot_end - record.slot_start);
  take_label(run.new_label(slot_end));
  if (const auto label = this->label()) record.label = *label;
  run.append(record);
  // scripts/kill_test searches the log for this message.
  spdlog::debug("{}: record {}: committed", run.path(), record.index);
  const auto free = acquire::free_bytes(std::filesystem::path(run.path()).parent_path().string());
  const std::lock_guard lock(mutex_);
  free_ = free;
  ++written_;
}

void Journal::put(WriteJob job) {
  if (failed() || !worker_) return;
  if (waiting_ >= hard_limit * capacity_) {
    overflow_ = delay_cause();
    return;
  }
  ++waiting_;
  worker_->put([this, job = std::move(job)] {
    --waiting_;
    if (failed_) return;
    try {
      put_faults(*run_);
      job(*run_);
    } catch (...) {
      fail(std::current_exception());
    }
  });
}

std::string Journal::delay_cause() const {
  return lock_wait_.tried() ? "another program is writing to the run file" : "disk too slow";
}

// Runs a step on a run that has ended. Its failure does not end the next run.
void Journal::attempt(const std::function<void()>& step) {
  try {
    step();
  } catch (const std::exception& error) {
    spdlog::warn("{}", printable(error.what()));
    const std::lock_guard lock(mutex_);
    faults_.emplace_back(error.what());
  }
}

void Journal::put_faults(record::RunWriter& run) {
  std::vector<std::string> faults;
  {
    const std::lock_guard lock(mutex_);
    faults.swap(faults_);
  }
  for (const std::string& fault : faults)
    run.put_event(clock_.utc(), Severity::warning, "run", fault);
}

// Opens the next run before closing the current one, because closing checks the whole file and
// records must not wait for it. The current run is complete before the next file appears, because
// another program may then move it.
void Journal::begin_next(MakeRun make) {
  axes_.clear(), identities_ = {};
  put([this, make = std::move(make)](record::RunWriter&) {
    std::shared_ptr<record::RunWriter> before;
    attempt([this] { run_->complete("complete"); });
    auto next = make();
    next->wait_with(lock_wait_);
    {
      const std::lock_guard lock(mutex_);
      run_.swap(next);
      before = std::move(next);
    }
    // A label of the previous run also applies to the new run. A label that arrives while the
    // previous run is being closed does not replace a label of the new run.
    attempt([&] { take_label(before->new_label(UtcTime::max())); });
    const std::uint64_t labels = labels_;
    constexpr int max_closing = 4;
    if (closing_ >= max_closing) return attempt([&] { close_before(*before, labels); });
    ++closing_;
    closer_->put([this, before, labels] {
      attempt([&] { close_before(*before, labels); });
      --closing_;
    });
  });
  renew_anchor();
}

// Closes the previous run. `labels` is the value of labels_ when the new run began. If no label has
// been set in the new run yet, a label written to the previous run during closing applies to the
// new run.
void Journal::close_before(record::RunWriter& before, std::uint64_t labels) {
  if (!before.close("complete"))
    spdlog::warn(
        "{}: in use by another program, so the last records of the run remain in its -wal file",
        before.path());
  if (auto left = before.new_label(UtcTime::max()); labels_ == labels) take_label(std::move(left));
  const std::lock_guard lock(mutex_);
  run_->reserve();  // uses disk space that closing the previous run may have freed
}

void Journal::take_label(std::optional<std::string> label) {
  if (!label) return;
  const std::lock_guard lock(mutex_);
  label_ = std::move(label);
  ++labels_;
}

std::string Journal::path() const {
  const std::lock_guard lock(mutex_);
  return run_->path();
}

void Journal::put_config(const Config& config) {
  for (const Sensor s : all_sensors)
    if (config.configured().contains(s))
      put([s, policy = config.policy[s]](record::RunWriter& run) { run.put_policy(s, policy); });
  if (config.configured().contains(Sensor::depth)) {
    const auto map = config.map.axes();
    put_axes({map.begin(), map.end()});
  }
}

void Journal::put_device(const DeviceInfo& device) {
  const std::string identity =
      device.address + '\n' + device.model + '\n' + device.serial + '\n' + device.firmware;
  if (std::exchange(identities_[device.sensor], identity) != identity)
    put([device](record::RunWriter& run) { run.put_device(device); });
}

void Journal::put_axes(const std::vector<Axis>& axes) {
  for (const Axis& axis : axes)
    if (axes_.insert(axis.name).second) put([axis](record::RunWriter& run) { run.put_axis(axis); });
}

void Journal::put_late(record::LateCounts late) {
  if (late.empty()) return;
  put([late = std::move(late)](record::RunWriter& run) { run.put_late(late); });
}

void Journal::put_counters(PerSensor<std::vector<Counter>> counters,
                           const UnassignedSamples& unassigned) {
  for (const Sensor s : all_sensors) {
    for (Counter& c : counters[s]) c.value -= std::exchange(counted_[s][c.name], c.value);
    counters[s].push_back({"early", unassigned.early[s]});
    counters[s].push_back({"late", unassigned.late[s]});
    counters[s].push_back({"outside", unassigned.outside[s]});
    counters[s].push_back({"duplicate", unassigned.duplicate[s]});
    counters[s].push_back({"out_of_order", unassigned.out_of_order[s]});
  }
  std::vector<record::CounterRow> rows;
  for (const Sensor s : all_sensors)
    for (const Counter& c : counters[s]) rows.push_back({name_of(s), c.name, c.value});
  put([rows = std::move(rows)](record::RunWriter& run) { run.put_counters(rows); });
}

Journal::SlotAnchor Journal::put_anchor() {
  const HostTime mono = clock_.now();
  const UtcTime utc = clock_.utc();
  put([mono, utc](record::RunWriter& run) { run.put_anchor(mono, utc); });
  return {mono, utc - mono, mono};
}

void Journal::refresh_anchor(RunLog& log) {
  SlotAnchor& last = anchors_.back();
  const HostTime now = clock_.now();
  const UtcTime before = now + last.utc_offset, utc = clock_.utc();
  if (std::chrono::abs(utc - before) >= min_step) {
    log.put(Severity::warning, "clock",
            "the system clock was set, or the machine was suspended: UTC jumped from " +
                iso8601(before) + " to " + iso8601(utc) + "; later slots use the new time");
    anchors_.push_back(put_anchor());
  } else if (now - last.mono >= anchor_pause) {
    renew_anchor();
  }
}

void Journal::renew_anchor() {
  const HostTime from = anchors_.back().from;
  anchors_.back() = put_anchor();
  anchors_.back().from = from;
}

UtcTime Journal::utc_of(HostTime slot_start) {
  while (anchors_.size() > 1 && anchors_[1].from <= slot_start) anchors_.pop_front();
  return slot_start + anchors_.front().utc_offset;
}

std::optional<std::uint64_t> Journal::free_bytes() const {
  const std::lock_guard lock(mutex_);
  return free_;
}

std::optional<std::string> Journal::label() const {
  const std::lock_guard lock(mutex_);
  return label_;
}

void Journal::fail(const std::exception_ptr& why) {
  const std::lock_guard lock(mutex_);
  if (!failure_) failure_ = why;
  failed_ = true;
}

void Journal::stop() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  lock_wait_.give_up_ns = std::min(lock_wait_.give_up_ns.load(),
                                   std::int64_t{std::chrono::nanoseconds(now + last_wait).count()});
  worker_.reset();  // worker_ is stopped first, because its jobs use closer_
  closer_.reset();
}

void Journal::discard() {
  stop();
  run_->discard();
}

bool Journal::finish(const std::string& status) {
  stop();
  if (!failed_) attempt([this] { put_faults(*run_); });
  if (!overflow_.empty()) fail(std::make_exception_ptr(Error(ExitCode::disk, overflow_)));
  if (!failed_) return run_->close(status);
  ExitCode code = ExitCode::failed;
  std::string why;
  try {
    std::rethrow_exception(failure_);
  } catch (const Error& error) {
    code = error.code();
    why = error.what();
  } catch (const std::exception& error) {
    why = error.what();
  }
  const std::int64_t missing = put_ - written_;
  if (missing > 0) why += "; its last " + std::to_string(missing) + " records were not written";
  try {
    run_->close(code == ExitCode::disk ? "stopped:disk" : "stopped:failed", missing);
  } catch (const Error&) {
    // Normally keeps the first error. If the file is damaged, throws the new error instead, because
    // the new error contains the path of the rescued copy.
    if (run_->lost()) throw;
  }
  throw Error(code, why);
}

void report_unassigned(RunLog& log, const UnassignedSamples& unassigned) {
  const auto count = [&](const char* what, const PerSensor<std::uint64_t>& n) {
    if (n != PerSensor<std::uint64_t>{})
      log.put(Severity::warning, "run",
              std::to_string(n[Sensor::spd]) + " tags, " + std::to_string(n[Sensor::radar]) +
                  " radar frames, " + std::to_string(n[Sensor::depth]) + " depth frames " + what);
  };
  count("arrived after their slot was closed", unassigned.late);
  count("arrived twice", unassigned.duplicate);
  count("arrived out of order", unassigned.out_of_order);
}

void RunLog::put(Severity severity, const std::string& source, const std::string& text,
                 bool recovery) {
  LogSource& of = sources_[source];
  if (const HostTime now = clock_.now(); of.lines == 0 || now - of.since >= stretch) {
    const unsigned left_out = of.left_out;
    of = {.since = now};
    if (left_out > 0)
      write(Severity::warning, source,
            std::to_string(left_out) + " log lines dropped (limit 100 in 10 s)", true);
  }
  if (++of.lines <= max_lines)
    write(severity, source, text, recovery || severity != Severity::info);
  else
    ++of.left_out;
}

void RunLog::write(Severity severity, const std::string& source, const std::string& text,
                   bool kept) {
  spdlog::log(level_of(severity), "{}: {}", source, printable(text));
  if (!kept) return;
  Journal::WriteJob job = [=, utc = clock_.utc()](record::RunWriter& run) {
    run.put_event(utc, severity, source, text);
  };
  if (journal_)
    journal_->put(std::move(job));
  else
    waiting_.push_back(std::move(job));
}

void RunLog::attach(Journal& journal) {
  journal_ = &journal;
  for (auto& job : std::exchange(waiting_, {})) journal.put(std::move(job));
}

}  // namespace echofuse::acquire
