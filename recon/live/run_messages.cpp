// SPDX-License-Identifier: MIT
#include "recon/live/run_messages.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"
#include "recon/live/pictures.hpp"

namespace echofuse::view {
namespace {

using Json = nlohmann::json;
constexpr double first_minute_s = 60;
constexpr std::size_t max_reference_records = 200;
constexpr std::int64_t checked_records = 100;
constexpr double check_pause_s = 10;
// Maximum number of records in a sum that starts at a mark. Reading 20 000 records takes about 0.3
// s.
constexpr std::int64_t max_since_mark = 20'000;
constexpr std::size_t max_sums = 4;  // maximum number of cached sums
// Maximum number of events searched for a mark.
constexpr std::size_t max_events_searched = 1000;

Json axis_json(const Axis& a) {
  return {{"quantity", a.quantity},
          {"unit", a.unit},
          {"count", a.count},
          {"start", a.start},
          {"step", a.step}};
}

Json end_of(const Outline& o) { return {{"index", o.index}, {"utc", iso8601(o.end)}}; }

// Adds the histogram to the message. If the detector has zones, also adds the histogram and the
// direction of each zone.
void add_clicks(MessageWriter& out, Json& head, const record::FusedRecord& r,
                const record::RunReader& run) {
  const Zones zones = run.axis("spd").value_or(Axis{}).zones;
  const std::size_t bins = r.spd.size() / zones.size();
  out.add("spd", sum_of_zones(r.spd, bins));
  if (zones.size() < 2) return;
  out.add<std::uint32_t>("zones", r.spd, {zones.size(), bins});
  for (const Zone& z : zones)
    head["zones"].push_back(z.has_direction() ? Json{z.x, z.y, z.width} : Json());
}

}  // namespace

Message answer(bool ok, const std::string& text) {
  return MessageWriter().finish({{"kind", "answer"}, {"ok", ok}, {"text", text}});
}
Message trouble(const std::string& text) {
  return MessageWriter().finish({{"kind", "trouble"}, {"text", text}});
}

std::vector<std::int64_t> spread(const std::vector<std::int64_t>& values, std::size_t count) {
  if (values.size() <= count) return values;
  std::vector<std::int64_t> out;
  for (std::size_t k = 0; k < count; ++k)
    out.push_back(values[count > 1 ? k * (values.size() - 1) / (count - 1) : 0]);
  return out;
}

// Returns settings from the run's stored configuration, which is parsed only once per run.
const RunMessages::RunSettings& RunMessages::settings() {
  if (std::exchange(settings_edition_, run_.edition()) == run_.edition()) return settings_;
  settings_ = {};
  const std::map<std::string, double*> expected{
      {"tdc.laser_rate_hz", &settings_.laser_hz},
      {"signal.clicks_per_pulse", &settings_.max_clicks_per_pulse},
      {"alert.after_s", &settings_.alert.after_s},
      {"alert.disk_free_gb", &settings_.alert.disk_free_gb}};
  for_each_setting(run_.info().config_resolved,
                   [&](const std::string& key, const std::string& value) {
                     if (const auto at = expected.find(key); at != expected.end())
                       *at->second = std::strtod(value.c_str(), nullptr);
                   });
  return settings_;
}

Message RunMessages::about_run(bool may_write) {
  const record::RunInfo& info = run_.info();
  Json axes = Json::object();
  for (const Axis& a : run_.axes()) axes[a.name] = axis_json(a);
  const record::MapGrid grid = record::map_grid_of(run_.axes());
  Json out{{"kind", "run"},
           {"file", std::filesystem::path(run_.path()).filename().string()},
           {"uuid", info.uuid},
           {"edition", run_.edition()},
           {"window_s", info.window_s},
           {"started_utc", info.started_utc},
           {"host", info.host},
           {"operator", info.operator_name},
           {"notes", info.notes},
           {"version", info.version},
           {"axes", axes},
           {"facts", facts()},
           {"trigger", trigger_levels()},
           {"max_clicks_per_pulse", settings().max_clicks_per_pulse},
           {"baseline_m", record::radar_mounting_of(info.meta).baseline_m},
           {"map", {{"size", grid.size}, {"half_tangent", grid.half_tangent}}},
           {"model", model_ ? Json(model_->name()) : Json()},
           {"calibrated", model_ && model_->calibrated()},
           {"may_write", may_write && run_.live()}};
  return MessageWriter().finish(std::move(out));
}

Json RunMessages::sensors() const {
  const UtcTime now = clock_.utc();
  Json out = Json::object();
  for (const Sensor s : all_sensors) {
    const SensorState& sensor = run_.sensors()[s];
    const auto age = age_s(sensor, now);
    out[name_of(s)] = {{"verdict", sensor.verdict.text()},
                       {"lamp", record::name_of(sensor.verdict.row().lamp)},
                       {"doubtful", sensor.verdict.row().doubtful},
                       {"configured", sensor.configured},
                       {"valid", sensor.valid},
                       {"age_s", age ? number(*age) : Json()},
                       {"stale", run_.live() && is_stale(sensor, run_.info().window_s, now)},
                       {"used", sensor.used},
                       {"arrived", sensor.arrived ? Json(*sensor.arrived) : Json()},
                       {"lost", sensor.lost},
                       {"late", sensor.late},
                       {"missing", sensor.missing},
                       {"residual_s", sensor.residual_s ? number(*sensor.residual_s) : Json()},
                       {"worst", worst(s)}};
  }
  return out;
}

// Returns the most frequent doubtful verdict on a sensor in the run, and the last record with any
// doubtful verdict on it; null if no verdict is doubtful.
Json RunMessages::worst(Sensor sensor) const {
  std::pair<std::int64_t, record::VerdictKind> most_frequent{};
  for (const auto& [kind, records] : run_.verdicts().by_sensor[sensor])
    if (record::row_of(kind).doubtful) most_frequent = std::max(most_frequent, {records, kind});
  const auto last = run_.sensors()[sensor].last_doubtful;
  if (!last) return nullptr;
  const record::VerdictRow& row = record::row_of(most_frequent.second);
  Json out = end_of(run_.outlines()[*last]);
  out.update({{"word", row.word}, {"valid", row.valid}, {"records", most_frequent.first}});
  return out;
}

// Returns the free disk space, and the time until the disk is full, estimated from the run's mean
// data rate.
Json RunMessages::disk() const {
  const auto free = run_.free_bytes();
  if (!free) return nullptr;
  const auto records = static_cast<double>(run_.outlines().size());
  Json out{{"free_bytes", *free}, {"lasts_s", nullptr}};
  if (records > 0 && run_.bytes() > 0 && run_.info().window_s > 0)
    out["lasts_s"] = number(static_cast<double>(*free) * records * run_.info().window_s /
                            static_cast<double>(run_.bytes()));
  return out;
}

// Returns the active alerts. The limits are the settings alert.* of the run.
Json RunMessages::alerts() {
  Json out = Json::array();
  const std::string& status = run_.info().status;
  if (!run_.live() && status != "complete") out.push_back({{"source", "run"}, {"kind", status}});
  if (!run_.live()) return out;
  const record::AlertLimits& limits = settings().alert;
  const UtcTime now = clock_.utc();
  const double window_s = run_.info().window_s;
  for (const Sensor s : all_sensors) {
    const SensorState& sensor = run_.sensors()[s];
    if (!sensor.configured) continue;
    const std::string state =
        record::state_of(sensor.valid && !is_stale(sensor, window_s, now), sensor.verdict);
    states_[s].take(state, seconds(now), seconds(now), limits.lasting_s(window_s));
    if (states_[s].state() != "ok")
      out.push_back({{"source", name_of(s)}, {"kind", states_[s].state()}});
  }
  if (const auto free = run_.free_bytes(); free && record::is_disk_low(*free, limits))
    out.push_back({{"source", "disk"}, {"kind", "low"}});
  return out;
}

Message RunMessages::state() {
  Json events = Json::array();
  for (const record::Event& e : run_.events())
    events.push_back({{"utc", e.utc},
                      {"level", e.level},
                      {"source", e.source},
                      {"text", printable(e.text, 300)}});
  const auto& outlines = run_.outlines();
  const auto records = static_cast<std::int64_t>(outlines.size());
  Json out{{"kind", "state"},
           {"status", run_.info().status},
           {"utc", iso8601(clock_.utc())},
           {"records", records},
           {"planned", planned_ ? Json(*planned_) : Json()},
           {"label", run_.label()},
           {"sensors", sensors()},
           {"disk", disk()},
           {"alerts", alerts()},
           {"events", events},
           {"first_index", nullptr},
           {"last_index", nullptr},
           {"elapsed_s", 0},
           {"doubt", nullptr},
           {"doubts", run_.verdicts().doubts()},
           {"doubtful", run_.verdicts().doubtful},
           {"last_doubt", nullptr},
           {"ended_utc", run_.info().ended_utc},
           {"remaining_s", nullptr}};
  check_maps();
  if (!group_.doubt.empty()) out["doubt"] = group_.doubt;
  if (records > 0) {
    out["first_index"] = outlines.front().index;
    out["last_index"] = outlines.back().index;
    const auto last = std::find_if(outlines.rbegin(), outlines.rend(),
                                   [](const Outline& o) { return o.doubtful; });
    if (last != outlines.rend()) out["last_doubt"] = end_of(*last);
    if (!run_.live()) out["ended_utc"] = iso8601(outlines.back().end);
    const UtcTime end = run_.live() ? clock_.utc() : outlines.back().end;
    out["elapsed_s"] = std::max(0.0, seconds(end - outlines.front().start));
  }
  if (planned_ && run_.live())
    out["remaining_s"] =
        static_cast<double>(std::max<std::int64_t>(*planned_ - records, 0)) * run_.info().window_s;
  return MessageWriter().finish(std::move(out));
}

Message RunMessages::record(std::int64_t index, bool live) {
  if (last_ && index == last_index_ && live == last_live_ && last_edition_ == run_.edition())
    return last_;
  last_ = make_record(index, live);
  last_index_ = index, last_live_ = live, last_edition_ = run_.edition();
  return last_;
}

Message RunMessages::make_record(std::int64_t index, bool live) {
  MessageWriter out;
  Json head{{"kind", "record"}, {"index", index}, {"live", live}};
  run_.with_reader([&](const record::RunReader& run) {
    const record::FusedRecord r = run.read(index);
    const std::vector<Axis> axes = run.axes();
    head["utc"] = iso8601(r.slot_utc);
    head["label"] = r.label;
    for (const Sensor s : all_sensors)
      head["sensors"][name_of(s)] = {{"verdict", r.sync[s].verdict.text()},
                                     {"lamp", record::name_of(r.sync[s].verdict.row().lamp)},
                                     {"doubtful", r.sync[s].verdict.row().doubtful},
                                     {"valid", r.has(s)},
                                     {"used", r.sync[s].used},
                                     {"lost", r.sync[s].lost}};
    Tally one;
    one.add(r, axes);
    head.update(one.numbers(axes, settings().laser_hz));
    if (r.has(Sensor::spd)) add_clicks(out, head, r, run);
    if (r.has(Sensor::radar)) out.add("radar", to_db(r.radar));
    if (const Axis* array = find(axes, "array"))
      out.add<float>("beams", beams_of(r, run.antennas(), array->count),
                     {array->count, record::beams});
    add_maps(out, head, r, run);
  });
  return out.finish(std::move(head));
}

// Tests the newest maps every 10 s, because the result changes slowly and the test takes several
// milliseconds.
void RunMessages::check_maps() {
  const auto last = run_.last();
  if (!model_ || !last || *last == checked_last_) return;
  const HostTime now = clock_.now();
  if (*last > checked_last_ && checked_last_ >= 0 && seconds(now - checked_) < check_pause_s)
    return;
  checked_last_ = *last, checked_ = now;
  const std::int64_t first = std::max(run_.outlines().front().index, *last - checked_records + 1);
  try {
    run_.with_reader([&](const record::RunReader& run) {
      const double before =
          std::exchange(group_, model_->check(run, first, *last - first + 1)).interval_factor;
      if (group_.interval_factor != before) last_ = nullptr;
    });
  } catch (const Error&) {
    group_ = {};  // other messages report that the run cannot be read
  }
}

// Returns the index of the first record after the newest mark that was set before the end of record
// `index`. Returns `index` if no record up to `index` started after the mark. Returns an empty
// value if no mark was found.
std::optional<std::int64_t> RunMessages::first_since_mark(std::int64_t index) const {
  const auto& all = run_.outlines();
  const auto shown = std::ranges::find(all, index, &Outline::index);
  if (shown == all.end()) return std::nullopt;
  std::string mark;
  run_.with_reader([&](const record::RunReader& run) {
    for (const record::Event& e : run.last_events(max_events_searched))
      if (e.level == "note" && e.utc <= iso8601(shown->end)) mark = e.utc;
  });
  if (mark.empty()) return std::nullopt;
  const auto first =
      std::ranges::partition_point(all, [&](const Outline& o) { return iso8601(o.start) < mark; });
  return first == all.end() || first->index > index ? index : first->index;
}

Message RunMessages::sum(std::int64_t index, const ShowSum& request) {
  const std::int64_t oldest = run_.outlines().empty() ? index : run_.outlines().front().index;
  const auto first = request.records > 0
                         ? std::optional(std::max(oldest, index - request.records + 1))
                         : first_since_mark(index);
  if (!first)
    return MessageWriter().finish({{"kind", "sum"}, {"why", "no mark before this record"}});
  if (sums_.size() >= max_sums && !sums_.contains(request.records)) sums_.clear();
  if (index - *first >= max_since_mark)
    return MessageWriter().finish(
        {{"kind", "sum"},
         {"why", "the mark is more than " + std::to_string(max_since_mark) + " records ago"}});
  Summed known = sums_[request.records];
  const bool grows = known.edition == run_.edition() && known.first <= *first &&
                     known.last <= index && known.last >= *first;
  if (!grows) known = {.tally = {}, .first = *first, .last = *first - 1, .edition = run_.edition()};
  const std::vector<Axis>& axes = run_.axes();
  const auto add = [&](const record::RunReader& run, std::int64_t from, std::int64_t to, int sign) {
    run.for_each(
        [&](const record::FusedRecord& r) {
          if (r.index <= to) known.tally.add(r, axes, sign);
          return r.index < to;
        },
        from, [](std::int64_t, const std::string&) {}, {Sensor::spd, Sensor::radar});
  };
  run_.with_reader([&](const record::RunReader& run) {
    if (known.first < *first) add(run, known.first, *first - 1, -1);
    if (known.last < index) add(run, known.last + 1, index, 1);
  });
  known.first = *first, known.last = index;
  sums_[request.records] = known;
  MessageWriter out;
  if (request.records != 1) {  // the message `record` already contains a single record
    if (!known.tally.clicks().empty()) out.add("spd", known.tally.clicks());
    if (const auto db = known.tally.profile_db(axes); !db.empty()) out.add("radar", db);
  }
  Json head = known.tally.numbers(axes, settings().laser_hz, request.range);
  head.update({{"kind", "sum"}, {"from", *first}, {"records", index - *first + 1}});
  return out.finish(std::move(head));
}

Message RunMessages::strip() const {
  const auto& all = run_.outlines();
  const std::size_t step = all.size() / strip_columns + 1;
  std::vector<double> first, time_s;
  PerSensor<std::vector<float>> used, lost, residual, valid;
  std::vector<float> radar_c, margin_ms;
  for (std::size_t begin = 0; begin < all.size(); begin += step) {
    const std::size_t end = std::min(begin + step, all.size());
    first.push_back(static_cast<double>(all[begin].index));
    time_s.push_back(seconds(all[begin].start - all.front().start));
    for (const Sensor s : all_sensors) {
      float sum = 0, gone = 0, worst = std::numeric_limits<float>::quiet_NaN(), good = 0;
      for (std::size_t i = begin; i < end; ++i) {
        sum += all[i].used[s], gone += all[i].lost[s];
        worst = std::fmax(worst, all[i].residual_s[s]);
        good += all[i].valid.contains(s) ? 1.0F : 0.0F;
      }
      const auto n = static_cast<float>(end - begin);
      used[s].push_back(sum / n), lost[s].push_back(gone);
      residual[s].push_back(worst), valid[s].push_back(good / n);
    }
    radar_c.push_back(std::nanf("")), margin_ms.push_back(std::nanf(""));
    for (std::size_t i = begin; i < end; ++i) {
      radar_c.back() = std::fmax(radar_c.back(), all[i].radar_c);
      margin_ms.back() = std::fmin(margin_ms.back(), all[i].margin_ms);
    }
  }
  MessageWriter out;
  out.add("first", first), out.add("time_s", time_s);
  out.add("radar_c", radar_c), out.add("margin_ms", margin_ms);
  for (const Sensor s : all_sensors) {
    const std::string name = name_of(s);
    out.add("used_" + name, used[s]);
    out.add("lost_" + name, lost[s]);
    out.add("residual_s_" + name, residual[s]);
    out.add("valid_" + name, valid[s]);
  }
  return out.finish({{"kind", "strip"}, {"records_a_column", step}});
}

Message RunMessages::sheet(std::int64_t first, std::int64_t last) const {
  std::vector<std::int64_t> within;
  for (const Outline& o : run_.outlines())
    if (o.index >= first && o.index <= last) within.push_back(o.index);
  MessageWriter out;
  Json indices = Json::array(), labels = Json::array(), lacks = Json::array();
  std::vector<float> maps, spd, radar;
  std::vector<double> time_s;
  const auto bins = [&](const char* sensor) {
    const Axis* axis = find(run_.axes(), sensor);
    return axis ? column_bins(axis->count) : 0;
  };
  const std::vector<Axis>& axes = run_.axes();
  record::MapGrid small = record::map_grid_of(axes);
  small.size = sheet_side;
  for (const std::int64_t index : spread(within, sheet_maps)) {
    run_.with_reader([&](const record::RunReader& run) {
      std::vector<float> map;
      std::string label;
      bool has_map = false;
      std::vector<float> clicks, power;
      double at_s = 0;
      run.for_each(
          [&](const record::FusedRecord& r) {
            if (r.index != index) return false;
            map = map_of(r, axes, small), label = r.label;
            at_s = seconds(r.slot_utc - run_.outlines().front().start);
            if (r.has(Sensor::spd)) clicks = column_of(clicks_of(r, axes));
            if (r.has(Sensor::radar)) power = column_of(to_db(r.radar));
            has_map = !map.empty();
            return false;
          },
          index, [](std::int64_t, const std::string&) {},
          {Sensor::spd, Sensor::radar, Sensor::depth});
      clicks.resize(bins("spd"), std::nanf("")), power.resize(bins("radar"), std::nanf(""));
      spd.insert(spd.end(), clicks.begin(), clicks.end());
      radar.insert(radar.end(), power.begin(), power.end());
      time_s.push_back(at_s);
      map.resize(small.pixels());
      maps.insert(maps.end(), map.begin(), map.end());
      indices.push_back(index), labels.push_back(label), lacks.push_back(!has_map);
    });
  }
  out.add<float>("maps", maps, {indices.size(), sheet_side, sheet_side});
  out.add<float>("spd", spd, {indices.size(), bins("spd")});
  out.add<float>("radar", radar, {indices.size(), bins("radar")});
  out.add("time_s", time_s);
  return out.finish({{"kind", "sheet"}, {"index", indices}, {"label", labels}, {"lacks", lacks}});
}

Message RunMessages::reference() {
  if (reference_edition_ == run_.edition() && reference_) return reference_;
  const auto& all = run_.outlines();
  if (all.empty()) return nullptr;
  const UtcTime end = all.front().start + from_seconds(first_minute_s);
  if (run_.live() && all.back().end < end) return nullptr;
  std::vector<double> sum;
  double records = 0;
  run_.with_reader([&](const record::RunReader& run) {
    run.for_each(
        [&](const record::FusedRecord& r) {
          if (r.slot_utc >= end || records >= max_reference_records) return false;
          if (!r.has(Sensor::spd)) return true;
          const std::vector<float> clicks = clicks_of(r, run_.axes());
          sum.resize(clicks.size());
          for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += double{clicks[i]};
          ++records;
          return true;
        },
        0, [](std::int64_t, const std::string&) {}, {Sensor::spd});
  });
  std::vector<float> mean;
  for (const double v : sum) mean.push_back(static_cast<float>(v / std::max(records, 1.0)));
  MessageWriter out;
  out.add("spd", mean);
  reference_edition_ = run_.edition();
  return reference_ = out.finish({{"kind", "reference"}, {"records", records}});
}

}  // namespace echofuse::view
