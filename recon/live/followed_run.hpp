// SPDX-License-Identifier: MIT
// Follows a run file: live, finished or crashed. Opens the file for each read only, because an open
// reader would keep the writer from merging the WAL into one file.
#pragma once
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/run_file.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::view {

// Values of each record for the strips over the run.
struct Outline {
  std::int64_t index = 0;
  UtcTime start{}, end{};
  SensorSet valid;
  PerSensor<float> used{}, lost{}, residual_s{};              // residual_s: NaN if not measured
  float radar_c = std::numeric_limits<float>::quiet_NaN();    // highest temperature on the chip
  float margin_ms = std::numeric_limits<float>::quiet_NaN();  // spare time of a radar frame
};

// State of one sensor up to the last record.
struct SensorState {
  std::string verdict;  // verdict of the last record
  bool configured = false, valid = false;
  std::optional<UtcTime> last_valid;    // end of its last valid slot
  double used = 0;                      // in the last record
  std::optional<std::int64_t> arrived;  // frames in its slot, used or not
  std::uint64_t lost = 0, late = 0;     // counts of the whole run
  std::uint64_t missing = 0;            // records of the run without this sensor
  std::optional<double> residual_s;
};

// Changes whenever the run file changes.
struct FileStamp {
  std::uint64_t inode = 0, bytes = 0;  // with the WAL
  std::int64_t changed_ns = 0;
  bool written = false;  // a live process writes it; after a crash only this changes
  bool operator==(const FileStamp&) const = default;
};
FileStamp stamp_of(const std::string& path);

class FollowedRun {
 public:
  // `target` is a run file or a folder (then its newest run); it need not exist yet.
  explicit FollowedRun(std::string target) : target_(std::move(target)) {}

  // Reads new records; returns true if there were any. Cheap if the file has not changed.
  bool refresh();

  const std::string& path() const { return path_; }
  // Reason why the run cannot be read, or empty.
  const std::string& trouble() const { return trouble_; }
  // Changes if the file becomes another run, its axes or status change, or it can be read again.
  int edition() const { return edition_; }
  const record::RunInfo& info() const { return info_; }
  const std::vector<Axis>& axes() const { return axes_; }
  const std::vector<record::Event>& events() const { return events_; }  // the newest ones
  const std::vector<Outline>& outlines() const { return outlines_; }
  const std::string& label() const { return label_; }
  const PerSensor<SensorState>& sensors() const { return sensors_; }
  // Totals over all records: number, doubtful records, verdicts by sensor.
  const record::RunSummary& verdicts() const { return verdicts_; }
  std::optional<std::int64_t> last() const;  // index
  bool live() const { return info_.status == "open"; }
  std::uint64_t bytes() const { return stamp_.bytes; }  // with the WAL
  std::optional<std::uint64_t> free_bytes() const;      // on the disk of the run

  // Opens the run for one read. Throws Error.
  using ReadAction = std::function<void(const record::RunReader&)>;
  void with_reader(const ReadAction& use) const;

 private:
  struct FolderEntry {  // a file of the folder
    FileStamp stamp;
    std::string utc;  // start time; empty if it is not a run
  };
  std::string newest_file();
  std::string find();
  void read();
  void forget();
  void take(const record::FusedRecord& outline);

  std::string target_, path_, trouble_, label_;
  std::map<std::string, FolderEntry> begun_;  // by path
  FileStamp stamp_;
  int edition_ = 0;
  record::RunInfo info_;
  std::vector<Axis> axes_;
  std::vector<record::Event> events_;
  std::vector<Outline> outlines_;
  PerSensor<SensorState> sensors_;
  record::RunSummary verdicts_;
};

// Returns the seconds since the end of the sensor's last valid slot; empty without a valid slot.
std::optional<double> age_s(const SensorState& sensor, UtcTime now);
// Returns true after two slots without valid data; the lamp turns red.
bool is_stale(const SensorState& sensor, double window_s, UtcTime now);

}  // namespace echofuse::view
