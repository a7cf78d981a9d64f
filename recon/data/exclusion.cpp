// SPDX-License-Identifier: MIT
#include "recon/data/exclusion.hpp"

#include <algorithm>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/copies.hpp"
#include "recon/data/dataset.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Returns true if the run has antenna samples but this record has none.
bool lacks_array(const Dataset& data, std::size_t row) {
  const auto values = data.array().row(row);
  return data.array().cols > 0 &&
         std::all_of(values.begin(), values.end(), [](float v) { return v == 0; });
}

// Returns true if the verdict excludes the data of a sensor: as an input, or the depth map as a
// ground truth.
bool excluded(const Dataset& data, std::size_t row, Sensor s) {
  if (!data.has(row, s)) return false;
  const record::VerdictRow& verdict = record::row_of(data.records[row].verdicts[s]);
  if (data.exclusions.lossy && verdict.kind == record::VerdictKind::lossy) return true;
  if (!data.exclusions.doubtful) return false;
  return s == Sensor::depth ? !verdict.truth : !verdict.trains;
}

}  // namespace

bool has_inputs(const Dataset& data, std::size_t row, Inputs inputs) {
  return (inputs == Inputs::radar || data.has(row, Sensor::spd)) &&
         (inputs == Inputs::spd || data.has(row, Sensor::radar)) &&
         !(inputs == Inputs::fused && lacks_array(data, row));
}

std::vector<std::string> left_out(const Dataset& data, Inputs inputs) {
  constexpr PerSensor<const char*> missing{"SPD missing", "radar missing", "camera missing"};
  Copies copies;
  const auto reason = [&](std::size_t row) -> std::string {
    for (const Sensor s : all_sensors)
      if ((s == Sensor::depth || sensors_of(inputs).contains(s)) && !data.has(row, s))
        return missing[s];
    if (!has_inputs(data, row, inputs)) return "antennas missing";
    if (std::string kind = doubt_of(data, row, inputs); !kind.empty()) return kind;
    if (!fault_of(data, row, inputs).empty()) return dead_record;
    const std::size_t first = copies.first(data.records[row].content, row);
    if (first == row) return {};
    if (data.source_of(first) == data.source_of(row)) return duplicate_in_run;
    return "also in " + printable(data.sources[data.source_of(first)].path);
  };
  std::vector<std::string> out;
  for (std::size_t row = 0; row < data.size(); ++row) out.push_back(reason(row));
  return out;
}

Rows usable(const Dataset& data, Inputs inputs) {
  const std::vector<std::string> reasons = left_out(data, inputs);
  Rows rows = all_rows(data.size());
  std::erase_if(rows, [&](std::size_t row) { return !reasons[row].empty(); });
  return rows;
}

std::string left_out_text(const std::map<std::string, std::size_t>& reasons, std::size_t all) {
  std::size_t left_out = 0;
  std::string text;
  for (const auto& [why, count] : reasons) {
    if (count == 0) continue;
    text += format("%s%s %zu", text.empty() ? "" : ", ", why.c_str(), count);
    left_out += count;
  }
  return text.empty() ? text : format("%zu of %zu records left out: ", left_out, all) + text;
}

std::string doubt_of(const Dataset& data, std::size_t row, Inputs inputs, bool with_camera) {
  constexpr PerSensor<const char*> names{"SPD ", "radar ", "camera "};
  const SensorSet needed = sensors_of(inputs);
  for (const Sensor s : {Sensor::depth, Sensor::spd, Sensor::radar})
    if ((s == Sensor::depth ? with_camera : needed.contains(s)) && excluded(data, row, s))
      return names[s] + std::string(record::row_of(data.records[row].verdicts[s]).word);
  return {};
}

bool sound_depth(const Dataset& data, std::size_t row) {
  return data.has(row, Sensor::depth) && !excluded(data, row, Sensor::depth);
}

bool is_lossy(const Dataset& data, std::size_t row, Inputs inputs) {
  SensorSet sensors = sensors_of(inputs);
  sensors.insert(Sensor::depth);
  return std::ranges::any_of(all_sensors, [&](Sensor s) {
    return sensors.contains(s) && data.has(row, s) &&
           data.records[row].verdicts[s] == record::VerdictKind::lossy;
  });
}

std::string fault_of(const Dataset& data, std::size_t row, Inputs inputs) {
  if (inputs == Inputs::fused && has_inputs(data, row, Inputs::fused_profile) &&
      lacks_array(data, row))
    return "lacks the samples of the radar's antennas, which the model needs";
  std::string missing;
  const SensorSet needed = sensors_of(inputs);
  for (const Sensor s : all_sensors)
    if (needed.contains(s) && !data.has(row, s))
      missing += (missing.empty() ? "" : " and ") + std::string(name_of(s));
  if (!missing.empty()) return "lacks " + missing + ", which the model needs";
  for (const Column* column : {&data.spd(), &data.radar()})
    if (needed.contains(column->sensor) && column->cols > 1 && all_same(column->row(row)))
      return name_of(column->sensor) + std::string(" is the same in every bin");
  return {};
}

}  // namespace echofuse::recon
