// SPDX-License-Identifier: MIT
// The daemon's line at the terminal.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/record.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Totals since the start of the run.
struct RunTotals {
  std::int64_t records = 0, written = 0;
  std::int64_t incomplete = 0;  // records without a required sensor
  std::int64_t not_ok = 0;      // records of which a configured sensor's verdict is not "ok"
  // Sums over all slots: samples that arrived, and length of the slots.
  std::uint64_t tags = 0, radar_frames = 0, depth_frames = 0;
  double slots_s = 0;
  PerSensor<std::uint64_t> lost{};  // tags, radar frames, depth frames
  // Values of the last record.
  PerSensor<double> rate_hz{};  // tags, frames that arrived in its slot
  SensorSet valid, doubtful;    // doubtful: configured, and the verdict is not "ok"
  std::string trouble;          // first doubtful sensor and its verdict: "radar weak"
  std::string label;
  record::Signal signal;
  std::optional<std::uint64_t> free_bytes;         // free bytes of the disk
  PerSensor<std::string> kinds{"ok", "ok", "ok"};  // kinds of the last verdicts

  // Adds a record. `changed` hears once of each configured sensor that drops out, gets bad or comes
  // back.
  void take(const record::FusedRecord& record, SensorSet configured,
            const std::function<void(Sensor, Severity)>& changed);
  // "; 3 with a sensor not ok", or nothing.
  std::string doubts() const;
};

// "7 records", or "3 of 3 records" if so many are planned.
std::string count_text(std::int64_t written, std::optional<std::int64_t> planned);

// Field of the status line. Fields keep their order; a narrow terminal drops those of low rank
// first.
struct StatusField {
  std::string text;
  int rank = 0;      // 0: shown always
  bool bad = false;  // in red, where there are colours
};
struct StatusTimes {
  double elapsed_s = 0;                 // since the first slot's start
  std::optional<double> remaining_s;    // if the run's end is known
  std::optional<std::int64_t> records;  // records of the whole run, if the run's end is known
};
// A sensor's letter (S, R, D) is a small one if it is doubtful, and a dash if it is not valid.
std::vector<StatusField> status_fields(const RunTotals& now, const StatusTimes& times);

// The fields that fit together into `columns`, two blanks between them; none: all. A text has at
// most as many columns as bytes.
std::string status_line(const std::vector<StatusField>& fields, std::optional<std::size_t> columns,
                        bool colours);

// Rewrites one line on a terminal, never longer than the terminal is wide. Elsewhere prints a plain
// line every 10 s; nothing when quiet. Red unless NO_COLOR is set; the bell rings when a sensor
// gets bad.
class StatusLine {
 public:
  using Show = std::function<void(std::string)>;
  // `show` gets each line with what draws it; none: they go to stderr.
  StatusLine(HostTime start, double window_s, std::optional<std::int64_t> total, bool quiet,
             Show show);
  ~StatusLine();  // ends the line
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;
  void update(HostTime now, const RunTotals& totals);
  // The last state, with the rates of the whole run; it stays.
  void finish(HostTime now, const RunTotals& totals);

 private:
  void show(HostTime now, const RunTotals& totals, const char* before = "", const char* after = "");
  Show show_;
  std::optional<std::int64_t> total_;
  double window_s_;
  bool quiet_, terminal_, colours_, drawn_ = false;
  HostTime start_, shown_;
  RunTotals before_;
};

// Notifications of a run to systemd (sd_notify): ready with the first slot, then a heartbeat for
// every record on disk. Nothing is sent to anybody else: without NOTIFY_SOCKET all of it does
// nothing. Threading: the loop's thread. A call waits only while systemd itself stands still.
// The first slot begins. A watchdog shorter than four slots is asked to wait that long.
void notify_ready(double window_s);
// Reports that `records` are on disk: at least one more than at the last call.
void notify_advance(std::int64_t records);
void notify_stopping();

}  // namespace echofuse::acquire
