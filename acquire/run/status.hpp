// SPDX-License-Identifier: MIT
// Status line of the daemon at the terminal.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/fused_record.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Totals since the start of the run.
struct RunTotals {
  std::int64_t records = 0, written = 0;
  std::int64_t incomplete = 0;  // records without a required sensor
  std::int64_t not_ok = 0;      // records with a configured sensor that is not "ok"
  // Sums over all slots: samples received, and length of the slots.
  std::uint64_t tags = 0, radar_frames = 0, depth_frames = 0;
  double slots_s = 0;
  PerSensor<std::uint64_t> lost{};  // tags, radar frames, depth frames
  // Values of the last record.
  PerSensor<double> rate_hz{};  // tags, frames received in its slot
  SensorSet valid, doubtful;    // doubtful: configured, and not "ok"
  std::string trouble;          // first doubtful sensor and its verdict: "radar weak"
  std::string label;
  record::Signal signal;
  std::optional<std::uint64_t> free_bytes;         // free bytes of the disk
  PerSensor<std::string> kinds{"ok", "ok", "ok"};  // kinds of the last verdicts

  // Adds a record. Calls `changed` once for each configured sensor that drops out, becomes doubtful
  // or recovers.
  void take(const record::FusedRecord& record, SensorSet configured,
            const std::function<void(Sensor, Severity)>& changed);
  // Returns "; 3 with a sensor not ok", or nothing.
  std::string doubts() const;
};

// Returns "7 records", or "3 of 3 records" if that number is planned.
std::string count_text(std::int64_t written, std::optional<std::int64_t> planned);

// Field of the status line. Fields keep their order; a narrow terminal drops fields with a high
// rank first.
struct StatusField {
  std::string text;
  int rank = 0;      // 0: always shown
  bool bad = false;  // red on terminals with colours
};
struct StatusTimes {
  double elapsed_s = 0;                 // since the start of the first slot
  std::optional<double> remaining_s;    // if the end of the run is known
  std::optional<std::int64_t> records;  // records of the whole run, if its end is known
};
// The letter of a sensor (S, R, D) is lower-case if it is doubtful, and a dash if it is not valid.
std::vector<StatusField> status_fields(const RunTotals& now, const StatusTimes& times);

// Joins the fields that fit in `columns`, separated by two spaces; no value: all. A text has at
// most one column per byte.
std::string status_line(const std::vector<StatusField>& fields, std::optional<std::size_t> columns,
                        bool colours);

// Rewrites one line of a terminal within its width. Elsewhere prints a plain line every 10 s;
// nothing when quiet. Red unless NO_COLOR is set; rings the bell when a sensor becomes doubtful.
class StatusLine {
 public:
  using ShowLine = std::function<void(std::string)>;
  // `show` receives each line with control characters; empty: print to stderr.
  StatusLine(HostTime start, double window_s, std::optional<std::int64_t> total, bool quiet,
             ShowLine show);
  ~StatusLine();  // ends the line
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;
  void update(HostTime now, const RunTotals& totals);
  // Prints the last state with the rates of the whole run; the line remains.
  void finish(HostTime now, const RunTotals& totals);

 private:
  void show(HostTime now, const RunTotals& totals, const char* before = "", const char* after = "");
  ShowLine show_;
  std::optional<std::int64_t> total_;
  double window_s_;
  bool quiet_, terminal_, colours_, drawn_ = false;
  HostTime start_, shown_;
  RunTotals before_;
};

// Notifications of a run to systemd (sd_notify): ready with the first slot, then a heartbeat per
// record on disk. Without NOTIFY_SOCKET all functions do nothing. Threading: the loop's thread. A
// call blocks only if systemd does.
// The first slot begins. Extends a watchdog shorter than four slots.
void notify_ready(double window_s);
// Reports that `records` are on disk: at least one more than in the last call.
void notify_advance(std::int64_t records);
void notify_stopping();

}  // namespace echofuse::acquire
