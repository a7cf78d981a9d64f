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

/// Reads runs recorded by echofuse, and predicts a depth map for each record.
namespace echofuse {

/// Evenly spaced coordinates along one dimension of a data table.
struct RunAxis {
  std::string name;      ///< `spd`, `radar`, `depth_x` or `depth_y`
  std::string quantity;  ///< quantity of the values: `counts`, `power` or `tangent`
  std::string unit;  ///< unit of the coordinates: `ps` (two-way time), `m` (range) or `1` (tangent)
  std::uint32_t count = 0;  ///< number of values; 0 if the run does not have this axis
  double start = 0;         ///< coordinate of value 0, in `unit`
  double step = 0;          ///< spacing between adjacent values, in `unit`

  /// Returns the coordinate of value `i`, in `unit`. Bin i of the histogram extends from at(i)
  /// to at(i + 1).
  double at(double i) const { return start + i * step; }
};

/// Grid of depth maps with `size` x `size` pixels, row-major from the top left.
struct MapGrid {
  std::uint32_t size = 0;   ///< number of pixels per side
  double half_tangent = 0;  ///< |x/z| and |y/z| at the outer edges of the grid
  double far_m = 0;         ///< maximum depth, m

  /// Returns the number of pixels.
  std::size_t pixels() const { return std::size_t{size} * size; }
  /// Returns the tangent x/z at the centre of a column; x points to the right.
  double x(std::size_t column) const {
    return (2.0 * double(column) + 1 - size) / size * half_tangent;
  }
  /// Returns the tangent y/z at the centre of a row; y points up.
  double y(std::size_t row) const { return -x(row); }
};

/// State of one sensor during one record.
struct SensorReport {
  bool valid = false;      ///< true if the record contains data of this sensor
  std::string verdict;     ///< `ok`, or why the data are missing or doubtful
  std::uint64_t used = 0;  ///< number of detector clicks or sensor frames in the record
  std::uint64_t lost = 0;  ///< number of tags or frames known to be lost
};

/// One record of a run. Copies share the data. Threading: any number of threads may read the same
/// record at once.
class Record {
 public:
  /// Returns the index of the record in its run.
  std::int64_t index() const;
  /// Returns the start of the record's slot, in ns since 1970-01-01T00:00:00Z.
  std::chrono::nanoseconds start_utc() const;
  /// Returns the duration of the record's slot.
  std::chrono::nanoseconds length() const;
  /// Returns the label that the operator gave to this record; may be empty.
  const std::string& label() const;

  /// Returns the state of the single-photon detector.
  SensorReport spd() const;
  /// Returns the state of the radar.
  SensorReport radar() const;
  /// Returns the state of the depth camera.
  SensorReport camera() const;

  /// Returns the number of detections in each bin, as [Run::zones()][bins of axis `spd`]. The
  /// numbers are not corrected for background or pile-up. Empty if the detector data are missing.
  std::span<const std::uint32_t> counts() const;
  /// Returns the linear power at each point of axis `radar`, in arbitrary units. Empty if the radar
  /// data are missing.
  std::span<const float> power() const;
  /// Returns the depth z measured by the camera at each pixel of Run::grid(), in metres, in
  /// row-major order; 0: no return. Empty if the camera data are missing.
  std::span<const float> depth_m() const;

 private:
  friend struct Internals;
  struct Contents;
  explicit Record(std::shared_ptr<const Contents> contents) : contents_(std::move(contents)) {}
  std::shared_ptr<const Contents> contents_;
};

}  // namespace echofuse
