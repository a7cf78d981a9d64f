// SPDX-License-Identifier: MIT
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "acquire/measurement/radar_leakage.hpp"
#include "drivers/util/printable.hpp"
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

std::size_t Dataset::source_of(std::size_t row) const {
  std::size_t run = 0;
  while (row >= sources[run].first + sources[run].count) ++run;
  return run;
}

double times_wider(const Dataset& data, std::size_t row) {
  return data.sources.empty() ? 1 : data.sources[data.source_of(row)].response.times_wider;
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

std::vector<float> counts_of(const Dataset& data, std::size_t row) {
  std::vector<float> out(data.spd().axis.count);
  for (auto rest = data.spd().row(row); !rest.empty(); rest = rest.subspan(out.size()))
    std::transform(out.begin(), out.end(), rest.begin(), out.begin(), std::plus<float>());
  return out;
}

std::span<const float> beyond_leakage(const Column& profiles, std::size_t row) {
  const auto power = profiles.row(row);
  const std::size_t leakage = record::leakage_bins(profiles.axis);
  return power.size() > leakage + 2 ? power.subspan(leakage) : power;
}

void drop_array(Dataset& data) { data.array() = Matrix(data.size(), 0), data.array().axis = {}; }

Dataset part_of(const Dataset& data, const Rows& rows) {
  Dataset out;
  out.map = data.map, out.exclusions = data.exclusions;
  for (std::size_t k = 0; k < out.columns.size(); ++k) {
    out.columns[k].axis = data.columns[k].axis;
    out.columns[k] = take_rows(data.columns[k], rows);
  }
  for (const std::size_t row : rows) out.records.push_back(data.records[row]);
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
