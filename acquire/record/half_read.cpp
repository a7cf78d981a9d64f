// SPDX-License-Identifier: MIT
#include "acquire/record/half_read.hpp"

#include <algorithm>
#include <cmath>

#include "acquire/record/png.hpp"
#include "acquire/record/read_rows.hpp"
#include "acquire/record/run_file.hpp"

namespace echofuse::record {
namespace {

constexpr const char* record_columns =
    "SELECT idx, slot_start_ns, slot_end_ns, slot_utc_ns, valid, label, spd, radar, depth, tags, "
    "starts, in_range, out_of_range, without_start, other, spd_offset_s, spd_span_s, "
    "spd_used, spd_lost, spd_verdict, radar_offset_s, radar_span_s, radar_used, radar_lost, "
    "radar_verdict, depth_offset_s, depth_span_s, depth_used, depth_lost, depth_verdict, ";
// Older files are without the table; an unknown share of the laser's pulses is -1 here.
constexpr const char* signal_column =
    "ifnull((SELECT clicks_a_pulse FROM signal WHERE signal.idx = record.idx), -1)";
constexpr const char* array_columns =
    ", (SELECT frames FROM radar_array a WHERE a.idx = record.idx), (SELECT array FROM radar_array "
    "a "
    "WHERE a.idx = record.idx)";
// What is not known is below 0 here.
constexpr const char* speckle_columns =
    ", ifnull((SELECT over_frames FROM speckle s WHERE s.idx = record.idx), -1), "
    "ifnull((SELECT over_carriers FROM speckle s WHERE s.idx = record.idx), -1)";
constexpr const char* lag_column =
    ", ifnull((SELECT over_150_ms FROM speckle s WHERE s.idx = record.idx), -1)";
constexpr const char* record_rows = " FROM record WHERE idx >= ? ORDER BY idx";

// Fills `r` from the row, but for the depth picture; returns what is wrong with it, or nothing.
std::string decode(Statement& row, const Shapes& shapes, std::uint32_t sensors, FusedRecord& r,
                   Bytes& png) {
  r.index = row.integer();
  std::string fault = read_slot(row, r.slot_start, r.slot_end, r.slot_utc);
  if (!fault.empty()) return fault;
  r.valid = SensorSet::from_bits(static_cast<std::uint32_t>(row.integer()) & sensors);
  r.label = row.text();
  const ByteView spd = row.blob(), radar = row.blob(), depth = row.blob();
  TagCounts& c = r.spd_counts;
  for (std::uint64_t* v :
       {&c.tags, &c.starts, &c.in_range, &c.out_of_range, &c.without_start, &c.other})
    *v = static_cast<std::uint64_t>(row.integer());
  read_sync(row, r.sync);
  if (const double clicks = row.real(); clicks >= 0) r.signal.clicks_a_pulse = clicks;
  const std::int64_t frames = row.integer();
  const ByteView array = row.blob();
  const double over_frames = row.real(), over_carriers = row.real(), over_150_ms = row.real();
  const auto known = [](double variation) { return variation >= 0 && variation < 1e9; };
  if (known(over_frames)) r.speckle.emplace().over_frames = over_frames;
  if (r.speckle && known(over_carriers)) r.speckle->over_carriers = over_carriers;
  if (r.speckle && known(over_150_ms)) r.speckle->over_150_ms = over_150_ms;
  const auto sizes = [](const char* what, std::size_t got, std::size_t wanted) {
    return std::string(what) + " has " + std::to_string(got) + " bytes, its axis asks for " +
           std::to_string(wanted);
  };
  if (r.has(Sensor::spd) && spd.size() != shapes.spd * 4)
    return sizes("spd", spd.size(), shapes.spd * 4);
  if (r.has(Sensor::radar) && radar.size() != shapes.radar * 4)
    return sizes("radar", radar.size(), shapes.radar * 4);
  if (r.has(Sensor::spd)) r.spd = to_values<std::uint32_t>(spd);
  if (r.has(Sensor::radar)) r.radar = to_values<float>(radar);
  const auto bad = std::ranges::find_if_not(r.radar, [](float v) { return std::isfinite(v); });
  if (r.has(Sensor::radar) && bad != r.radar.end())
    return "radar bin " + std::to_string(bad - r.radar.begin()) + " is not a finite number";
  if (r.has(Sensor::depth)) png.assign(depth.begin(), depth.end());
  if (frames < 0) return "array is of " + std::to_string(frames) + " frames";
  r.array_frames = static_cast<std::uint64_t>(frames);
  if (frames == 0 || shapes.array == 0 || !r.has(Sensor::radar)) return {};
  return unpack_array(array, shapes.array, shapes.antennas, r.array);
}

}  // namespace

Shapes::Shapes(const std::vector<Axis>& axes) {
  for (const auto& a : axes) {
    if (a.name == "spd") spd = a.count;
    if (a.name == "radar") radar = a.count;
    if (a.name == "depth_x") width = a.count;
    if (a.name == "depth_y") height = a.count;
    if (a.name == "array") array = a.count, antennas = antennas_of(a);
  }
}

std::size_t Shapes::records_at_once() const {
  constexpr std::uint64_t most = 64, most_pixels = std::uint64_t{1} << 24;
  const std::uint64_t pixels = std::max<std::uint64_t>(std::uint64_t{width} * height, 1);
  return static_cast<std::size_t>(std::clamp<std::uint64_t>(most_pixels / pixels, 1, most));
}

std::string record_query(const Extras& has) {
  return record_columns + std::string(has.signal ? signal_column : "-1") +
         (has.array ? array_columns : ", 0, NULL") + (has.speckle ? speckle_columns : ", -1, -1") +
         (has.lag ? lag_column : ", -1") + record_rows;
}

void HalfRead::read(Statement& row, const Shapes& shapes, SensorSet sensors) {
  fault = decode(row, shapes, sensors.bits(), record, png);
}

void HalfRead::decode_depth(const Shapes& shapes) {
  if (!fault.empty() || !record.has(Sensor::depth)) return;
  record.depth_mm = decode_png16(png, shapes.width, shapes.height);
  if (record.depth_mm.empty())
    fault = "depth is not a 16-bit grey PNG of " + std::to_string(shapes.width) + " x " +
            std::to_string(shapes.height);
}

}  // namespace echofuse::record
