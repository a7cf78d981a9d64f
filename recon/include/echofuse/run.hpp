// SPDX-License-Identifier: MIT
/// @file
/// Reads the file of a finished, live or crashed run, and follows a run that is being recorded.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "echofuse/record.hpp"

namespace echofuse {

/// Status of a run.
enum class StatusCode : std::uint8_t {
  open,      ///< the run is being recorded
  complete,  ///< all records were written
  stopped,   ///< the recording was stopped, e.g. by the operator or because the disk was full
  crashed,   ///< the recording process was killed
  copy,      ///< the file is a copy of a run that was being recorded
};

/// Description of a run, as stored in the run file.
struct RunInfo {
  std::string uuid;         ///< unique identifier of the run, independent of the file name
  std::string started_utc;  ///< start time, ISO 8601
  std::string ended_utc;    ///< end time, ISO 8601; empty unless the run is closed
  std::string status;       ///< `open`, `complete`, `crashed`, or `stopped:` followed by the reason
  StatusCode status_code = StatusCode::open;  ///< kind of the status
  std::string notes;                          ///< the operator's notes on the run; may be empty
  double window_s = 0;                        ///< duration of each slot, s
  /// Names and values passed with `run --meta`.
  std::vector<std::pair<std::string, std::string>> meta;
};

/// Callback for a damaged record. Receives its index and a description of the fault.
using OnDamaged = std::function<void(std::int64_t, const std::string&)>;

/// A run file, opened read-only. On failure, every member throws Exception. Threading: a Run may be
/// used by only one thread at a time, but each thread may open its own Run of the same file.
class Run {
 public:
  /// Opens the run at `path`; the extension `.sqlite` is optional. Throws if the file is missing or
  /// damaged, or is not a run in the format that this version reads.
  explicit Run(const std::string& path);

  /// Returns the path that was passed to the constructor.
  [[nodiscard]] const std::string& path() const;
  /// Returns the description of the run, as stored in the run file.
  [[nodiscard]] RunInfo info() const;
  /// Returns the number of records, which increases while the run is being recorded.
  [[nodiscard]] std::int64_t count() const;
  /// Returns the axis called `name`: `spd`, `radar`, `array`, `depth_x` or `depth_y`. Empty if
  /// the run does not have this axis.
  [[nodiscard]] std::optional<RunAxis> axis(const std::string& name) const;
  /// Returns the zones of the detector, in the order of their histograms; empty for a single-pixel
  /// detector.
  [[nodiscard]] std::vector<DetectorZone> zones() const;
  /// Returns the virtual antennas of the radar; empty if the run has no antenna samples.
  [[nodiscard]] std::vector<RadarAntenna> antennas() const;
  /// Returns the calibration of each calibrated sensor.
  [[nodiscard]] std::vector<SensorCalibration> calibrations() const;
  /// Returns the events of the run, in order.
  [[nodiscard]] std::vector<RunEvent> events() const;
  /// Returns the grid of the run's depth maps.
  [[nodiscard]] MapGrid grid() const;

  /// Returns the record with this index. Throws if the record does not exist or is damaged. Takes
  /// about as long as in for_each().
  [[nodiscard]] Record read(std::int64_t index) const;
  /// Calls `visit` for each record in order, starting at index `first`, until `visit` returns
  /// false. If a record is damaged, calls `on_damaged` and continues, or throws if `on_damaged` is
  /// empty.
  void for_each(const std::function<bool(const Record&)>& visit, std::int64_t first = 0,
                const OnDamaged& on_damaged = {}) const;

 private:
  friend struct Internals;
  struct File;
  explicit Run(std::shared_ptr<const File> file) : file_(std::move(file)) {}
  std::shared_ptr<const File> file_;
};

/// Calls `visit` for each record of a run that is being recorded, starting at index `first`, as
/// soon as the record has been written. Returns when the run is closed, or when `visit` or `go_on`
/// returns false. Calls `go_on` at least every 20 ms while it waits for a record. Opens the run
/// again for each poll, so that the recorder can close it; do not keep the Run after `visit`
/// returns. Handles damaged records in the same way as Run::for_each, and throws the same errors as
/// Run.
void follow(const std::string& path, const std::function<bool(const Run&, const Record&)>& visit,
            std::int64_t first = 0, const std::function<bool()>& go_on = {},
            const OnDamaged& on_damaged = {});

}  // namespace echofuse
