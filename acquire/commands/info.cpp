// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "acquire/commands/commands.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

Json by_sensor(const PerSensor<std::int64_t>& values) {
  return {{"spd", values[Sensor::spd]},
          {"radar", values[Sensor::radar]},
          {"depth", values[Sensor::depth]}};
}

// Returns a description of the antenna data; an empty object if the run has no antenna data.
Json array_of(const record::RunReader& run, const record::RunSummary& sum) {
  const auto axis = run.axis("array");
  if (!axis) return Json::object();
  Json antennas = Json::array();
  bool calibrated = false;
  for (const record::Antenna& a : run.antennas()) {
    calibrated |= a.gain != 1 || a.phase_rad != 0;
    antennas.push_back({{"x", a.x}, {"y", a.y}, {"gain", a.gain}, {"phase_rad", a.phase_rad}});
  }
  const auto records = static_cast<double>(std::max<std::int64_t>(sum.arrays, 1));
  return {{"antennas", record::antennas_of(*axis)},
          {"bins", axis->count},
          {"end_m", axis->at(axis->count - 1.0)},
          {"records", sum.arrays},
          {"frames_a_record", static_cast<double>(sum.array_frames) / records},
          {"bytes_a_record", record::array_bytes(*axis)},
          {"calibrated", calibrated},
          {"places", antennas}};
}

// Returns the direction and the total number of clicks of each detector zone; an empty array for a
// single-pixel detector.
Json zones_of(const record::RunReader& run) {
  const auto axis = run.axis("spd");
  if (!axis || axis->zones == single_pixel()) return Json::array();
  const Zones& zones = axis->zones;
  std::vector<double> clicks(zones.size());
  const auto add = [&](const record::FusedRecord& r) {
    for (std::size_t i = 0; i < r.spd.size(); ++i)
      clicks[i * zones.size() / r.spd.size()] += r.spd[i];
    return true;
  };
  run.for_each(add, 0, [](std::int64_t, const std::string&) {}, {Sensor::spd});
  Json out = Json::array();
  for (std::size_t z = 0; z < zones.size(); ++z) {
    Json zone{{"clicks", clicks[z]}, {"zero_ps", zones[z].zero_ps}};
    if (zones[z].has_direction())
      zone.update({{"x", zones[z].x}, {"y", zones[z].y}, {"width", zones[z].width}});
    out.push_back(zone);
  }
  return out;
}

Json paths(const std::vector<std::string>& files) {
  Json out = Json::array();
  for (const std::string& file : files) out.push_back(utf8_text(file));
  return out;
}

Json marks_of(const record::RunReader& run) {
  Json out = Json::array();
  for (const record::Event& e : run.events())
    if (e.level == "mark" || e.level == "label" || e.level == "note")
      out.push_back({{"utc", e.utc}, {"kind", e.level}, {"source", e.source}, {"text", e.text}});
  return out;
}

Json axes_of(const record::RunReader& run) {
  Json out = Json::array();
  for (const Axis& a : run.axes())
    out.push_back({{"name", a.name},
                   {"quantity", a.quantity},
                   {"unit", a.unit},
                   {"count", a.count},
                   {"start", a.start},
                   {"step", a.step},
                   {"scale", a.scale}});
  return out;
}

Json clocks_of(const record::RunSummary& sum) {
  Json out = Json::object();
  for (const Sensor s : all_sensors)
    if (const auto& c = sum.clocks[s])
      out[name_of(s)] = {{"offset_s", c->offset_s},
                         {"drift_ppm", c->drift_ppm},
                         {"residual_s", c->residual_s},
                         {"samples", c->samples}};
  return out;
}

Json calibrations_of(const record::RunReader& run) {
  Json out = Json::array();
  for (const auto& c : run.calibrations())
    out.push_back({{"sensor", name_of(c.sensor)},
                   {"offset_m", c.offset_m},
                   {"standard_error_m", c.standard_error_m},
                   {"distance_m", c.distance_m},
                   {"date_utc", c.date_utc},
                   {"method", c.method}});
  return out;
}

Json devices_of(const record::RunReader& run) {
  Json out = Json::array();
  for (const DeviceInfo& d : run.devices())
    out.push_back({{"sensor", name_of(d.sensor)},
                   {"address", d.address},
                   {"model", d.model},
                   {"serial", d.serial},
                   {"firmware", d.firmware}});
  return out;
}

Json to_json(const record::RunReader& run) {
  const record::RunInfo info = run.info();
  const record::RunSummary sum = run.summary();
  Json counters = Json::object(), verdicts = Json::object(), meta = Json::object();
  for (const record::CounterRow& c : run.counters()) counters[c.source][c.name] = c.value;
  for (const Sensor s : all_sensors) {
    Json& of_sensor = verdicts[name_of(s)] = Json::object();
    for (const auto& [kind, records] : sum.verdicts.by_sensor[s])
      of_sensor[record::row_of(kind).word] = records;
  }
  for (const auto& [key, value] : info.meta) meta[key] = value;
  return {{"schema", 1},
          {"file", utf8_text(run.path())},
          {"uuid", info.uuid},
          {"status", info.status},
          {"leftovers", paths(run.leftovers())},
          {"records", sum.records},
          {"all_valid", sum.all_valid},
          {"incomplete", sum.incomplete},
          {"doubtful", sum.verdicts.doubtful},
          {"doubts", sum.verdicts.doubts()},
          {"policy", sum.policies},
          {"clocks", clocks_of(sum)},
          {"valid", by_sensor(sum.valid)},
          {"verdicts", verdicts},
          {"lost", by_sensor(sum.lost)},
          {"tags", sum.tags},
          {"labels", sum.labels},
          {"events", sum.events},
          {"window_s", info.window_s},
          {"started_utc", info.started_utc},
          {"ended_utc", info.ended_utc},
          {"first_slot_utc", sum.records > 0 ? iso8601(sum.first_utc) : ""},
          {"last_slot_end_utc", sum.records > 0 ? iso8601(sum.last_utc) : ""},
          {"version", info.version},
          {"host", info.host},
          {"operator", info.operator_name},
          {"notes", info.notes},
          {"meta", meta},
          {"marks", marks_of(run)},
          {"counters", counters},
          {"axes", axes_of(run)},
          {"array", array_of(run, sum)},
          {"zones", zones_of(run)},
          {"calibrations", calibrations_of(run)},
          {"devices", devices_of(run)}};
}

std::string word(const Json& value) {
  if (value.is_string()) return value.get<std::string>();
  return value.is_number_float() ? format("%.6g", value.get<double>())
                                 : value.dump(-1, ' ', true, Json::error_handler_t::replace);
}

// {"a": 1, "b": 2} -> "a 1, b 2"
std::string list(const Json& object) {
  std::string text;
  for (const auto& [key, value] : object.items())
    text += (text.empty() ? "" : ", ") + (key.empty() ? std::string("(none)") : key) + " " +
            word(value);
  return text;
}

// Formats a value with at least 4 significant digits and an SI prefix: 7.8683e-05, "s" ->
// "78.68 µs".
std::string measure(const Json& value, const std::string& unit) {
  const double number = value.get<double>();
  double factor = 1;
  const char* prefix = "";
  if (number != 0 && std::abs(number) < 0.1 && unit.size() == 1 && unit != "1")
    for (const auto& [smaller, name] : {std::pair{1e3, "m"}, {1e6, "µ"}, {1e9, "n"}})
      if (std::abs(number) * factor < 1) factor = smaller, prefix = name;
  return format("%.*g", std::abs(number) < 1e4 ? 4 : 7, number * factor) +
         (unit == "1" ? "" : std::string(" ") + prefix + unit);
}

std::string millimetres(const Json& metres) { return format("%.2f", 1e3 * metres.get<double>()); }

// Omits counters that are 0, and converts large byte counts to MB.
Json counts(const Json& object) {
  Json out = Json::object();
  for (const auto& [name, value] : object.items())
    if (name.ends_with("bytes") && value > 1'000'000)
      out[name] = measure(value.get<double>() / 1e6, "MB");
    else if (value != 0)
      out[name] = value;
  return out;
}

std::string array_text(const Json& a) {
  if (a.empty()) return "";
  return word(a["antennas"]) + " antennas, " + word(a["bins"]) + " bins to " +
         measure(a["end_m"], "m") + ", in " + word(a["records"]) + " records of " +
         measure(a["frames_a_record"], "1") + " frames and " + word(a["bytes_a_record"]) +
         " bytes, " + (a["calibrated"] ? "calibrated" : "not calibrated");
}

std::string to_text(const Json& j) {
  constexpr std::size_t longest = 2000;  // maximum length of a line in bytes
  std::string out = printable(word(j["file"])) + ": " + word(j["records"]) + " records, " +
                    printable(word(j["status"]), 40) + "\n";
  const auto line = [&](const char* name, const std::string& value) {
    if (!value.empty())
      out += "  " + std::string(name) + std::string(10 - std::string(name).size(), ' ') +
             printable(value, longest) + "\n";
  };
  if (j["status"] == record::crashed_without_wal)
    line("missing",
         "its last records are in " + word(j["file"]) +
             "-wal, which is missing here; this may be a copy of a run that was not closed");
  for (const auto& file : j["leftovers"])
    line("leftover", word(file) + ": not read, because the run is closed; move it away");
  if (j["records"] > 0)
    line("slots", word(j["first_slot_utc"]) + " to " + word(j["last_slot_end_utc"]) + ", " +
                      word(j["window_s"]) + " s each");
  line("valid", list(j["valid"]) + "; all three sensors " + word(j["all_valid"]));
  for (const auto& [sensor, counts] : j["verdicts"].items())
    line("verdicts", counts.empty() ? "" : sensor + ": " + list(counts));
  line("doubts", word(j["doubts"]));
  if (!j["policy"].empty())
    line("policy", list(j["policy"]) + "; incomplete " + word(j["incomplete"]));
  for (const auto& [sensor, clock] : j["clocks"].items())
    line("clock", sensor + ": offset " + measure(clock["offset_s"], "s") + ", drift " +
                      measure(clock["drift_ppm"], "ppm") + ", residual " +
                      measure(clock["residual_s"], "s") + ", " + word(clock["samples"]) +
                      " samples");
  line("lost", list(j["lost"]) + "; tags " + word(j["tags"]));
  for (const auto& [sensor, found] : j["counters"].items())
    line("counted", sensor + ": " + list(counts(found)));
  line("labels", list(j["labels"]));
  line("events", list(j["events"]));
  for (const auto& a : j["axes"])
    line("axis", word(a["name"]) + ": " + word(a["count"]) + " x " + measure(a["step"], a["unit"]) +
                     " from " + measure(a["start"], a["unit"]) + ", " + word(a["quantity"]));
  std::string clicks;
  for (const auto& zone : j["zones"]) clicks += " " + word(zone["clicks"]);
  if (!clicks.empty())
    line("zones", word(j["zones"].size()) + ", clicks" + clicks +
                      (j["zones"][0].contains("x") ? "" : "; directions unknown"));
  line("array", array_text(j["array"]));
  for (const auto& c : j["calibrations"])
    line("offset", word(c["sensor"]) + ": " + millimetres(c["offset_m"]) + " ± " +
                       millimetres(c["standard_error_m"]) + " mm, of " + word(c["date_utc"]));
  for (const auto& d : j["devices"])
    line("device", word(d["sensor"]) + ": " + word(d["model"]) + " " + word(d["serial"]) + " at " +
                       word(d["address"]));
  line("made by", "echofuse " + word(j["version"]) + " on " + word(j["host"]) +
                      (word(j["operator"]).empty() ? "" : " by " + word(j["operator"])));
  line("notes", word(j["notes"]));
  for (const auto& [key, value] : j["meta"].items()) line("meta", key + " = " + word(value));
  for (const auto& m : j["marks"])
    line(word(m["kind"]).c_str(), word(m["utc"]) + " " + word(m["text"]));
  return out;
}

}  // namespace

std::string describe_run(const std::string& path, bool json) {
  const Json description = to_json(record::RunReader(path));
  return json ? description.dump(2, ' ', true, Json::error_handler_t::replace) + "\n"
              : to_text(description);
}

}  // namespace echofuse::acquire
