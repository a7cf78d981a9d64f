// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <random>
#include <thread>
#include <utility>

#include "acquire/record/file_watch.hpp"
#include "acquire/record/record_rows.hpp"
#include "acquire/record/rescue.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_tables.hpp"
#include "acquire/record/schema.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {
namespace {

std::string make_uuid() {  // RFC 4122 version 4
  std::random_device device;
  std::uint32_t w[4];
  for (auto& v : w) v = device();
  w[1] = (w[1] & 0xffff0fffU) | 0x4000U;
  w[2] = (w[2] & 0x3fffffffU) | 0x80000000U;
  char text[40];
  std::snprintf(text, sizeof text, "%08x-%04x-%04x-%04x-%04x%08x", w[0], w[1] >> 16, w[1] & 0xffff,
                w[2] >> 16, w[2] & 0xffff, w[3]);
  return text;
}

std::string host_name() {
  char name[256] = {};
  gethostname(name, sizeof name - 1);
  return name;
}

[[noreturn]] void refuse_existing(const std::string& path) {
  throw Error(ExitCode::failed,
              path + ": exists already; runs are never overwritten, choose another name");
}

// Reserves the path, so that two writers cannot take the same one.
void create_empty(const std::string& path) {
  const int fd = ::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644);
  if (fd >= 0) {
    ::close(fd);
    return;
  }
  if (errno == EEXIST) refuse_existing(path);
  throw Error(ExitCode::disk, path + ": cannot create the run file: " + std::strerror(errno));
}

// Other processes may write marks; what waits for one of them longer is broken.
constexpr int busy_timeout_ms = 30'000;
constexpr int checkpoint_pages = 1000;  // SQLite's own default
// The status rewrites the row of the run, configuration included, and readers need an index file.
constexpr int reserve_bytes = 128 << 10;

}  // namespace

struct RunWriter::Statements {
  Statements(sqlite3* db, const std::string& path)
      : rows(db, path), begin(db, path, "BEGIN IMMEDIATE"), commit(db, path, "COMMIT") {}
  Inserts rows;
  Statement begin, commit;
};

RunWriter::RunWriter(const std::string& path, const RunInfo& info)
    : path_(path), handle_(nullptr, sqlite3_close) {
  if (::access(path.c_str(), F_OK) == 0) refuse_existing(path);
  lock();
  create_empty(path);
  try {
    open();
    use_wal();
  } catch (...) {
    ::unlink(path.c_str());  // empty, and of our making
    throw;
  }
  // In one transaction: a crash leaves a run or an empty file.
  execute(db_, path_, "BEGIN", "cannot set up");
  const std::string identity = "PRAGMA application_id=" + std::to_string(application_id) +
                               "; PRAGMA user_version=" + std::to_string(format_version) + ";";
  execute(db_, path_, identity.c_str(), "cannot set up");
  execute(db_, path_, schema, "cannot create the tables");
  const SystemClock clock;
  const auto given_or = [](const std::string& text, const std::string& other) {
    return text.empty() ? other : text;
  };
  Inserts rows(db_, path_);
  rows.into("run")
      .set("uuid", make_uuid())
      .set("started_utc", given_or(info.started_utc, iso8601(clock.utc())))
      .set("ended_utc", "")
      .set("status", "open")
      .set("window_s", info.window_s)
      .set("config_text", info.config_text)
      .set("config_resolved", info.config_resolved)
      .set("radar_cfg", info.radar_cfg)
      .set("version", info.version)
      .set("host", given_or(info.host, host_name()))
      .set("operator", info.operator_name)
      .set("notes", info.notes)
      .run();
  for (const auto& [key, value] : info.meta)
    rows.into("meta").set("key", key).set("value", value).run();
  execute(db_, path_, "INSERT INTO part SELECT 0, 0, started_utc FROM run; COMMIT",
          "cannot create the tables");
  ready();
}

RunWriter::RunWriter(const std::string& path) : path_(path), handle_(nullptr, sqlite3_close) {
  axes_ = RunReader(path).axes();  // and: it is a run file
  lock();
  open();
  use_wal();
  execute(db_, path_, "BEGIN IMMEDIATE", "cannot reopen");
  execute(db_, path_, schema, "cannot add the tables of this version");
  if (!Statement(db_, path_, "SELECT 1 FROM pragma_table_info('counter') WHERE name = 'part'")
           .step())
    execute(db_, path_, "ALTER TABLE counter ADD COLUMN part INTEGER DEFAULT 0", "cannot reopen");
  execute(db_, path_, "UPDATE run SET status = 'open', ended_utc = ''", "cannot reopen");
  Statement state(db_, path_,
                  "SELECT count(*), ifnull(max(idx) + 1, 0), (SELECT ifnull(max(id), 0) FROM "
                  "event) FROM record");
  state.step();
  for (std::int64_t* v : {&records_, &next_index_, &last_event_}) *v = state.integer();
  begin_part();
  execute(db_, path_, "COMMIT", "cannot reopen");
  ready();
}

// An older file is one part, whatever was resumed before.
void RunWriter::begin_part() {
  execute(db_, path_, "INSERT OR IGNORE INTO part SELECT 0, 0, started_utc FROM run",
          "cannot begin a part");
  Statement last(db_, path_, "SELECT max(part) FROM part");
  last.step();
  part_ = last.integer() + 1;
  Inserts(db_, path_)
      .into("part")
      .set("part", part_)
      .set("first_idx", next_index_)
      .set("started_utc", iso8601(SystemClock().utc()))
      .run();
}

void RunWriter::lock() {
  lock_ = std::make_unique<WriterLock>(path_);
  if (!lock_->held())
    throw Error(ExitCode::failed, path_ + ": is being written by another process");
}

void RunWriter::open() {
  const int code = sqlite3_open_v2(path_.c_str(), &db_, SQLITE_OPEN_READWRITE, nullptr);
  handle_.reset(db_);
  if (code != SQLITE_OK) sqlite_fail(db_, path_, "cannot open");
  harden(db_);
  lock_->reserve(reserve_bytes);
  sqlite3_busy_timeout(db_, busy_timeout_ms);
}

void RunWriter::use_wal() {
  Statement mode(db_, path_, "PRAGMA journal_mode=WAL");
  const std::string answer = mode.step() ? mode.text() : "";
  if (answer != "wal")
    throw Error(ExitCode::disk, path_ +
                                    ": this file system cannot hold a run while it is written "
                                    "(no shared memory for SQLite's WAL, as on a network); "
                                    "record to a local disk");
  execute(db_, path_, "PRAGMA synchronous=FULL", "cannot set up");
}

// After the first write, which makes the WAL.
void RunWriter::ready() {
  statements_ = std::make_unique<Statements>(db_, path_);
  watch_ = std::make_unique<FileWatch>(path_);
  const auto hook = [](void* self, sqlite3*, const char*, int pages) {
    if (pages >= checkpoint_pages) static_cast<RunWriter*>(self)->checkpoint();
    return SQLITE_OK;
  };
  sqlite3_wal_hook(db_, hook, this);  // instead of SQLite's own, so that we know which was ours
}

void RunWriter::checkpoint() {
  touched_ = touched_ || watch_->touched();
  sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_PASSIVE, nullptr, nullptr);
  watch_->note();
}

RunWriter::~RunWriter() = default;

void RunWriter::put_axis(const Axis& axis) {
  statements_->rows.into("axis")
      .set("name", axis.name)
      .set("quantity", axis.quantity)
      .set("unit", axis.unit)
      .set("count", axis.count)
      .set("start", axis.start)
      .set("step", axis.step)
      .set("scale", axis.scale)
      .run();
  axes_.push_back(axis);
}

void RunWriter::put_device(const DeviceInfo& device) {
  statements_->rows.into("device")
      .set("sensor", name_of(device.sensor))
      .set("address", device.address)
      .set("model", device.model)
      .set("serial", device.serial)
      .set("firmware", device.firmware)
      .run();
}

void RunWriter::put_calibration(const CalibrationEntry& entry) {
  statements_->rows.into("calibration")
      .set("sensor", name_of(entry.sensor))
      .set("date_utc", entry.date_utc)
      .set("method", entry.method)
      .set("distance_m", entry.distance_m)
      .set("offset_m", entry.offset_m)
      .set("standard_error_m", entry.standard_error_m)
      .run();
}

void RunWriter::put_policy(Sensor sensor, const std::string& policy) {
  statements_->rows.into("policy", "ON CONFLICT (sensor) DO UPDATE SET policy = excluded.policy")
      .set("sensor", name_of(sensor))
      .set("policy", policy)
      .run();
}

void RunWriter::put_counters(std::span<const Counted> counters) {
  in_transaction([&] {
    for (const Counted& c : counters)
      statements_->rows.into("counter")
          .set("source", c.source)
          .set("name", c.name)
          .set("value", c.value)
          .set("part", part_)
          .run();
  });
}

void RunWriter::put_late(std::int64_t first, const LateCounts& late) {
  in_transaction([&] {
    Insert& row = statements_->rows.into(
        "late",
        "ON CONFLICT (idx) DO UPDATE SET spd = spd + excluded.spd, radar = radar + "
        "excluded.radar, depth = depth + excluded.depth");
    for (const auto& [slot, counts] : late) {
      for (const Sensor s : all_sensors) row.set(name_of(s), counts[s]);
      row.set("idx", first + slot).run();
    }
  });
}

void RunWriter::put_anchor(HostTime mono, UtcTime utc) {
  statements_->rows.into("anchor")
      .set("mono_ns", std::int64_t{mono.count()})
      .set("utc_ns", std::int64_t{utc.count()})
      .run();
}

void RunWriter::put_event(UtcTime utc, Severity severity, const std::string& source,
                          const std::string& text) {
  constexpr const char* levels[] = {"info", "warning", "error"};
  statements_->rows.into("event")
      .set("utc", iso8601(utc))
      .set("level", levels[static_cast<std::size_t>(severity)])
      .set("source", source)
      .set("text", text)
      .run();
}

void RunWriter::in_transaction(const std::function<void()>& body) {
  statements_->begin.run();
  try {
    body();
    statements_->commit.run();
  } catch (...) {
    const int code = sqlite3_errcode(db_);
    if (code == SQLITE_CORRUPT || code == SQLITE_NOTADB)
      harm_ = std::string("was damaged during the run: ") + sqlite3_errstr(code);
    statements_->rows.clear();
    // A full disk may have rolled back already.
    if (!sqlite3_get_autocommit(db_)) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

void RunWriter::append(const FusedRecord& record) { append(std::span(&record, 1)); }

void RunWriter::append(std::span<const FusedRecord> batch) {
  require_sound();
  in_transaction([&] {
    for (const auto& r : batch) insert_record(statements_->rows, path_, r, axes_);
  });
  records_ += static_cast<std::int64_t>(batch.size());
}

std::optional<std::string> RunWriter::new_label(UtcTime before) {
  Statement s(db_, path_, "SELECT id, level, utc, text FROM event WHERE id > ? ORDER BY id");
  s.bind(last_event_);
  const std::string end = iso8601(before);  // times of one form are in the order of their texts
  std::optional<std::string> label;
  while (s.step()) {
    const std::int64_t id = s.integer();
    const bool is_label = s.text() == "label";
    if (is_label && s.text() >= end) break;  // of a later slot
    last_event_ = id;
    if (is_label) label = s.text();
  }
  return label;
}

// Whoever writes into the file beside us may do so (a checkpoint of another program's own), as long
// as it stays a database.
void RunWriter::require_sound() {
  if (harm_.empty()) harm_ = watch_->lost();
  if (harm_.empty() && (std::exchange(touched_, false) || watch_->touched())) {
    watch_->note();
    if (const std::string fault = damage(db_, path_); !fault.empty())
      harm_ = "was damaged during the run: " + fault;
  }
  if (!harm_.empty()) throw Error(ExitCode::disk, path_ + ": " + harm_);
}

bool RunWriter::close(const std::string& status) {
  try {
    require_sound();
  } catch (const Error&) {
    leave(status);
  }
  const SystemClock clock;
  // Two chances on a full disk: the WAL is emptied, or, where the file cannot grow for that, the
  // reserve is given back.
  sqlite3_busy_timeout(db_, 0);
  sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  watch_->note();
  lock_->release();
  sqlite3_busy_timeout(db_, busy_timeout_ms);
  Statement(db_, path_, "UPDATE run SET status = :status, ended_utc = :ended_utc")
      .at("status")
      .bind(status)
      .at("ended_utc")
      .bind(iso8601(clock.utc()))
      .run();
  try {
    require_sound();
  } catch (const Error&) {
    leave(status);
  }
  statements_.reset();
  const bool folded = fold();
  handle_.reset();
  db_ = nullptr;
  lock_.reset();
  return folded;
}

// A reader that only follows the run sees its end and goes.
bool RunWriter::fold() {
  sqlite3_busy_timeout(db_, 0);
  constexpr auto pause = std::chrono::milliseconds(20);
  for (int tries = 0; tries < 25; ++tries) {
    if (sqlite3_exec(db_, "PRAGMA journal_mode=DELETE", nullptr, nullptr, nullptr) == SQLITE_OK)
      return true;
    std::this_thread::sleep_for(pause);
  }
  return false;
}

// What bears the file's name is not touched any more: it may belong to somebody else by now.
void RunWriter::leave(const std::string& status) {
  statements_.reset();
  lock_->release();
  const Rescue kept = rescue(db_, path_, status);
  sqlite3_db_config(db_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  handle_.reset();
  db_ = nullptr;
  if (kept.whole && !watch_->same_database()) watch_->remove_wal();
  lock_.reset();
  throw Error(ExitCode::disk, path_ + ": " + harm_ + "; " + kept.text);
}

}  // namespace echofuse::record
