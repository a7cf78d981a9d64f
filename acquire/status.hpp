// SPDX-License-Identifier: MIT
// The daemon's line at the terminal.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// Totals since the start of the run.
struct RunTotals {
  std::int64_t records = 0, written = 0;
  std::uint32_t valid = 0;  // of the last record
  std::int64_t not_ok = 0;  // records of which a configured sensor's verdict is not "ok"
  std::uint64_t tags = 0, radar_frames = 0, depth_frames = 0, lost = 0;
};

// "record 7/20  SRD  1.20 Mtag/s  radar 20.0 fps  depth 30.0 fps  lost 0  on disk 7"; a dash for
// each sensor that the last record lacks. Rates are over `elapsed_s` since `before`.
std::string status_text(const RunTotals& now, const RunTotals& before, double elapsed_s,
                        std::optional<std::int64_t> total);

// One line that is rewritten on a terminal, a plain line every 10 s elsewhere, nothing when quiet.
class StatusLine {
 public:
  StatusLine(HostTime start, std::optional<std::int64_t> total, bool quiet);
  ~StatusLine();  // ends the line
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;
  void update(HostTime now, const RunTotals& totals);
  // The last state, with the rates of the whole run.
  void finish(HostTime now, const RunTotals& totals);

 private:
  void show(HostTime now, const RunTotals& totals);
  std::optional<std::int64_t> total_;
  bool quiet_, terminal_, drawn_ = false;
  HostTime start_, shown_;
  RunTotals before_;
};

}  // namespace echofuse::acquire
