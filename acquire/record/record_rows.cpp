// SPDX-License-Identifier: MIT
#include "acquire/record/record_rows.hpp"

#include <algorithm>

#include "acquire/record/png.hpp"
#include "drivers/core/exit_code.hpp"

namespace echofuse::record {
namespace {

std::string blob_place(const FusedRecord& r, Sensor s) {
  return "record " + std::to_string(r.index) + ": " + name_of(s);
}

}  // namespace

RecordRows::RecordRows(sqlite3* db, const std::string& path)
    : db_(db),
      path_(path),
      record_(db, path,
              "INSERT INTO record VALUES (?,?,?,?,?,?,?,?,?, ?,?,?,?,?,?,?, ?,?,?,?,?, ?,?,?,?,?, "
              "?,?,?,?,?)") {}

void RecordRows::insert(const FusedRecord& r, const std::vector<Axis>& axes) {
  const auto expect = [&](Sensor s, std::size_t got, std::size_t wanted) {
    if (r.has(s) && got != wanted)
      throw Error(ExitCode::failed, path_ + ": " + blob_place(r, s) + " has " +
                                        std::to_string(got) + " values, its axis " +
                                        std::to_string(wanted));
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
    return insert(without, axes);
  }

  Statement& s = record_;
  s.reset();
  s.bind(r.index)
      .bind(std::int64_t{r.slot_start.count()})
      .bind(std::int64_t{r.slot_end.count()})
      .bind(std::int64_t{r.slot_utc.count()})
      .bind(std::int64_t{r.valid.bits()})
      .bind(r.label);
  const SpdCounts& c = r.spd_counts;
  for (const std::uint64_t v :
       {c.tags, c.starts, c.in_range, c.out_of_range, c.without_start, c.other, c.lost})
    s.bind(v);
  for (const SensorSync& y : r.sync)
    s.bind(y.offset_s).bind(y.span_s).bind(y.used).bind(y.lost).bind(y.verdict);
  s.bind(r.has(Sensor::spd) ? as_bytes(r.spd) : ByteView{})
      .bind(r.has(Sensor::radar) ? as_bytes(r.radar) : ByteView{})
      .bind(ByteView{png})
      .run();
  if (r.radar_stats || r.radar_temperature) insert_radar_status(r);
  insert_spd_status(r);
  insert_clocks(r);
  insert_slot(r);
  insert_signal(r);
}

void RecordRows::insert_clocks(const FusedRecord& r) {
  if (!r.missing.empty()) {
    std::string names;
    for (const Sensor sensor : all_sensors) {
      if (!r.missing.contains(sensor)) continue;
      if (!names.empty()) names += ' ';
      names += name_of(sensor);
    }
    Statement(db_, path_, "INSERT INTO incomplete VALUES (?,?)").bind(r.index).bind(names).run();
  }
  if (std::none_of(r.clocks.begin(), r.clocks.end(), [](auto& c) { return c.has_value(); })) return;
  Statement s(db_, path_, "INSERT INTO clock_fit VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const auto& clock : r.clocks)
    if (clock)
      s.bind(clock->offset_s).bind(clock->drift_ppm).bind(clock->residual_s).bind(clock->samples);
    else
      for (int i = 0; i < 4; ++i) s.bind(ByteView{});
  s.run();
}

void RecordRows::insert_slot(const FusedRecord& r) {
  const SlotBooks& b = r.books;
  Statement s(db_, path_, "INSERT INTO slot VALUES (?,?,?,?,?,?)");
  const auto put = [&](std::uint64_t frames, std::optional<std::uint32_t> last) {
    s.bind(frames);
    last ? s.bind(std::int64_t{*last}) : s.bind(ByteView{});
  };
  s.bind(r.index);
  put(b.radar_frames, b.radar_last);
  put(b.depth_frames, b.depth_last);
  s.bind(b.closed_late_s).run();
}

void RecordRows::insert_signal(const FusedRecord& r) {
  const Signal& n = r.signal;
  if (n == Signal{}) return;
  Statement s(db_, path_, "INSERT INTO signal VALUES (?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const auto& v : {n.clicks_a_pulse, n.spd_clicks, n.spd_peak_m, n.radar_snr_db,
                        n.radar_peak_m, n.depth_share})
    v ? s.bind(*v) : s.bind(ByteView{});
  s.run();
}

void RecordRows::insert_spd_status(const FusedRecord& r) {
  const SpdCounts& c = r.spd_counts;
  if (c.missed + c.overflows + c.errors + c.bad_tags + c.backwards + c.removed == 0) return;
  Statement s(db_, path_, "INSERT INTO spd_status VALUES (?,?,?,?,?,?,?)");
  s.bind(r.index);
  for (const std::uint64_t v :
       {c.missed, c.overflows, c.errors, c.bad_tags, c.backwards, c.removed})
    s.bind(v);
  s.run();
}

void RecordRows::insert_radar_status(const FusedRecord& r) {
  Statement s(db_, path_, "INSERT INTO radar_status VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?,?)");
  s.bind(r.index);
  const auto put = [&](bool there, std::int64_t value) {
    there ? s.bind(value) : s.bind(ByteView{});
  };
  const bool stats = r.radar_stats.has_value();
  const RadarStats n = r.radar_stats.value_or(RadarStats{});
  for (const std::uint32_t v :
       {n.inter_frame_processing_us, n.transmit_us, n.inter_frame_margin_us,
        n.inter_chirp_margin_us, n.active_frame_load_percent, n.inter_frame_load_percent})
    put(stats, v);
  const RadarTemperature t = r.radar_temperature.value_or(RadarTemperature{1, 0, {}});
  put(t.invalid == 0, t.time_ms);
  for (const std::int16_t v : t.celsius) put(t.invalid == 0, v);
  s.run();
}

}  // namespace echofuse::record
