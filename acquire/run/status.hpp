// SPDX-License-Identifier: MIT
// Status line of a run on the terminal, and status notifications to systemd.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/fused_record.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

struct RunTotals {
  std::int64_t records = 0, written = 0;
  std::int64_t incomplete = 0;  // number of records in which a required sensor is not valid
  std::int64_t not_ok = 0;      // number of records in which a configured sensor is doubtful
  // Number of samples received, and total duration of the slots.
  std::uint64_t tags = 0, radar_frames = 0, depth_frames = 0;
  double slots_s = 0;
  PerSensor<std::uint64_t> lost{};
  PerSensor<double> rate_hz{};  // received tags or frames per second
  SensorSet valid, doubtful;    // doubtful: configured, with a doubtful verdict
  std::string trouble;  // first doubtful sensor and the kind of its verdict, e.g. "radar weak"
  std::string label;
  record::Signal signal;
  std::optional<std::uint64_t> free_bytes;         // free space on the disk of the run, bytes
  PerSensor<std::string> words{"ok", "ok", "ok"};  // state of each sensor in the last record

  // Adds a record. Calls `changed` once for each configured sensor that becomes missing, becomes
  // doubtful or recovers.
  void take(const record::FusedRecord& record, SensorSet configured,
            const std::function<void(Sensor, Severity)>& changed);
  // Returns a string such as "; 3 with a sensor that is not ok"; empty if all records are ok.
  std::string doubts() const;
};

// Returns a string such as "7 records", or "3 of 5 records" if `planned` is 5.
std::string count_text(std::int64_t written, std::optional<std::int64_t> planned);

// Field of the status line. The order of the fields is fixed. If the terminal is too narrow, fields
// with a high rank are omitted first.
struct StatusField {
  std::string text;
  int rank = 0;      // fields of rank 0 are omitted last
  bool bad = false;  // true: shown in red on a colour terminal
};
struct StatusTimes {
  double elapsed_s = 0;                 // time since the first slot began
  std::optional<double> remaining_s;    // remaining time, if the number of slots is known
  std::optional<std::int64_t> records;  // planned number of records, if known
};
// Returns the fields of the status line. Each sensor is represented by a letter (S, R, D). The
// letter is in lower case if the sensor is doubtful, and is replaced by a dash if it is not valid.
std::vector<StatusField> status_fields(const RunTotals& now, const StatusTimes& times);

// Joins the fields that fit into `columns`, separated by two spaces; joins all fields if `columns`
// has no value. Each byte is counted as one column, so that the line is never too long.
std::string status_line(const std::vector<StatusField>& fields, std::optional<std::size_t> columns,
                        bool colours);

// On a terminal, rewrites one line and keeps it within the width of the terminal. Otherwise prints
// a plain line every 10 s. Prints nothing if `quiet` is set. Uses red unless NO_COLOR is set. Rings
// the terminal bell when a sensor becomes doubtful.
class StatusLine {
 public:
  using ShowLine = std::function<void(std::string)>;
  // `show` receives each line, including control characters; if it is empty, lines are printed to
  // stderr.
  StatusLine(HostTime start, double window_s, std::optional<std::int64_t> total, bool quiet,
             ShowLine show);
  ~StatusLine();  // prints a line break if a status line is on the terminal
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;
  void update(HostTime now, const RunTotals& totals);
  // Prints the final state with the mean rates of the whole run. The line remains on the terminal.
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

// Notifications of a run to systemd (sd_notify). They do nothing if NOTIFY_SOCKET is not set.
// Threading: used only on the loop's thread; a call blocks only if systemd blocks.

// Reports that the run is ready. Extends the watchdog period if it is shorter than four slots.
void notify_ready(double window_s);
// Reports the number of records on disk and triggers the watchdog. May be called only if that
// number has increased.
void notify_advance(std::int64_t records);
void notify_stopping();

}  // namespace echofuse::acquire
