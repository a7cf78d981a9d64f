// SPDX-License-Identifier: MIT
// Columns of a record that contain the values of a sensor. Code that stores, reads, measures or
// drops the values loops over this table. A new column is one row here, and the code that fills it.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include "acquire/record/fused_record.hpp"
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

template <class T>
struct Column {
  const char* name;  // in the table `record`
  Sensor sensor;
  std::vector<T> FusedRecord::*values;
  std::array<const char*, 2> axes{};
  bool optional = false;  // true if the sensor may be valid without these values
};

// Counts are stored as u32 LE and power as f32 LE, antenna statistics by pack_array(), and depth as
// deflated u16 LE.
inline constexpr std::tuple data_columns{
    Column<std::uint32_t>{"spd", Sensor::spd, &FusedRecord::spd, {"spd"}},
    Column<float>{"radar", Sensor::radar, &FusedRecord::radar, {"radar"}},
    Column<float>{"array", Sensor::radar, &FusedRecord::array, {"array"}, true},
    Column<std::uint16_t>{"depth", Sensor::depth, &FusedRecord::depth_mm, {"depth_x", "depth_y"}}};

template <class T>
using PerColumn = std::array<T, std::tuple_size_v<decltype(data_columns)>>;
using Blobs = PerColumn<Bytes>;  // stored values

// Calls visit(column, i) for each column, in order. `i` is the index in a PerColumn.
template <class Visit>
void for_each_column(const Visit& visit) {
  std::size_t i = 0;
  std::apply([&](const auto&... column) { (visit(column, i++), ...); }, data_columns);
}

// Size of a column in the records of a run.
struct Shape {
  std::size_t values = 0;  // number of values; 0 if the run lacks an axis
  Axis axis;
  double bytes = 0;  // size of the stored values; an upper bound if they are compressed
  std::string text;  // number of points on each axis, e.g. "64 x 64"
};
using Shapes = PerColumn<Shape>;
Shapes shapes_of(const std::vector<Axis>& axes);
// Returns the size in bytes of all columns in one record: the size of the packed values of
// `example`, or an upper bound for those that it lacks.
double record_bytes(const std::vector<Axis>& axes, const FusedRecord& example = {});

// Packs the values of the valid sensors. Returns an error message if a number of values does not
// match its axis. Adds each sensor with values that cannot be compressed to `lost`.
std::string pack(const FusedRecord& record, const Shapes& shapes, Blobs& blobs, SensorSet& lost);
// Unpacks the values of the valid sensors. Returns an error message; empty if the blobs are valid.
std::string unpack(const Blobs& blobs, const Shapes& shapes, FusedRecord& record);
// Removes the values of the sensors from a record. Their verdict becomes "not stored".
void give_up(FusedRecord& record, SensorSet sensors, const std::string& why);

}  // namespace echofuse::record
