// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>

#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/data/copies.hpp"
#include "recon/data/dataset.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

Inputs inputs_of(const std::string& name) {
  const auto found = std::find(inputs_names.begin(), inputs_names.end(), name);
  if (found == inputs_names.end())
    throw Error(ExitCode::usage,
                "inputs \"" + name + "\": expected fused, spd, radar or fused-profile");
  return static_cast<Inputs>(found - inputs_names.begin());
}

bool Dataset::has_inputs(std::size_t row, Inputs inputs) const {
  return (inputs == Inputs::radar || has(row, Sensor::spd)) &&
         (inputs == Inputs::spd || has(row, Sensor::radar)) &&
         !(inputs == Inputs::fused && lacks_array(row));
}

std::vector<std::string> Dataset::left_out(Inputs inputs) const {
  constexpr PerSensor<const char*> missing{"SPD missing", "radar missing", "camera missing"};
  Copies copies;
  const auto reason = [&](std::size_t row) -> std::string {
    for (const Sensor s : all_sensors)
      if ((s == Sensor::depth || sensors_of(inputs).contains(s)) && !has(row, s)) return missing[s];
    if (!has_inputs(row, inputs)) return "antennas missing";
    if (std::string kind = doubt_of(row, inputs); !kind.empty()) return kind;
    if (!fault_of(row, inputs).empty()) return dead_record;
    const std::size_t first = copies.first(content.empty() ? 0 : content[row], row);
    if (first == row) return {};
    if (source_of(first) == source_of(row)) return twice_in_run;
    return "also in " + printable(sources[source_of(first)].path);
  };
  std::vector<std::string> out;
  for (std::size_t row = 0; row < size(); ++row) out.push_back(reason(row));
  return out;
}

Rows Dataset::usable(Inputs inputs) const {
  const std::vector<std::string> reasons = left_out(inputs);
  Rows rows = all_rows(size());
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

std::string Dataset::doubt_of(std::size_t row, Inputs inputs, bool with_camera) const {
  constexpr PerSensor<const char*> names{"SPD ", "radar ", "camera "};
  const SensorSet needed = sensors_of(inputs);
  for (const Sensor s : {Sensor::depth, Sensor::spd, Sensor::radar})
    if ((s == Sensor::depth ? with_camera : needed.contains(s)) && excluded(row, s))
      return names[s] + std::string(record::row_of(verdicts[row][s]).word);
  return {};
}

bool Dataset::excluded(std::size_t row, Sensor s) const {
  if (row >= verdicts.size() || !has(row, s)) return false;
  const record::VerdictRow& verdict = record::row_of(verdicts[row][s]);
  if (exclusions.lossy && verdict.kind == record::VerdictKind::lossy) return true;
  if (!exclusions.doubtful) return false;
  return s == Sensor::depth ? !verdict.truth : !verdict.trains;
}

bool Dataset::sound_depth(std::size_t row) const {
  return has(row, Sensor::depth) && !excluded(row, Sensor::depth);
}

bool Dataset::is_lossy(std::size_t row, Inputs inputs) const {
  SensorSet sensors = sensors_of(inputs);
  sensors.insert(Sensor::depth);
  return row < verdicts.size() && std::ranges::any_of(all_sensors, [&](Sensor s) {
           return sensors.contains(s) && has(row, s) &&
                  verdicts[row][s] == record::VerdictKind::lossy;
         });
}

std::size_t Dataset::source_of(std::size_t row) const {
  std::size_t run = 0;
  while (row >= sources[run].first + sources[run].count) ++run;
  return run;
}

double Dataset::times_wider(std::size_t row) const {
  return sources.empty() ? 1 : sources[source_of(row)].response.times_wider;
}

std::string Dataset::fault_of(std::size_t row, Inputs inputs) const {
  if (inputs == Inputs::fused && has_inputs(row, Inputs::fused_profile) && lacks_array(row))
    return "lacks the samples of the radar's antennas, which the model needs";
  std::string missing;
  const SensorSet needed = sensors_of(inputs);
  for (const Sensor s : all_sensors)
    if (needed.contains(s) && !has(row, s))
      missing += (missing.empty() ? "" : " and ") + std::string(name_of(s));
  if (!missing.empty()) return "lacks " + missing + ", which the model needs";
  for (const Column* column : {&spd(), &radar()})
    if (needed.contains(column->sensor) && column->cols > 1 && all_same(column->row(row)))
      return name_of(column->sensor) + std::string(" is the same in every bin");
  return {};
}

SensorSet sensors_of(Inputs inputs) {
  if (both_sensors(inputs)) return {Sensor::spd, Sensor::radar};
  return {inputs == Inputs::spd ? Sensor::spd : Sensor::radar};
}

Inputs inputs_of(const Dataset& data) {
  if (data.radar().axis.count == 0) return Inputs::spd;
  if (data.spd().axis.count == 0) return Inputs::radar;
  return data.array().axis.count == 0 ? Inputs::fused_profile : Inputs::fused;
}

std::vector<float> Dataset::counts(std::size_t row) const {
  std::vector<float> out(spd().cols / spd().axis.zones.size());
  for (auto zone = spd().row(row); !zone.empty(); zone = zone.subspan(out.size()))
    std::transform(out.begin(), out.end(), zone.begin(), out.begin(), std::plus<float>());
  return out;
}

bool Dataset::lacks_array(std::size_t row) const {
  const auto values = array().row(row);
  return array().cols > 0 &&
         std::all_of(values.begin(), values.end(), [](float v) { return v == 0; });
}

void drop_array(Dataset& data) { data.array() = Matrix(data.size(), 0), data.array().axis = {}; }

Dataset part_of(const Dataset& data, const Rows& rows) {
  Dataset out;
  out.map = data.map, out.exclusions = data.exclusions;
  for (std::size_t k = 0; k < out.columns.size(); ++k) {
    out.columns[k].axis = data.columns[k].axis;
    out.columns[k] = take_rows(data.columns[k], rows);
  }
  for (const std::size_t row : rows) {
    out.valid.push_back(data.valid[row]);
    if (!data.verdicts.empty()) out.verdicts.push_back(data.verdicts[row]);
    if (!data.content.empty()) out.content.push_back(data.content[row]);
    out.index.push_back(data.index[row]);
    out.slot_end.push_back(data.slot_end[row]);
    out.clicks_per_pulse.push_back(data.clicks_per_pulse[row]);
    out.label.push_back(data.label[row]);
  }
  return out;
}

void require_memory(const std::vector<std::string>& paths) {
  constexpr double bytes_a_record = 25e3;
  double records = 0;
  for (const auto& path : paths) records += static_cast<double>(record::RunReader(path).count());
  const double memory =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  if (records * bytes_a_record <= memory) return;
  const auto gigabytes = [](double bytes) { return std::to_string(std::lround(bytes / 1e9)); };
  throw Error(ExitCode::failed, printable(paths.front()) + ": " +
                                    std::to_string(std::lround(records)) + " records need about " +
                                    gigabytes(records * bytes_a_record) +
                                    " GB of memory, but this machine has " + gigabytes(memory) +
                                    " GB; use fewer records");
}

}  // namespace echofuse::recon
