// SPDX-License-Identifier: MIT
#include "acquire/record/record_rows.hpp"

#include <algorithm>
#include <iterator>

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/png.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::record {
namespace {

std::string blob_place(const FusedRecord& r, Sensor s) {
  return "record " + std::to_string(r.index) + ": " + name_of(s);
}

void insert_incomplete(Inserts& rows, const FusedRecord& r) {
  if (r.missing.empty()) return;
  std::string names;
  for (const Sensor s : all_sensors)
    if (r.missing.contains(s)) names.append(names.empty() ? "" : " ").append(name_of(s));
  rows.into("incomplete").set("idx", r.index).set("missing", names).run();
}

void insert_clocks(Inserts& rows, const FusedRecord& r) {
  Insert& row = rows.into("clock_fit");
  bool any = false;
  for (const Sensor s : all_sensors) {
    const auto& clock = r.clocks[s];
    if (!clock) continue;
    any = true;
    const std::string name = name_of(s);
    row.set(name + "_offset_s", clock->offset_s)
        .set(name + "_drift_ppm", clock->drift_ppm)
        .set(name + "_residual_s", clock->residual_s)
        .set(name + "_samples", clock->samples);
  }
  if (any) row.set("idx", r.index).run();
}

void insert_slot(Inserts& rows, const FusedRecord& r) {
  const SlotStatistics& s = r.statistics;
  rows.into("slot")
      .set("idx", r.index)
      .set("radar_frames", s.radar_frames)
      .set("radar_last", s.radar_last)
      .set("depth_frames", s.depth_frames)
      .set("depth_last", s.depth_last)
      .set("closed_late_s", s.closed_late_s)
      .run();
}

void insert_signal(Inserts& rows, const FusedRecord& r) {
  const Signal& n = r.signal;
  if (n == Signal{}) return;
  rows.into("signal")
      .set("idx", r.index)
      .set("clicks_a_pulse", n.clicks_a_pulse)
      .set("spd_clicks", n.spd_clicks)
      .set("spd_peak_m", n.spd_peak_m)
      .set("radar_snr_db", n.radar_snr_db)
      .set("radar_peak_m", n.radar_peak_m)
      .set("depth_share", n.depth_share)
      .run();
}

void insert_spd_status(Inserts& rows, const FusedRecord& r) {
  const TagCounts& c = r.spd_counts;
  if (c.missed + c.overflows + c.errors + c.bad_tags + c.backwards + c.removed == 0) return;
  rows.into("spd_status")
      .set("idx", r.index)
      .set("missed", c.missed)
      .set("overflows", c.overflows)
      .set("errors", c.errors)
      .set("bad_tags", c.bad_tags)
      .set("backwards", c.backwards)
      .set("removed", c.removed)
      .run();
}

void insert_radar_status(Inserts& rows, const FusedRecord& r) {
  if (!r.radar_stats && !r.radar_temperature) return;
  Insert& row = rows.into("radar_status").set("idx", r.index);
  if (const auto& n = r.radar_stats)
    row.set("inter_frame_processing_us", n->inter_frame_processing_us)
        .set("transmit_us", n->transmit_us)
        .set("inter_frame_margin_us", n->inter_frame_margin_us)
        .set("inter_chirp_margin_us", n->inter_chirp_margin_us)
        .set("active_frame_load_percent", n->active_frame_load_percent)
        .set("inter_frame_load_percent", n->inter_frame_load_percent);
  if (const auto& t = r.radar_temperature; t && t->invalid == 0) {
    constexpr const char* columns[] = {"rx0_c", "rx1_c", "rx2_c", "rx3_c",  "tx0_c",
                                       "tx1_c", "tx2_c", "pm_c",  "dig0_c", "dig1_c"};
    row.set("temperature_ms", t->time_ms);
    for (std::size_t i = 0; i < std::size(columns); ++i) row.set(columns[i], t->celsius[i]);
  }
  row.run();
}

void insert_array(Inserts& rows, const std::string& path, const FusedRecord& r,
                  const std::vector<Axis>& axes) {
  if (r.array.empty() || !r.has(Sensor::radar)) return;
  const auto axis =
      std::find_if(axes.begin(), axes.end(), [](const Axis& a) { return a.name == "array"; });
  const auto antennas = axis == axes.end() ? 0 : antennas_of(*axis);
  const std::size_t wanted = antennas > 0 ? axis->count * values_of_bin(antennas) : 0;
  if (r.array.size() != wanted)
    throw Error(ExitCode::failed, path + ": record " + std::to_string(r.index) + ": array has " +
                                      std::to_string(r.array.size()) + " values, its axis " +
                                      std::to_string(wanted));
  const Bytes packed = pack_array(r.array, antennas);
  rows.into("radar_array")
      .set("idx", r.index)
      .set("frames", r.array_frames)
      .set("array", ByteView{packed})
      .run();
}

void insert_speckle(Inserts& rows, const FusedRecord& r) {
  if (!r.speckle || !r.has(Sensor::radar)) return;
  rows.into("speckle")
      .set("idx", r.index)
      .set("over_frames", r.speckle->over_frames)
      .set("over_carriers", r.speckle->over_carriers)
      .set("over_150_ms", r.speckle->over_150_ms)
      .run();
}

}  // namespace

void insert_record(Inserts& rows, const std::string& path, const FusedRecord& r,
                   const std::vector<Axis>& axes) {
  const auto expect = [&](Sensor s, std::size_t got, std::size_t wanted) {
    if (r.has(s) && got != wanted)
      throw Error(ExitCode::failed, path + ": " + blob_place(r, s) + " has " + std::to_string(got) +
                                        " values, its axis " + std::to_string(wanted));
  };
  const auto count_of = [&](const char* name) -> std::uint32_t {
    for (const auto& a : axes)
      if (a.name == name) return a.count;
    return 0;
  };
  const std::uint32_t width = count_of("depth_x"), height = count_of("depth_y");
  expect(Sensor::spd, r.spd.size(), count_of("spd"));
  expect(Sensor::radar, r.radar.size(), count_of("radar"));
  expect(Sensor::depth, r.depth_mm.size(), std::size_t{width} * height);
  const Bytes png = r.has(Sensor::depth) ? encode_png16(r.depth_mm, width, height) : Bytes{};
  if (r.has(Sensor::depth) && png.empty()) {  // what one camera sends never ends a run
    FusedRecord without = r;
    without.valid.erase(Sensor::depth);
    without.sync[Sensor::depth].verdict = "cannot be encoded as PNG";
    return insert_record(rows, path, without, axes);
  }

  Insert& row = rows.into("record");
  row.set("idx", r.index)
      .set("slot_start_ns", std::int64_t{r.slot_start.count()})
      .set("slot_end_ns", std::int64_t{r.slot_end.count()})
      .set("slot_utc_ns", std::int64_t{r.slot_utc.count()})
      .set("valid", std::int64_t{r.valid.bits()})
      .set("label", r.label);
  const TagCounts& c = r.spd_counts;
  row.set("tags", c.tags)
      .set("starts", c.starts)
      .set("in_range", c.in_range)
      .set("out_of_range", c.out_of_range)
      .set("without_start", c.without_start)
      .set("other", c.other)
      .set("tags_lost", r.sync[Sensor::spd].lost);
  for (const Sensor s : all_sensors) {
    const SensorSync& sync = r.sync[s];
    const std::string name = name_of(s);
    row.set(name + "_offset_s", sync.offset_s)
        .set(name + "_span_s", sync.span_s)
        .set(name + "_used", sync.used)
        .set(name + "_lost", sync.lost)
        .set(name + "_verdict", sync.verdict);
  }
  if (r.has(Sensor::spd)) row.set("spd", as_bytes(r.spd));
  if (r.has(Sensor::radar)) row.set("radar", as_bytes(r.radar));
  if (r.has(Sensor::depth)) row.set("depth", ByteView{png});
  row.run();
  insert_radar_status(rows, r);
  insert_spd_status(rows, r);
  insert_incomplete(rows, r);
  insert_clocks(rows, r);
  insert_slot(rows, r);
  insert_signal(rows, r);
  insert_array(rows, path, r, axes);
  insert_speckle(rows, r);
}

}  // namespace echofuse::record
