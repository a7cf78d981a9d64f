// SPDX-License-Identifier: MIT
// Follows the file of a live, finished or crashed run. Opens the file separately for each read,
// because the writer cannot merge the WAL into the file while a reader has it open.
#pragma once
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/run_reader.hpp"
#include "drivers/core/clock.hpp"

namespace echofuse::view {

// Values of one record plotted over time by the web page.
struct Outline {
  std::int64_t index = 0;
  UtcTime start{}, end{};
  SensorSet valid;
  bool doubtful = false;
  PerSensor<float> used{}, lost{}, residual_s{};  // residual_s: clock residual; NaN if not measured
  // Highest temperature on the radar chip, degrees C.
  float radar_c = std::numeric_limits<float>::quiet_NaN();
  float margin_ms = std::numeric_limits<float>::quiet_NaN();  // idle time per radar frame, ms
};

// State of one sensor after the newest record.
struct SensorState {
  record::Verdict verdict;  // verdict on the sensor in the newest record
  bool configured = false, valid = false;
  std::optional<UtcTime> last_valid;  // end of the last slot with valid data
  double used = 0;                    // number of clicks or frames used in the newest record
  // Number of frames received in the slot of the newest record, including unused ones.
  std::optional<std::int64_t> arrived;
  std::uint64_t lost = 0, late = 0;  // number of lost and late samples in the whole run
  std::uint64_t missing = 0;         // number of records without valid data from this sensor
  std::optional<double> residual_s;
  std::optional<std::size_t> last_doubtful;  // position of the last doubtful record in outlines()
};

// Properties of a run file that change if its contents change.
struct FileStamp {
  std::uint64_t inode = 0, bytes = 0;  // bytes: total size of the run file and its WAL
  std::int64_t changed_ns = 0;
  // True while a process has the file open for writing; false again if that process crashes.
  bool written = false;
  bool operator==(const FileStamp&) const = default;
};
FileStamp stamp_of(const std::string& path);

class FollowedRun {
 public:
  // `target`: run file or folder. If it is a folder, the newest run is followed. The target may not
  // exist yet.
  explicit FollowedRun(std::string target) : target_(std::move(target)) {}

  // Reads new records. Returns true if anything has changed. Returns quickly if the file has not
  // changed.
  bool refresh();

  const std::string& path() const { return path_; }
  // Returns the reason why the run cannot be read; empty if it can be read.
  const std::string& trouble() const { return trouble_; }
  // Returns a number that increases whenever another run replaces the current run, the axes or the
  // status of the run change, or the run becomes readable again.
  int edition() const { return edition_; }
  const record::RunInfo& info() const { return info_; }
  const std::vector<Axis>& axes() const { return axes_; }
  const std::vector<record::Event>& events() const { return events_; }  // newest events
  const std::vector<Outline>& outlines() const { return outlines_; }
  const std::string& label() const { return label_; }
  const PerSensor<SensorState>& sensors() const { return sensors_; }
  // Returns totals over all records: the number of records, the number of doubtful records and, for
  // each sensor, the number of records with each verdict.
  const record::VerdictCounts& verdicts() const { return verdicts_; }
  std::optional<std::int64_t> last() const;  // returns the index of the newest record
  bool live() const { return info_.status == "open"; }
  std::uint64_t bytes() const { return stamp_.bytes; }  // size with the WAL
  std::optional<std::uint64_t> free_bytes()
      const;  // returns the free space on the disk that contains the run

  // with_reader() opens the run and passes the reader to `use`. It throws Error if the run cannot
  // be read.
  using ReadAction = std::function<void(const record::RunReader&)>;
  void with_reader(const ReadAction& use) const;

 private:
  struct FolderEntry {  // a file in the followed folder
    FileStamp stamp;
    std::string utc;  // start time of the run; empty if the file is not a run
  };
  std::string newest_file();
  std::string find();
  void read();
  void forget();
  void take(const record::FusedRecord& outline);

  std::string target_, path_, trouble_, label_;
  std::map<std::string, FolderEntry> begun_;  // folder entries by path
  FileStamp stamp_;
  int edition_ = 0;
  record::RunInfo info_;
  std::vector<Axis> axes_;
  std::vector<record::Event> events_;
  std::vector<Outline> outlines_;
  PerSensor<SensorState> sensors_;
  record::VerdictCounts verdicts_;
};

// Returns the time in seconds since the end of the sensor's last valid slot; empty if no slot was
// valid.
std::optional<double> age_s(const SensorState& sensor, UtcTime now);
// Returns true if the sensor has had no valid data for two slot lengths plus 0.5 s. The web page
// then shows a red status lamp for this sensor.
bool is_stale(const SensorState& sensor, double window_s, UtcTime now);

}  // namespace echofuse::view
