// SPDX-License-Identifier: MIT
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <random>

#include "acquire/record/png.hpp"
#include "acquire/record/run_file.hpp"
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

// Reserves the path, so that two writers cannot take the same one.
void create_empty(const std::string& path) {
  const int fd = ::open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0644);
  if (fd >= 0) {
    ::close(fd);
    return;
  }
  if (errno == EEXIST)
    throw Error(ExitCode::failed,
                path + ": exists already; runs are never overwritten, choose another name");
  throw Error(ExitCode::disk, path + ": cannot create the run file: " + std::strerror(errno));
}

// Other processes may write marks; what waits for one of them longer is broken.
constexpr int busy_timeout_ms = 30'000;
// The status rewrites the row of the run, configuration included, and readers need an index file.
constexpr int reserve_bytes = 128 << 10;

std::string blob_place(const FusedRecord& r, Sensor s) {
  return "record " + std::to_string(r.index) + ": " + name_of(s);
}

}  // namespace

struct RunWriter::Statements {
  Statements(sqlite3* db, const std::string& path)
      : record(db, path,
               "INSERT INTO record VALUES (?,?,?,?,?,?,?,?,?, ?,?,?,?,?,?,?, ?,?,?,?,?, ?,?,?,?,?, "
               "?,?,?,?,?)"),
        event(db, path, "INSERT INTO event (utc, level, source, text) VALUES (?,?,?,?)"),
        begin(db, path, "BEGIN IMMEDIATE"),
        commit(db, path, "COMMIT") {}
  Statement record, event, begin, commit;
};

RunWriter::RunWriter(const std::string& path, const RunInfo& info) : path_(path) {
  create_empty(path);
  open();
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
  Statement run(db_, path_, "INSERT INTO run VALUES (?,?,?,?,?,?,?,?,?,?,?,?)");
  run.bind(make_uuid())
      .bind(given_or(info.started_utc, iso8601(clock.utc())))
      .bind("")
      .bind("open")
      .bind(info.window_s)
      .bind(info.config_text)
      .bind(info.config_resolved)
      .bind(info.radar_cfg)
      .bind(info.version)
      .bind(given_or(info.host, host_name()))
      .bind(info.operator_name)
      .bind(info.notes)
      .run();
  for (const auto& [key, value] : info.meta)
    Statement(db_, path_, "INSERT INTO meta VALUES (?,?)").bind(key).bind(value).run();
  execute(db_, path_, "COMMIT", "cannot create the tables");
  statements_ = std::make_unique<Statements>(db_, path_);
}

RunWriter::RunWriter(const std::string& path) : path_(path) {
  axes_ = RunReader(path).axes();  // and: it is a run file
  open();
  execute(db_, path_, schema, "cannot add the tables of this version");
  execute(db_, path_, "UPDATE run SET status = 'open', ended_utc = ''", "cannot reopen");
  Statement state(db_, path_,
                  "SELECT count(*), ifnull(max(idx) + 1, 0), (SELECT ifnull(max(id), 0) FROM "
                  "event) FROM record");
  state.step();
  for (std::int64_t* v : {&records_, &next_index_, &last_event_}) *v = state.integer();
  statements_ = std::make_unique<Statements>(db_, path_);
}

void RunWriter::open() {
  lock_ = std::make_unique<WriterLock>(path_);
  if (!lock_->held())
    throw Error(ExitCode::failed, path_ + ": is being written by another process");
  if (sqlite3_open_v2(path_.c_str(), &db_, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK)
    sqlite_fail(db_, path_, "cannot open");
  lock_->reserve(reserve_bytes);
  sqlite3_busy_timeout(db_, busy_timeout_ms);
  execute(db_, path_, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;", "cannot set up");
}

RunWriter::~RunWriter() {
  statements_.reset();
  sqlite3_close(db_);
}

void RunWriter::put_axis(const Axis& axis) {
  Statement(db_, path_, "INSERT INTO axis VALUES (?,?,?,?,?,?,?)")
      .bind(axis.name)
      .bind(axis.quantity)
      .bind(axis.unit)
      .bind(std::int64_t{axis.count})
      .bind(axis.start)
      .bind(axis.step)
      .bind(axis.scale)
      .run();
  axes_.push_back(axis);
}

void RunWriter::put_device(const DeviceInfo& device) {
  Statement(db_, path_, "INSERT INTO device VALUES (?,?,?,?,?)")
      .bind(name_of(device.sensor))
      .bind(device.address)
      .bind(device.model)
      .bind(device.serial)
      .bind(device.firmware)
      .run();
}

void RunWriter::put_calibration(const CalibrationEntry& entry) {
  Statement(db_, path_, "INSERT INTO calibration VALUES (?,?,?,?,?,?)")
      .bind(name_of(entry.sensor))
      .bind(entry.date_utc)
      .bind(entry.method)
      .bind(entry.distance_m)
      .bind(entry.offset_m)
      .bind(entry.standard_error_m)
      .run();
}

void RunWriter::put_policy(Sensor sensor, const std::string& policy) {
  Statement(db_, path_, "INSERT OR REPLACE INTO policy VALUES (?,?)")
      .bind(name_of(sensor))
      .bind(policy)
      .run();
}

void RunWriter::put_counter(const std::string& source, const std::string& name,
                            std::uint64_t value) {
  Statement(db_, path_, "INSERT INTO counter VALUES (?,?,?)")
      .bind(source)
      .bind(name)
      .bind(value)
      .run();
}

void RunWriter::put_anchor(HostTime mono, UtcTime utc) {
  Statement(db_, path_, "INSERT INTO anchor VALUES (?,?)")
      .bind(std::int64_t{mono.count()})
      .bind(std::int64_t{utc.count()})
      .run();
}

void RunWriter::put_event(UtcTime utc, Severity severity, const std::string& source,
                          const std::string& text) {
  constexpr const char* levels[] = {"info", "warning", "error"};
  statements_->event.reset();
  statements_->event.bind(iso8601(utc))
      .bind(levels[static_cast<std::size_t>(severity)])
      .bind(source)
      .bind(text)
      .run();
}

void RunWriter::insert(const FusedRecord& r) {
  const auto expect = [&](Sensor s, std::size_t got, std::size_t wanted) {
    if (r.has(s) && got != wanted)
      throw Error(ExitCode::failed, path_ + ": " + blob_place(r, s) + " has " +
                                        std::to_string(got) + " values, its axis " +
                                        std::to_string(wanted));
  };
  const auto count_of = [&](const char* name) -> std::uint32_t {
    for (const auto& a : axes_)
      if (a.name == name) return a.count;
    return 0;
  };
  const std::uint32_t width = count_of("depth_x"), height = count_of("depth_y");
  expect(Sensor::spd, r.spd.size(), count_of("spd"));
  expect(Sensor::radar, r.radar.size(), count_of("radar"));
  expect(Sensor::depth, r.depth_mm.size(), std::size_t{width} * height);
  const Bytes png = r.has(Sensor::depth) ? encode_png16(r.depth_mm, width, height) : Bytes{};

  Statement& s = statements_->record;
  s.reset();
  s.bind(r.index)
      .bind(std::int64_t{r.slot_start.count()})
      .bind(std::int64_t{r.slot_end.count()})
      .bind(std::int64_t{r.slot_utc.count()})
      .bind(std::int64_t{r.valid})
      .bind(r.label);
  const SpdCounts& c = r.spd_counts;
  for (const std::uint64_t v :
       {c.tags, c.starts, c.in_range, c.out_of_range, c.without_start, c.other, c.lost})
    s.bind(v);
  for (const SensorSync& y : r.sync)
    s.bind(y.offset_s).bind(y.span_s).bind(y.used).bind(y.lost).bind(y.verdict);
  s.bind(r.has(Sensor::spd) ? as_bytes(r.spd) : ByteView{})
      .bind(r.has(Sensor::radar) ? as_bytes(r.radar) : ByteView{})
      .bind(ByteView{png})
      .run();
  if (r.radar_stats || r.radar_temperature) insert_status(r);
  insert_spd_status(r);
  insert_sync(r);
  insert_books(r);
  insert_signal(r);
}

void RunWriter::insert_sync(const FusedRecord& r) {
  if (r.missing != 0) {
    std::string names;
    for (const Sensor sensor : {Sensor::spd, Sensor::radar, Sensor::depth}) {
      if (!((r.missing >> static_cast<unsigned>(sensor)) & 1u)) continue;
      if (!names.empty()) names += ' ';
      names += name_of(sensor);
    }
    Statement(db_, path_, "INSERT INTO incomplete VALUES (?,?)").bind(r.index).bind(names).run();
  }
  if (!r.clocks[0] && !r.clocks[1] && !r.clocks[2]) return;
  Statement s(db_, path_, "INSERT INTO clock_fit VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const auto& clock : r.clocks)
    if (clock)
      s.bind(clock->offset_s).bind(clock->drift_ppm).bind(clock->residual_s).bind(clock->samples);
    else
      for (int i = 0; i < 4; ++i) s.bind(ByteView{});
  s.run();
}

void RunWriter::insert_books(const FusedRecord& r) {
  const SlotBooks& b = r.books;
  Statement s(db_, path_, "INSERT INTO slot VALUES (?,?,?,?,?,?)");
  const auto put = [&](std::uint64_t frames, std::optional<std::uint32_t> last) {
    s.bind(frames);
    last ? s.bind(std::int64_t{*last}) : s.bind(ByteView{});
  };
  s.bind(r.index);
  put(b.radar_frames, b.radar_last);
  put(b.depth_frames, b.depth_last);
  s.bind(b.closed_late_s).run();
}

void RunWriter::insert_signal(const FusedRecord& r) {
  const Signal& n = r.signal;
  if (n == Signal{}) return;
  Statement s(db_, path_, "INSERT INTO signal VALUES (?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const auto& v : {n.clicks_a_pulse, n.spd_clicks, n.spd_peak_m, n.radar_snr_db,
                        n.radar_peak_m, n.depth_share})
    v ? s.bind(*v) : s.bind(ByteView{});
  s.run();
}

void RunWriter::insert_spd_status(const FusedRecord& r) {
  const SpdCounts& c = r.spd_counts;
  if (c.missed + c.overflows + c.errors + c.bad_tags + c.backwards + c.removed == 0) return;
  Statement s(db_, path_, "INSERT INTO spd_status VALUES (?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const std::uint64_t v :
       {c.missed, c.overflows, c.errors, c.bad_tags, c.backwards, c.removed})
    s.bind(v);
  s.run();
}

void RunWriter::insert_status(const FusedRecord& r) {
  Statement s(db_, path_, "INSERT INTO radar_status VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
  s.bind(r.index);
  const auto put = [&](bool there, std::int64_t value) {
    there ? s.bind(value) : s.bind(ByteView{});
  };
  const bool stats = r.radar_stats.has_value();
  const RadarStats n = r.radar_stats.value_or(RadarStats{});
  for (const std::uint32_t v :
       {n.inter_frame_processing_us, n.transmit_us, n.inter_frame_margin_us,
        n.inter_chirp_margin_us, n.active_frame_load_percent, n.inter_frame_load_percent})
    put(stats, v);
  const RadarTemperature t = r.radar_temperature.value_or(RadarTemperature{1, 0, {}});
  put(t.invalid == 0, t.time_ms);
  for (const std::int16_t v : t.celsius) put(t.invalid == 0, v);
  s.run();
}

void RunWriter::in_transaction(const std::function<void()>& body) {
  statements_->begin.reset();
  statements_->begin.run();
  try {
    body();
    statements_->commit.reset();
    statements_->commit.run();
  } catch (...) {
    // Releases the statement that failed; a full disk may have rolled back already.
    statements_->record.reset();
    statements_->commit.reset();
    if (!sqlite3_get_autocommit(db_)) sqlite3_exec(db_, "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
}

void RunWriter::append(const FusedRecord& record) { append(std::span(&record, 1)); }

void RunWriter::append(std::span<const FusedRecord> batch) {
  // Without its name a file is written as before, and all of it is lost at the end.
  if (::access(path_.c_str(), F_OK) != 0)
    throw Error(ExitCode::disk, path_ + ": was removed or renamed during the run");
  in_transaction([&] {
    for (const auto& r : batch) insert(r);
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

void RunWriter::close(const std::string& status) {
  const SystemClock clock;
  // Two chances on a full disk: the WAL is emptied, or, where the file cannot grow for that, the
  // reserve is given back.
  sqlite3_wal_checkpoint_v2(db_, nullptr, SQLITE_CHECKPOINT_TRUNCATE, nullptr, nullptr);
  lock_->release();
  Statement(db_, path_, "UPDATE run SET status = ?, ended_utc = ?")
      .bind(status)
      .bind(iso8601(clock.utc()))
      .run();
  statements_.reset();
  // Folds the WAL back if no reader holds it; a reader's close does it otherwise.
  sqlite3_exec(db_, "PRAGMA journal_mode=DELETE", nullptr, nullptr, nullptr);
  sqlite3_close(db_);
  db_ = nullptr;
  lock_.reset();
}

void mark(const std::string& path, const std::string& level, const std::string& text) {
  if (RunReader(path).info().status != "open")
    throw Error(ExitCode::failed,
                path + ": nobody is recording this run; only a live one is marked");
  sqlite3* db = nullptr;
  if (sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READWRITE, nullptr) != SQLITE_OK)
    sqlite_fail(db, path, "cannot open for writing");
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> closing(db, sqlite3_close);
  sqlite3_busy_timeout(db, busy_timeout_ms);
  Statement(db, path, "INSERT INTO event (utc, level, source, text) VALUES (?,?,'mark',?)")
      .bind(iso8601(SystemClock().utc()))
      .bind(level)
      .bind(text)
      .run();
}

}  // namespace echofuse::record
