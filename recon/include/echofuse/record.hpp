// SPDX-License-Identifier: MIT
/// @file
/// Record of a run: what the detector (SPD), the radar and the depth camera measured in one slot.
#pragma once
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

/// Reads runs of echofuse and predicts depth maps of their records.
namespace echofuse {

/// Positions of values along one side of a table.
struct RunAxis {
  std::string name;         ///< `spd`, `radar`, `depth_x` or `depth_y`
  std::string quantity;     ///< kind of the values: `counts`, `power`, `tangent`
  std::string unit;         ///< unit of the positions: `ps` (two-way time), `m` (range) or `1`
  std::uint32_t count = 0;  ///< number of values; 0: the run lacks this axis
  double start = 0;         ///< position of value 0, in `unit`
  double step = 0;          ///< distance of two values, in `unit`

  /// Returns the position of value `i`. A bin of the histogram covers [at(i), at(i + 1)).
  double at(double i) const { return start + i * step; }
};

/// Grid of depth maps: `size` x `size` pixels, row after row from the top left.
struct MapGrid {
  std::uint32_t size = 0;   ///< pixels of a side
  double half_tangent = 0;  ///< x/z and y/z of the outer edges
  double far_m = 0;         ///< greatest depth, m

  /// Returns the number of pixels.
  std::size_t pixels() const { return std::size_t{size} * size; }
  /// Returns the tangent x/z of a column's centre; x points to the right.
  double x(std::size_t column) const {
    return (2.0 * double(column) + 1 - size) / size * half_tangent;
  }
  /// Returns the tangent y/z of a row's centre; y points up.
  double y(std::size_t row) const { return -x(row); }
};

/// State of one sensor in a record.
struct SensorReport {
  bool valid = false;      ///< true: the record has values of the sensor
  std::string verdict;     ///< `ok`, or why the values are missing or doubtful
  std::uint64_t used = 0;  ///< clicks of the detector, or frames
  std::uint64_t lost = 0;  ///< tags or frames known to be missing
};

/// One record. Copies share the values. Threading: any number of threads may read one record.
class Record {
 public:
  /// Returns the record's number in its run.
  std::int64_t index() const;
  /// Returns the start of the slot, in ns since 1970-01-01T00:00:00Z.
  std::chrono::nanoseconds start_utc() const;
  /// Returns the length of the slot.
  std::chrono::nanoseconds length() const;
  /// Returns the operator's label; may be empty.
  const std::string& label() const;

  /// Returns the state of the single-photon detector.
  SensorReport spd() const;
  /// Returns the state of the radar.
  SensorReport radar() const;
  /// Returns the state of the depth camera.
  SensorReport camera() const;

  /// Returns detections as [Run::zones()][bins of the axis `spd`], as recorded: with background and
  /// pile-up. Empty if the detector is missing.
  std::span<const std::uint32_t> counts() const;
  /// Returns the linear power (arbitrary scale) at each point of the axis `radar`. Empty if the
  /// radar is missing.
  std::span<const float> power() const;
  /// Returns the camera's depth z in m on Run::grid(), row-major; 0: no return. Empty if the camera
  /// is missing.
  std::span<const float> depth_m() const;

 private:
  friend struct Internals;
  struct Contents;
  explicit Record(std::shared_ptr<const Contents> contents) : contents_(std::move(contents)) {}
  std::shared_ptr<const Contents> contents_;
};

}  // namespace echofuse
