// SPDX-License-Identifier: MIT
#include "acquire/record/columns.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/deflate.hpp"

namespace echofuse::record {
namespace {

template <class T>
constexpr bool is_depth = std::is_same_v<T, std::uint16_t>;

// Returns no bytes if an image cannot be compressed.
template <class T>
Bytes packed(const std::vector<T>& values, const Shape& shape) {
  const ByteView bytes = as_bytes(values);
  if constexpr (is_depth<T>)
    return values.empty() || values.size() > max_depth_pixels ? Bytes{}
                                                              : deflated(bytes, depth_level);
  if constexpr (std::is_same_v<T, float>)
    if (shape.axis.name == "array") return pack_array(values, antennas_of(shape.axis));
  return {bytes.begin(), bytes.end()};
}

// Returns an error message without the name of the column.
template <class T>
std::string unpacked(const Bytes& bytes, const Shape& shape, std::vector<T>& values) {
  if constexpr (is_depth<T>) {
    if (shape.values <= max_depth_pixels) values = inflated<T>(bytes, shape.values);
    return values.empty() ? "is not a deflated image of " + shape.text : "";
  }
  if constexpr (std::is_same_v<T, float>)
    if (shape.axis.name == "array")
      return unpack_array(bytes, shape.axis.count, antennas_of(shape.axis), values);
  if (const std::size_t size = sizeof(T) * shape.values; bytes.size() != size)
    return "has " + std::to_string(bytes.size()) + " bytes, but its axis requires " +
           std::to_string(size);
  values = to_values<T>(bytes);
  const auto bad = std::ranges::find_if_not(
      values, [](T v) { return std::is_integral_v<T> || std::isfinite(v); });
  if (bad == values.end()) return {};
  return "bin " + std::to_string(bad - values.begin()) + " is not a finite number";
}

}  // namespace

Shapes shapes_of(const std::vector<Axis>& axes) {
  Shapes out;
  for_each_column([&]<class T>(const Column<T>& column, std::size_t i) {
    Shape& shape = out[i];
    shape.values = 1;
    for (const char* name : column.axes) {
      if (!name) continue;
      const Axis* const found = find_axis(axes, name);
      shape.axis = found ? *found : Axis{};
      shape.values *= shape.axis.values();
      shape.text += (shape.text.empty() ? "" : " x ") + std::to_string(shape.axis.count);
    }
    const bool array = shape.axis.name == "array";
    shape.bytes = array ? array_bytes(shape.axis) : static_cast<double>(sizeof(T) * shape.values);
    if (array) shape.values *= values_of_bin(antennas_of(shape.axis));
  });
  return out;
}

double record_bytes(const std::vector<Axis>& axes, const FusedRecord& example) {
  const Shapes shapes = shapes_of(axes);
  Blobs blobs;
  SensorSet lost;
  static_cast<void>(pack(example, shapes, blobs, lost));
  double out = 0;
  for (std::size_t i = 0; i < blobs.size(); ++i)
    out += blobs[i].empty() ? shapes[i].bytes : static_cast<double>(blobs[i].size());
  return out;
}

std::string pack(const FusedRecord& record, const Shapes& shapes, Blobs& blobs, SensorSet& lost) {
  std::string fault;
  for_each_column([&]<class T>(const Column<T>& column, std::size_t i) {
    const std::vector<T>& values = record.*column.values;
    if (!record.has(column.sensor) || (column.optional && values.empty())) return;
    if (values.size() != shapes[i].values)
      fault = column.name + (" has " + std::to_string(values.size())) +
              " values, but its axis has " + std::to_string(shapes[i].values);
    blobs[i] = packed(values, shapes[i]);
    if (is_depth<T> && blobs[i].empty()) lost.insert(column.sensor);
  });
  return fault;
}

std::string unpack(const Blobs& blobs, const Shapes& shapes, FusedRecord& record) {
  std::string fault;
  for_each_column([&](const auto& column, std::size_t i) {
    const bool absent = column.optional && (blobs[i].empty() || shapes[i].values == 0);
    if (!fault.empty() || !record.has(column.sensor) || absent) return;
    fault = unpacked(blobs[i], shapes[i], record.*column.values);
    if (!fault.empty()) fault = column.name + (" " + fault);
  });
  return fault;
}

void give_up(FusedRecord& record, SensorSet sensors, const std::string& why) {
  for (const Sensor s : all_sensors)
    if (sensors.contains(s) && record.has(s))
      record.sync[s].verdict = {VerdictKind::not_stored, why};
  record.valid = record.valid - sensors;
  for_each_column([&](const auto& column, std::size_t) {
    if (sensors.contains(column.sensor)) (record.*column.values) = {};
  });
  if (record.array.empty()) record.array_frames = 0;
}

}  // namespace echofuse::record
