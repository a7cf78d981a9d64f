// SPDX-License-Identifier: MIT
#include "acquire/record/rows.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "acquire/record/side_files.hpp"

namespace echofuse::record {
namespace {

using Json = nlohmann::ordered_json;

std::string meta_text(const RunInfo& info) {
  Json meta = Json::object();
  for (const auto& [key, value] : info.meta) meta[key] = value;
  return meta.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool take_meta(const std::string& text, RunInfo& info) {
  const Json meta = Json::parse(text, nullptr, false);
  if (!meta.is_object()) return false;
  for (const auto& [key, value] : meta.items()) {
    if (!value.is_string()) return false;
    if (key != wal_key_name) info.meta.emplace_back(key, value.get<std::string>());
  }
  return true;
}

}  // namespace

void Row::operator()(std::string_view name, Sensor& value) {
  std::string text = name_of(value);
  (*this)(name, text);
  if (!reading()) return;
  const auto* const found =
      std::ranges::find_if(all_sensors, [&](Sensor s) { return text == name_of(s); });
  if (found == std::end(all_sensors))
    return fail("a row contains the sensor \"" + printable(text, 40) +
                "\"; expected spd, radar or depth");
  value = *found;
}

void Row::operator()(std::string_view name, SensorSet& value) {
  std::int64_t bits = value.bits();
  (*this)(name, bits);
  if (reading()) value = SensorSet::from_bits(static_cast<std::uint32_t>(bits & 7));
}

void Row::operator()(std::string_view name, std::chrono::nanoseconds& value) {
  std::int64_t count = value.count();
  (*this)(name, count);
  if (reading()) value = std::chrono::nanoseconds(count);
}

void Row::list(std::string_view name, const char* type) {
  const std::string separator = names_.empty() ? "" : ", ";
  names_.append(separator).append(name);
  values_.append(separator).append("?");
  declared_.append(separator).append(name).append(" ").append(type).append(std::exchange(key_, ""));
}

void columns(Row& row, RunInfo& info) {
  row.table("run");
  row("uuid", info.uuid);
  row("started_utc", info.started_utc);
  row("ended_utc", info.ended_utc);
  row("status", info.status);
  row("window_s", info.window_s);
  row("config_text", info.config_text);
  row("config_resolved", info.config_resolved);
  row("radar_cfg", info.radar_cfg);
  row("version", info.version);
  row("host", info.host);
  row("operator", info.operator_name);
  row("notes", info.notes);
  std::string meta = meta_text(info);
  row("meta", meta);
  if (row.reading() && !take_meta(meta, info)) row.fail("meta is not a JSON object of strings");
}

void columns(Row& row, DeviceRow& device) {
  row.table("device");
  row("sensor", device.sensor);
  row("policy", device.policy);
  row.group(device.info, [&](DeviceInfo& info) {
    row("address", info.address);
    row("model", info.model);
    row("serial", info.serial);
    row("firmware", info.firmware);
  });
}

void columns(Row& row, CalibrationEntry& entry) {
  row.table("calibration");
  row("sensor", entry.sensor);
  row("date_utc", entry.date_utc);
  row("method", entry.method);
  row("distance_m", entry.distance_m);
  row("offset_m", entry.offset_m);
  row("standard_error_m", entry.standard_error_m);
}

void columns(Row& row, Axis& axis) {
  row.table("axis");
  row.key("name", axis.name);
  row("quantity", axis.quantity);
  row("unit", axis.unit);
  row("count", axis.count);
  row("start", axis.start);
  row("step", axis.step);
  row("scale", axis.scale);
}

void columns(Row& row, Antenna& antenna) {
  row.table("antenna");
  row("x", antenna.x);
  row("y", antenna.y);
  row("gain", antenna.gain);
  row("phase_rad", antenna.phase_rad);
}

void columns(Row& row, Zone& zone) {
  row.table("zone");
  row("x", zone.x);
  row("y", zone.y);
  row("width", zone.width);
  row("zero_ps", zone.zero_ps);
}

void columns(Row& row, Anchor& anchor) {
  row.table("anchor");
  row("mono_ns", anchor.mono);
  row("utc_ns", anchor.utc);
}

void columns(Row& row, CounterRow& counted) {
  row.table("counter");
  row("source", counted.source);
  row("name", counted.name);
  row("value", counted.value);
}

void columns(Row& row, Event& event) {
  row.table("event");
  row.key("id", event.id);
  row("utc", event.utc);
  row("level", event.level);
  row("source", event.source);
  row("text", event.text);
}

void columns(Row& row, LateRow& late) {
  row.table("late");
  row.key("idx", late.index);
  for (const Sensor s : all_sensors) row(name_of(s), late.samples[s]);
}

namespace {

void columns(Row& row, TagCounts& tags) {
  row("tags", tags.tags);
  row("starts", tags.starts);
  row("in_range", tags.in_range);
  row("out_of_range", tags.out_of_range);
  row("without_start", tags.without_start);
  row("other", tags.other);
  row("spd_missed", tags.missed);
  row("spd_overflows", tags.overflows);
  row("spd_errors", tags.errors);
  row("spd_bad_tags", tags.bad_tags);
  row("spd_backwards", tags.backwards);
  row("spd_removed", tags.removed);
  row("spd_lost_blocks", tags.lost_blocks);
}

void columns(Row& row, const std::string& sensor, Verdict& verdict) {
  std::string word = verdict.word();
  row(sensor + "_verdict", word);
  row(sensor + "_figures", verdict.figures);
  if (!row.reading()) return;
  verdict.kind = kind_of(word);
  // Keeps an unknown word with the figures.
  if (word != verdict.word())
    verdict.figures = verdict.figures.empty() ? word : word + ": " + verdict.figures;
}

}  // namespace

void columns(Row& row, FusedRecord& r) {
  row.table("record");
  row.key("idx", r.index);
  row("slot_start_ns", r.slot_start);
  row("slot_end_ns", r.slot_end);
  row("slot_utc_ns", r.slot_utc);
  row("valid", r.valid);
  row("missing", r.missing);
  row("label", r.label);
  columns(row, r.spd_counts);
  for (const Sensor s : all_sensors) {
    const std::string name = name_of(s);
    SensorSync& sync = r.sync[s];
    row(name + "_offset_s", sync.offset_s);
    row(name + "_span_s", sync.span_s);
    row(name + "_used", sync.used);
    row(name + "_lost", sync.lost);
    columns(row, name, sync.verdict);
    row.group(r.clocks[s], [&](ClockState& clock) {
      row(name + "_clock_offset_s", clock.offset_s);
      row(name + "_clock_drift_ppm", clock.drift_ppm);
      row(name + "_clock_residual_s", clock.residual_s);
      row(name + "_clock_samples", clock.samples);
    });
  }
  SlotStatistics& slot = r.statistics;
  row("radar_frames", slot.radar_frames);
  row("radar_last", slot.radar_last);
  row("depth_frames", slot.depth_frames);
  row("depth_last", slot.depth_last);
  row("closed_late_s", slot.closed_late_s);
  row("clicks_per_pulse", r.signal.clicks_per_pulse);
  row("spd_clicks", r.signal.spd_clicks);
  row("spd_peak_m", r.signal.spd_peak_m);
  row("radar_snr_db", r.signal.radar_snr_db);
  row("radar_peak_m", r.signal.radar_peak_m);
  row("depth_share", r.signal.depth_share);
  row.group(r.radar_stats, [&](RadarStats& stats) {
    row("radar_inter_frame_processing_us", stats.inter_frame_processing_us);
    row("radar_transmit_us", stats.transmit_us);
    row("radar_inter_frame_margin_us", stats.inter_frame_margin_us);
    row("radar_inter_chirp_margin_us", stats.inter_chirp_margin_us);
    row("radar_active_frame_load_percent", stats.active_frame_load_percent);
    row("radar_inter_frame_load_percent", stats.inter_frame_load_percent);
  });
  auto sound =
      r.radar_temperature && r.radar_temperature->invalid == 0 ? r.radar_temperature : std::nullopt;
  row.group(sound, [&](RadarTemperature& temperature) {
    row("radar_temperature_ms", temperature.time_ms);
    for (std::size_t i = 0; i < std::size(temperature_places); ++i)
      row(std::string("radar_") + temperature_places[i] + "_c", temperature.celsius[i]);
  });
  if (row.reading()) r.radar_temperature = sound;
  row("array_frames", r.array_frames);
}

void columns(Row& row, Blobs& blobs) {
  for_each_column([&](const auto& column, std::size_t i) {
    ByteView bytes = blobs[i];
    row(column.name, bytes);
    if (row.reading()) blobs[i].assign(bytes.begin(), bytes.end());
  });
}

void columns(Row& row, StoredRecord& stored) {
  columns(row, stored.record);
  columns(row, stored.blobs);
}

void insert_axis(sqlite3* db, const std::string& path, const Axis& axis) {
  insert(db, path, axis);
  if (axis.zones == single_pixel()) return;
  execute(db, path, table_of<Zone>().create().c_str(), "cannot store the zones");
  for (const Zone& zone : axis.zones) insert(db, path, zone);
}

const std::vector<const Row*>& tables() {
  static const std::vector<const Row*> all{
      &table_of<RunInfo>(),     &table_of<DeviceRow>(), &table_of<CalibrationEntry>(),
      &table_of<Axis>(),        &table_of<Antenna>(),   &table_of<Anchor>(),
      &table_of<CounterRow>(),  &table_of<Event>(),     &table_of<LateRow>(),
      &table_of<StoredRecord>()};
  return all;
}

std::map<std::string, std::string> table_definitions() {
  std::map<std::string, std::string> out;
  for (const char* columns : {"1(tbl,idx,stat)", "2(tbl,idx,sampleno,sample)",
                              "3(tbl,idx,neq,nlt,ndlt,sample)", "4(tbl,idx,neq,nlt,ndlt,sample)"}) {
    const std::string name = "sqlite_stat" + std::string(columns, 1);
    out[name] = "CREATE TABLE sqlite_stat" + std::string(columns);
  }
  for (const Row* table : tables()) out[table->name()] = table->create();
  out[table_of<Zone>().name()] = table_of<Zone>().create();
  return out;
}

}  // namespace echofuse::record
