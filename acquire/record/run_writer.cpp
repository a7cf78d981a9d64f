// SPDX-License-Identifier: MIT
#include "acquire/record/run_writer.hpp"

#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <random>
#include <thread>
#include <utility>

#include "acquire/record/file_watch.hpp"
#include "acquire/record/network_file_system.hpp"
#include "acquire/record/rescue.hpp"
#include "acquire/record/rows.hpp"
#include "acquire/record/run_guard.hpp"
#include "acquire/record/run_reader.hpp"
#include "acquire/record/side_files.hpp"
#include "acquire/record/sqlite.hpp"
#include "acquire/record/uuid.hpp"
#include "acquire/record/writer_lock.hpp"
#include "drivers/util/new_file.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::record {
namespace {

std::string make_uuid() {
  std::random_device device;
  std::array<std::uint32_t, 4> words{};
  for (auto& word : words) word = device();
  return uuid_text(words, 4);
}

// Maximum wait for another process that adds a label or a note.
constexpr std::int64_t longest_wait_ns = 30'000'000'000;
constexpr auto retry_pause = std::chrono::milliseconds(10);
// Size of SQLite's page cache. The cache can hold all pages of the WAL, so data that are not yet in
// the database are both in memory and in the WAL. A run fills the cache within its first minutes.
constexpr const char* page_cache = "PRAGMA cache_size=-2000";  // KiB
constexpr int checkpoint_pages = 400;  // maximum length of the WAL, in pages of 4 KiB

std::string damage_during_the_run(sqlite3* db, const std::string& path) {
  const std::string fault = damage(db, path);
  return fault.empty() ? "" : "was damaged during the run: " + fault;
}

// Returns the error that readers of the run would throw because another program changed its tables;
// empty if readers accept the run.
std::string refusal_of_readers(sqlite3* db, const std::string& path) {
  try {
    check_identity(db, path);
    check_tables(db, path);
    return {};
  } catch (const Error& e) {
    return e.what();
  }
}

std::int64_t now_ns() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Inserts a record. Throws Error(failed) if the data of a valid sensor do not match its axis.
void append_row(Statement& row, const std::string& path, const Shapes& shapes,
                const FusedRecord& r) {
  Blobs blobs;
  SensorSet lost;
  if (const std::string fault = pack(r, shapes, blobs, lost); !fault.empty())
    throw Error(ExitCode::failed, path + ": record " + std::to_string(r.index) + ": " + fault);
  if (lost.empty()) return insert(row, r, blobs);
  FusedRecord without = r;  // a bad depth image does not end the run
  give_up(without, lost, "the image cannot be compressed");
  append_row(row, path, shapes, without);
}

}  // namespace

void refuse_existing(const std::string& path) {
  if (!std::filesystem::exists(path)) return;
  throw Error(ExitCode::failed,
              path + ": exists already; runs are never overwritten; choose another name");
}

RunWriter::RunWriter(const std::string& path, const RunInfo& info, const Clock& clock,
                     const Begin& begin)
    : path_(path), clock_(clock), handle_(nullptr, sqlite3_close) {
  refuse_existing(path);
  lock();
  NewFile made(path, path + "-new");
  bool ours = false;
  try {
    made.create();
    open(made.path());
    make(info, begin);
    handle_.reset();
    ours = made.publish_new();
    if (!ours) refuse_existing(path);
    begin_writing();
  } catch (...) {
    handle_.reset();
    if (ours) ::unlink(path.c_str()), remove_side_files(path);  // the file has no records yet
    lock_->remove();
    throw;
  }
}

void RunWriter::make(const RunInfo& info, const Begin& begin) {
  execute(db_, path_, "BEGIN", "cannot set up the run file");
  const std::string identity = "PRAGMA application_id=" + std::to_string(application_id) +
                               "; PRAGMA user_version=" + std::to_string(format_version) + ";";
  execute(db_, path_, identity.c_str(), "cannot set up the run file");
  for (const Row* table : tables())
    execute(db_, path_, table->create().c_str(), "cannot create the tables");
  RunInfo own = info;
  if (own.uuid.empty()) own.uuid = make_uuid();
  if (own.started_utc.empty()) own.started_utc = iso8601(clock_.utc());
  if (own.host.empty()) own.host = machine_name();
  own.ended_utc.clear();
  own.status = "open";
  insert(db_, path_, own);
  if (begin) begin(*this);
  execute(db_, path_, "COMMIT", "cannot create the run file");
  use_wal();  // WAL mode is set before the file is visible to other processes
}

void RunWriter::begin_writing() {
  open(path_);
  reserve();
  use_wal();
  bind_wal(db_, path_);
  ready();
}

void RunWriter::lock() {
  lock_ = std::make_unique<WriterLock>(path_);
  if (!lock_->held())
    throw Error(ExitCode::failed, path_ + ": is being written by another process");
}

void RunWriter::open(const std::string& path) {
  handle_ = open_database(path, "cannot open");
  db_ = handle_.get();
  harden(db_);
  wait_for_others();
  execute(db_, path_, page_cache, "cannot set up the run file");
}

void RunWriter::wait_for_others() {
  const auto handler = [](void* self, int tries) {
    return static_cast<RunWriter*>(self)->waits_on(tries) ? 1 : 0;
  };
  sqlite3_busy_handler(db_, handler, this);
}

bool RunWriter::waits_on(int tries) {
  const std::int64_t now = now_ns();
  if (tries == 0) waits_since_ns_ = now;
  if (lock_wait_) lock_wait_->waited_ns = now;
  if (now >= (lock_wait_ ? lock_wait_->give_up_ns.load() : waits_since_ns_ + longest_wait_ns))
    return false;
  std::this_thread::sleep_for(retry_pause);
  return true;
}

bool LockWait::tried() const {
  return now_ns() - waited_ns < std::chrono::nanoseconds(10 * retry_pause).count();
}

void RunWriter::use_wal() {
  if (const std::string network = network_of(path_); !network.empty())
    throw Error(ExitCode::disk, path_ + ": is on a network file system (" + network +
                                    "), which SQLite's WAL cannot use; record to a local disk");
  Statement mode(db_, path_, "PRAGMA journal_mode=WAL");
  const std::string answer = mode.step() ? mode.text() : "";
  if (answer != "wal")
    throw Error(ExitCode::disk,
                path_ +
                    ": this file system does not support a live run "
                    "(no shared memory for SQLite's WAL, as on a network file system); "
                    "record to a local disk");
  execute(db_, path_, "PRAGMA synchronous=FULL", "cannot set up the run file");
}

// Starts to watch the files. Called after the first write, which creates the WAL.
void RunWriter::ready() {
  watch_ = std::make_unique<FileWatch>(path_);
  const auto hook = [](void* self, sqlite3*, const char*, int pages) {
    static_cast<RunWriter*>(self)->watch_->note_commit();
    if (pages >= checkpoint_pages) static_cast<RunWriter*>(self)->checkpoint();
    return SQLITE_OK;
  };
  sqlite3_wal_hook(db_, hook, this);  // the hook replaces SQLite's automatic checkpoints
}

// Returns true if the database contains all data of the WAL.
bool RunWriter::checkpoint() {
  touched_ = touched_ || watch_->touched();
  int in_wal = 0, taken_over = 0;
  sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_PASSIVE, &in_wal, &taken_over);
  watch_->note();
  if (taken_over != in_wal) watch_->note_commit();
  return taken_over == in_wal;
}

void RunWriter::complete(const std::string& status) {
  require_intact();
  sqlite3_busy_timeout(db_, 0);
  try {
    put_end(db_, path_, status, clock_.utc());
    if (checkpoint()) completed_ = status;
  } catch (const Error&) {
    if (sqlite3_errcode(db_) != SQLITE_BUSY) wait_for_others(), throw;
  }
  wait_for_others();
}

// If close() was not called, keeps the -wal, because a -wal marks a run that was not closed.
RunWriter::~RunWriter() {
  if (db_) sqlite3_db_config(db_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
}

void RunWriter::in_transaction(const std::function<void()>& body) {
  if (!watch_) return body();  // the constructor has its own transaction
  require_intact();
  execute(db_, path_, "BEGIN IMMEDIATE", "cannot write");
  try {
    body();
    execute(db_, path_, "COMMIT", "cannot write");
  } catch (...) {
    const int code = sqlite3_errcode(db_);
    if (code == SQLITE_CORRUPT || code == SQLITE_NOTADB)
      harm_ = std::string("was damaged during the run: ") + sqlite3_errstr(code);
    // SQLite may already have rolled back, e.g. because the disk is full.
    if (!sqlite3_get_autocommit(db_)) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

void RunWriter::append(const FusedRecord& record) { append(std::span(&record, 1)); }

void RunWriter::append(std::span<const FusedRecord> batch) {
  in_transaction([&] {
    Statement row(db_, path_, table_of<StoredRecord>().insert().c_str());
    const Shapes shapes = shapes_of(axes_);
    for (const auto& r : batch) append_row(row, path_, shapes, r);
  });
  records_ += static_cast<std::int64_t>(batch.size());
}

std::optional<std::string> RunWriter::new_label(UtcTime before) {
  if (!db_) return std::exchange(left_label_, {});
  require_intact();
  Statement s(db_, path_, "SELECT id, level, utc, text FROM event WHERE id > ? ORDER BY id");
  s.bind(last_event_);
  const std::string end = iso8601(before);  // ISO 8601 times can be compared as strings
  std::optional<std::string> label;
  while (s.step()) {
    const std::int64_t id = s.integer();
    const bool is_label = s.text() == "label";
    if (is_label && s.text() >= end) break;  // the label applies to a later slot
    last_event_ = id;
    if (is_label) label = s.text();
  }
  return label;
}

// Throws if a file of the run is missing, replaced or damaged. Other programs are allowed to write
// to the database, e.g. in a checkpoint.
void RunWriter::require_intact() {
  if (!watch_) return;  // the file is being created, and other processes cannot open it yet
  watch_->restore_index();
  if (harm_.empty()) harm_ = watch_->lost();
  const bool touched = std::exchange(touched_, false) || watch_->touched();
  if (harm_.empty() && !touched && watch_->wal_shortened())
    harm_ = "its -wal file was shortened during the run";
  if (harm_.empty() && touched) {
    watch_->note();
    harm_ = damage_during_the_run(db_, path_);
  }
  throw_harm();
}

// Throws unless the database is undamaged and complete. Must be called before the WAL is emptied,
// because emptying it would make damage permanent.
void RunWriter::require_complete() {
  harm_ = damage_during_the_run(db_, path_);
  if (harm_.empty())
    if (const std::int64_t found = count_records(db_, path_); found != records_)
      harm_ =
          "contains " + std::to_string(found) + " records instead of " + std::to_string(records_);
  throw_harm();
}

void RunWriter::throw_harm() const {
  if (!harm_.empty()) throw Error(ExitCode::disk, path_ + ": " + harm_);
}

bool RunWriter::close(const std::string& status, std::int64_t unwritten) {
  try {
    require_intact();
    require_complete();
  } catch (const Error&) {
    leave(status);
  }
  // Writing the status to a full disk needs some free space. Emptying the WAL frees space unless
  // the database must grow. Therefore the reserve is freed as well.
  sqlite3_busy_timeout(db_, 0);
  unbind_wal(db_, path_);
  sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  watch_->note();
  lock_->empty();
  wait_for_others();
  if (status != completed_) put_end(db_, path_, status, clock_.utc());
  if (unwritten > 0) put_unwritten(unwritten);
  try {
    require_intact();
  } catch (const Error&) {
    leave(status);
  }
  left_label_ = new_label(UtcTime::max());
  const std::string refusal = refusal_of_readers(db_, path_);
  const bool folded = fold();
  handle_.reset();
  db_ = nullptr;
  if (folded) lock_->remove();
  lock_.reset();
  if (!refusal.empty())
    throw Error(ExitCode::failed, refusal + " (" + std::to_string(records_) + " records are kept)");
  return folded;
}

void RunWriter::discard() {
  handle_.reset(), db_ = nullptr;
  if (watch_->same_database()) ::unlink(path_.c_str()), remove_side_files(path_);
  lock_->remove();
  lock_.reset();
}

void RunWriter::put_unwritten(std::int64_t records) {
  const CounterRow counted{"run", "unwritten", static_cast<std::uint64_t>(records)};
  try {
    put_counters({&counted, 1});
    put_event(clock_.utc(), Severity::error, "run",
              "its last " + std::to_string(records) + " records were not written");
  } catch (const Error&) {  // the disk has no space for the event
  }
}

void RunWriter::close_as_one_file(const std::string& status) {
  if (!close(status))
    throw Error(ExitCode::failed, path_ + ": another program is reading it, so the last records " +
                                      "are not in this file but in " + path_ + "-wal");
}

// Merges the WAL. Retries for half a second, so that a program that follows the run can read its
// end and close the file.
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

// Copies the committed records to another file and closes the database. Does not write to the file
// at `path_`, because it may belong to another program.
void RunWriter::leave(const std::string& status) {
  lock_->empty();
  // A complete file that was moved needs no copy.
  const bool moved = !completed_.empty() && !watch_->same_database();
  const Rescue kept =
      moved ? Rescue{true, "it was complete, with " + std::to_string(records_) + " records"}
            : rescue(db_, path_, status, clock_.utc(), records_);
  sqlite3_db_config(db_, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  handle_.reset();
  db_ = nullptr;
  if (kept.whole && !watch_->same_database()) watch_->remove_wal();
  if (moved) lock_->remove();
  lock_.reset();
  throw Error(ExitCode::disk, path_ + ": " + harm_ + "; " + kept.text);
}

// Reserves space for the row of the run, with its configuration, and for the index file of a
// reader.
void RunWriter::reserve() const { lock_->reserve(128 << 10); }

void RunWriter::put_axis(const Axis& axis) {
  in_transaction([&] { insert_axis(db_, path_, axis); });
  axes_.push_back(axis);
}

// Replaces the row that put_policy() wrote before the device answered.
void RunWriter::put_device(const DeviceInfo& device) {
  in_transaction([&] {
    const std::string name = name_of(device.sensor);
    DeviceRow row{device.sensor, {}, device};
    Statement policy(db_, path_, "SELECT policy FROM device WHERE sensor = ? AND policy NOTNULL");
    policy.bind(name);
    if (policy.step()) row.policy = policy.text();
    Statement(db_, path_, "DELETE FROM device WHERE sensor = ? AND address ISNULL")
        .bind(name)
        .run();
    insert(db_, path_, row);
  });
}

void RunWriter::put_policy(Sensor sensor, const std::string& policy) {
  in_transaction([&] {
    Statement(db_, path_, "UPDATE device SET policy = ? WHERE sensor = ?")
        .bind(policy)
        .bind(name_of(sensor))
        .run();
    if (sqlite3_changes(db_) == 0) insert(db_, path_, DeviceRow{sensor, policy, {}});
  });
}

void RunWriter::put_antennas(const Antennas& antennas) {
  in_transaction([&] {
    execute(db_, path_, "DELETE FROM antenna", "cannot store the antennas");
    for (const Antenna& antenna : antennas) insert(db_, path_, antenna);
  });
}

void RunWriter::put_calibration(const CalibrationEntry& entry) {
  in_transaction([&] { insert(db_, path_, entry); });
}

void RunWriter::put_anchor(HostTime mono, UtcTime utc) {
  in_transaction([&] { insert(db_, path_, Anchor{mono, utc}); });
}

void RunWriter::put_counters(std::span<const CounterRow> counters) {
  in_transaction([&] {
    for (const CounterRow& c : counters) insert(db_, path_, c);
  });
}

void RunWriter::put_late(const LateCounts& late) {
  in_transaction([&] {
    for (const auto& [record, counts] : late)
      insert(db_, path_, LateRow{record, counts},
             " ON CONFLICT (idx) DO UPDATE SET spd = spd + excluded.spd, radar = radar + "
             "excluded.radar, depth = depth + excluded.depth");
  });
}

void RunWriter::put_event(UtcTime utc, Severity severity, const std::string& source,
                          const std::string& text) {
  constexpr const char* levels[] = {"info", "warning", "error"};
  in_transaction([&] {
    insert(db_, path_,
           Event{iso8601(utc), levels[static_cast<std::size_t>(severity)], source, text});
  });
}

}  // namespace echofuse::record
