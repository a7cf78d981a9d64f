// SPDX-License-Identifier: MIT
// A folder of NumPy arrays, a row for each record, and what its run.toml says of them.
//   spd.npy     [n, bins] or [n, zones, bins] whole counts; a row of NaN: no SPD in that record
//   radar.npy   [n, points] linear power; a row of NaN: no radar
//   array.npy   [n, bins, values] of the antennas, as ArrayBin (measurement/radar_array.hpp)
//   depth.npy   [n, rows, columns] z, whole millimetres or float metres; 0, NaN, 65535: no return
//   index.npy   [n], with `run`: the records of that run that these rows are; without it all
//   valid.npy   [n], with `run`: bits of the sensors that stay
//   run.toml    axes with units, slot length, labels: bind() in array_folder.cpp
// One of the first two is enough.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/record.hpp"
#include "drivers/core/zone.hpp"
#include "drivers/util/npy.hpp"
#include "drivers/util/settings.hpp"

namespace echofuse::acquire {

struct ArraySettings {
  double window_s = 3, first_bin_ps = 0, bin_width_ps = 100, first_m = 0, step_m = 0.25,
         half_tangent = 0.55, far_m = record::MapGrid{}.far_m, irf_fwhm_ps = 0, radar_cell_m = 0;
  PerSensor<double> offset_m{};
  std::string run, label, notes, depth_unit, radar_taps;
  std::int64_t map_size = 0;
  std::vector<std::string> labels, antennas, zones;
  SignalLimits limits;
};
void bind(Settings& settings, ArraySettings& s);

// Threading: one thread at a time.
class ArrayFolder {
 public:
  // Throws Error(failed): an array is missing, damaged, too large or has other rows than the first
  // one; Error(config): run.toml does not fit the arrays.
  ArrayFolder(const std::string& folder, const ArraySettings& settings);

  std::size_t rows() const { return rows_; }
  const std::string& newest() const { return newest_; }  // the array that was changed last
  const record::Antennas& antennas() const { return antennas_; }
  const Zones& zones() const { return zones_; }
  std::vector<Axis> axes() const;
  // Throws Error(failed) if values of a record are not those of these axes and zones.
  void require_shapes(const std::vector<Axis>& axes, const Zones& zones) const;
  // The record that the next row is, by index.npy.
  std::int64_t next_index();
  // Puts the next row's values into the record. Throws Error(failed): counts that are not whole, or
  // numbers that are no measurement.
  void take_row(record::FusedRecord& r);
  // After the last row: what is doubtful. Throws Error(failed) if most depth maps are odd.
  std::vector<std::string> doubts() const;

 private:
  std::unique_ptr<NpyFile> open(const char* name, std::size_t dimensions);
  Zones stated_zones() const;
  [[noreturn]] void refuse(const NpyFile& file, const std::string& what) const;
  std::vector<double> read(NpyFile& file, double least, const char* what) const;
  void put_counts(record::FusedRecord& r);
  void put_power(record::FusedRecord& r);
  void put_depth(record::FusedRecord& r);
  std::string take_depth(record::FusedRecord& r, const std::vector<double>& values) const;
  void mark(record::FusedRecord& r, Sensor sensor, std::uint64_t used) const;

  std::string folder_;
  ArraySettings settings_;
  record::Antennas antennas_;
  Zones zones_;
  std::optional<std::string> first_;  // path of the first array
  std::string newest_;
  std::size_t rows_ = 0, row_ = 0;
  std::unique_ptr<NpyFile> spd_, radar_, array_, depth_, index_, valid_;
  bool millimetres_ = true;
  std::size_t powers_ = 0, like_db_ = 0, maps_ = 0, odd_maps_ = 0;
  std::string first_odd_;
};

}  // namespace echofuse::acquire
