// SPDX-License-Identifier: MIT
/// @file
/// Record of a run: data of the detector (SPD), the radar and the depth camera from one slot.
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "echofuse/error.hpp"

/// Reads runs recorded by echofuse, and predicts a depth map for each record.
namespace echofuse {

/// Evenly spaced coordinates along one dimension of a data table.
struct RunAxis {
  std::string name;      ///< `spd`, `radar`, `array`, `depth_x` or `depth_y`
  std::string quantity;  ///< quantity of the values: e.g. `counts`, `power` or `tangent`
  std::string unit;  ///< unit of the coordinates: `ps` (two-way time), `m` (range) or `1` (tangent)
  std::uint32_t count = 0;  ///< number of values; 0 if the run does not have this axis
  double start = 0;         ///< coordinate of value 0, in `unit`
  double step = 0;          ///< spacing between adjacent values, in `unit`

  /// Returns the coordinate of value `i`, in `unit`. Bin i of the histogram extends from at(i)
  /// to at(i + 1).
  [[nodiscard]] double at(double i) const { return start + i * step; }
};

/// Grid of depth maps with `size` x `size` pixels, row-major from the top left.
struct MapGrid {
  std::uint32_t size = 0;   ///< number of pixels per side
  double half_tangent = 0;  ///< |x/z| and |y/z| at the outer edges of the grid
  double far_m = 0;         ///< maximum depth, m

  /// Returns the number of pixels.
  [[nodiscard]] std::size_t pixels() const { return std::size_t{size} * size; }
  /// Returns the tangent x/z at the centre of a column; x points to the right.
  [[nodiscard]] double x(std::size_t column) const {
    return (2.0 * double(column) + 1 - size) / size * half_tangent;
  }
  /// Returns the tangent y/z at the centre of a row; y points up.
  [[nodiscard]] double y(std::size_t row) const { return -x(row); }
};

/// Zone of a detector: a part of its field of view with its own histogram. A value is NaN if it is
/// unknown.
struct DetectorZone {
  double x = 0;        ///< tangent of the zone's centre, positive to the right
  double y = 0;        ///< tangent of the zone's centre, positive upwards
  double width = 0;    ///< tangent of the full width of the zone
  double zero_ps = 0;  ///< two-way time that corresponds to range 0, ps
};

/// Virtual antenna of the radar.
struct RadarAntenna {
  double x = 0;          ///< position to the right, half wavelengths
  double y = 0;          ///< position upwards, half wavelengths
  double gain = 1;       ///< gain error of the samples
  double phase_rad = 0;  ///< phase error of the samples, rad
};

/// Range calibration of one sensor.
struct SensorCalibration {
  std::string sensor;           ///< `spd`, `radar` or `depth`
  std::string date_utc;         ///< date of the calibration, ISO 8601
  std::string method;           ///< method of the calibration
  double distance_m = 0;        ///< distance of the reflector, m
  double offset_m = 0;          ///< range bias, m; true range = measured range - bias
  double standard_error_m = 0;  ///< standard error of the bias, m
};

/// Event of a run: a note, a warning or a change.
struct RunEvent {
  std::string utc;     ///< time of the event, ISO 8601
  std::string level;   ///< e.g. `info`, `warning`, `error`, `note` or `label`
  std::string source;  ///< sensor, program or user that reported the event
  std::string text;    ///< text of the event
};

/// Verdict on the data of one sensor in one record; `echofuse-acquire verdicts` explains each.
enum class VerdictCode : std::uint8_t {
  ok,              ///< `ok`
  not_assessed,    ///< `not assessed`
  no_peak,         ///< `no peak`
  lossy,           ///< `lossy`
  weak,            ///< `weak`
  saturated,       ///< `saturated`
  stands_still,    ///< `stands still`
  not_configured,  ///< `not configured`
  missing,         ///< `missing`
  no_tags,         ///< `no tags`
  no_starts,       ///< `no start tags`
  no_histograms,   ///< `no histograms`
  no_frames,       ///< `no frames`
  no_profile,      ///< `no range profile`
  covers_part,     ///< `covers only part`
  in_overflow,     ///< `in overflow`
  other_axis,      ///< `other axis`
  odd,             ///< `odd`
  stood_still,     ///< `the program stood still`
  not_stored,      ///< `not stored`
  other,           ///< verdict of a later version
};

/// State of one sensor during one record.
struct SensorQuality {
  bool valid = false;  ///< true if the record contains data of this sensor
  VerdictCode verdict_code = VerdictCode::other;  ///< kind of the verdict
  std::string verdict;     ///< word of the verdict: `ok`, or why the data are missing or doubtful
  std::string figures;     ///< measured values and limits of the verdict; may be empty
  std::uint64_t used = 0;  ///< number of detector clicks or sensor frames in the record
  std::uint64_t lost = 0;  ///< number of tags, histograms or frames known to be lost
};

/// One record of a run. Copies share the data, which remain valid until the last copy is destroyed,
/// also without the Run. Threading: any number of threads may read the same record at once.
class Record {
 public:
  /// Returns the index of the record in its run.
  [[nodiscard]] std::int64_t index() const;
  /// Returns the start of the record's slot, UTC.
  [[nodiscard]] std::chrono::sys_time<std::chrono::nanoseconds> time() const;
  /// Returns the duration of the record's slot.
  [[nodiscard]] std::chrono::nanoseconds length() const;
  /// Returns the label that the operator gave to this record; may be empty.
  [[nodiscard]] const std::string& label() const;

  /// Returns the state of the single-photon detector.
  [[nodiscard]] SensorQuality spd_quality() const;
  /// Returns the state of the radar.
  [[nodiscard]] SensorQuality radar_quality() const;
  /// Returns the state of the depth camera.
  [[nodiscard]] SensorQuality depth_quality() const;

  /// Returns the number of detections in each bin of axis `spd`. For a detector with zones, the
  /// bins of the first zone are followed by those of the second zone, and so on. The numbers are
  /// not corrected for background or pile-up. Empty if the detector data are missing.
  [[nodiscard]] std::span<const std::uint32_t> spd() const;
  /// Returns the linear power at each point of axis `radar`, in arbitrary units. Empty if the radar
  /// data are missing.
  [[nodiscard]] std::span<const float> radar() const;
  /// Returns statistics of the samples x of the A antennas at each point of axis `array`: A means,
  /// A mean powers, A (A - 1) / 2 covariances E[x_m conj(x_n)] with m < n, and the correlation of
  /// consecutive frames. A mean, a covariance and the correlation have a real and an imaginary
  /// part, so a point has A (A + 2) + 2 values. Empty if there are no antenna samples.
  [[nodiscard]] std::span<const float> array() const;
  /// Returns the depth z measured by the camera at each pixel of Run::grid(), in metres, in
  /// row-major order; 0: no return. Empty if the camera data are missing.
  [[nodiscard]] std::span<const float> map() const;

 private:
  friend struct Internals;
  struct Contents;
  explicit Record(std::shared_ptr<const Contents> contents) : contents_(std::move(contents)) {}
  std::shared_ptr<const Contents> contents_;
};

}  // namespace echofuse
