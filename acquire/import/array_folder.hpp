// SPDX-License-Identifier: MIT
// A folder of NumPy arrays with one row per record, described by its run.toml.
//   spd.npy     [n, bins] or [n, zones, bins] whole counts; a row of NaN: no SPD in that record
//   radar.npy   [n, points] linear power; a row of NaN: no radar
//   array.npy   [n, bins, values] antenna statistics, see ArrayBin (measurement/radar_array.hpp)
//   depth.npy   [n, rows, columns] z, whole millimetres or float metres; 0, NaN, 65535: no return
//   index.npy   [n], only with the key `run`: record number of each row; default: all records
//   valid.npy   [n], only with the key `run`: bits of the sensors that remain valid
//   run.toml    axes with units, slot length, labels: bind() in array_folder.cpp
// At least one of spd.npy and radar.npy is required, unless run.toml has the key `run`.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/intake/sample_check.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/util/npy.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {

struct ArraySettings {
  double window_s = 3, first_bin_ps = 0, bin_width_ps = 100, first_m = 0, step_m = 0.25,
         half_tangent = 0.55, far_m = record::MapGrid{}.far_m, irf_fwhm_ps = 0, radar_cell_m = 0;
  PerSensor<double> offset_m{};
  std::string run, label, notes, depth_unit, radar_taps;
  std::int64_t map_size = 0, array_frames = 1;
  std::vector<std::string> labels, antennas, zones;
  SignalLimits limits;
};
void bind(Settings& settings, ArraySettings& s);

// Threading: an ArrayFolder may be used by only one thread at a time.
class ArrayFolder {
 public:
  // Throws Error(failed) if an array is missing, damaged or too large, or if the arrays differ in
  // their number of rows. Throws Error(config) if run.toml does not match the arrays.
  ArrayFolder(const std::string& folder, const ArraySettings& settings);
  ArrayFolder(const ArrayFolder&) = delete;

  std::size_t rows() const { return rows_; }
  const std::string& newest() const { return newest_; }  // most recently modified array
  const record::Antennas& antennas() const { return antennas_; }
  std::vector<Axis> axes() const;
  // Throws Error(failed) if the arrays do not match `axes`.
  void require_shapes(const std::vector<Axis>& axes) const;
  // Returns the record number of the next row, which is read from index.npy if that file exists.
  std::int64_t next_index();
  // Copies the values of the next row into the record. Throws Error(failed) if a count is not a
  // whole number or a value is impossible.
  void take_row(record::FusedRecord& r);
  // Returns the warnings about the data. May be called only after the last row. Throws
  // Error(failed) if most depth maps are implausible.
  std::vector<std::string> doubts();

 private:
  // The array has `dimensions` dimensions, or up to `most` if that is more.
  std::unique_ptr<NpyFile> open(const char* name, std::size_t dimensions, std::size_t most = 0);
  Zones stated_zones() const;
  [[noreturn]] void refuse(const NpyFile& file, const std::string& what) const;
  [[noreturn]] void refuse_row(const NpyFile& file, const std::string& what) const;
  std::vector<double> read(NpyFile& file, double minimum, const char* what) const;
  std::uint64_t next_integer(NpyFile& file, double maximum) const;
  void put_counts(record::FusedRecord& r);
  void put_power(record::FusedRecord& r);
  void put_depth(record::FusedRecord& r);
  std::string take_depth(record::FusedRecord& r, const std::vector<double>& values) const;
  void mark(record::FusedRecord& r, Sensor sensor, std::uint64_t used, bool replaced) const;

  std::string folder_;
  ArraySettings settings_;
  record::Antennas antennas_;
  Zones zones_ = single_pixel();
  std::optional<std::string> first_;
  std::string newest_;
  std::size_t rows_ = 0, row_ = 0;
  std::unique_ptr<NpyFile> spd_, radar_, array_, depth_, index_, valid_;
  bool millimetres_ = true;
  std::size_t maps_ = 0, odd_maps_ = 0;
  std::string first_odd_;
  std::vector<std::string> reported_;
  SampleCheck samples_;
};

}  // namespace echofuse::acquire
