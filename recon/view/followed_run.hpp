// SPDX-License-Identifier: MIT
// A run as it is now: live, finished or crashed. Opens the file for each look
// and never holds it, because its writer leaves one single file only then.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::view {

// Values kept of each record for the strips over the run.
struct Outline {
  std::int64_t index = 0;
  UtcTime start{}, end{};
  SensorSet valid;
  PerSensor<float> used{}, lost{}, residual_s{};  // residual_s: NaN where there is none
};

// State of one sensor up to the last record.
struct SensorState {
  std::string verdict;  // verdict of the last record
  bool configured = false, valid = false;
  std::optional<UtcTime> last_valid;    // the end of its last valid slot
  double used = 0;                      // in the last record
  std::optional<std::int64_t> arrived;  // frames in its slot, used or not
  std::uint64_t lost = 0, late = 0;     // counts of the whole run
  std::uint64_t missing = 0;            // records of the run without it
  std::optional<double> residual_s;
};

// Stamp of a file that changes whenever a run does.
struct FileStamp {
  std::uint64_t inode = 0, bytes = 0;  // bytes: with the WAL
  std::int64_t changed_ns = 0;
  bool written = false;  // by a process that lives: a crash changes nothing but this
  bool operator==(const FileStamp&) const = default;
};
FileStamp stamp_of(const std::string& path);

class FollowedRun {
 public:
  // target: a run file, or a folder (then its newest run, the one that began last); may not exist
  // yet.
  explicit FollowedRun(std::string target) : target_(std::move(target)) {}

  // Looks whether anything is new, which costs next to nothing if not. Returns whether there was.
  bool refresh();

  const std::string& path() const { return path_; }
  const std::string& trouble() const { return trouble_; }  // why nothing can be read; or empty
  // Another one for each file that is another run, or has other axes or another status.
  int edition() const { return edition_; }
  const record::RunInfo& info() const { return info_; }
  const std::vector<Axis>& axes() const { return axes_; }
  const std::vector<record::Event>& events() const { return events_; }  // the last of them
  const std::vector<Outline>& outlines() const { return outlines_; }
  // Temperatures of the radar's chip by place, degrees C, of the last record.
  const std::vector<std::pair<std::string, int>>& temperatures() const { return temperatures_; }
  const std::string& label() const { return label_; }
  const PerSensor<SensorState>& sensors() const { return sensors_; }
  // Summary of all records: their number, the doubtful ones, and verdicts by sensor.
  const record::RunSummary& verdicts() const { return verdicts_; }
  std::optional<std::int64_t> last() const;  // index
  bool live() const { return info_.status == "open"; }
  std::uint64_t bytes() const { return stamp_.bytes; }  // with the WAL
  std::optional<std::uint64_t> free_bytes() const;      // free bytes of its disk

  // Opens the run for one look. Throws Error.
  using Look = std::function<void(const record::RunReader&)>;
  void with_reader(const Look& look) const;

 private:
  struct Begun {  // a file of the folder
    FileStamp stamp;
    std::string utc;  // empty: it is no run
  };
  std::string newest_file();
  std::string find();
  void read();
  void forget();
  void take(const record::FusedRecord& outline);

  std::string target_, path_, trouble_, label_;
  std::map<std::string, Begun> begun_;  // by path
  FileStamp stamp_;
  int edition_ = 0;
  record::RunInfo info_;
  std::vector<Axis> axes_;
  std::vector<record::Event> events_;
  std::vector<Outline> outlines_;
  PerSensor<SensorState> sensors_;
  record::RunSummary verdicts_;
  std::vector<std::pair<std::string, int>> temperatures_;
};

// Seconds since a sensor's last valid slot ended; nothing if it had none.
std::optional<double> age_s(const SensorState& sensor, UtcTime now);
// Two slots without a valid one: as a lamp shows it in red.
bool is_stale(const SensorState& sensor, double window_s, UtcTime now);

}  // namespace echofuse::view
