// SPDX-License-Identifier: MIT
#include "acquire/record/run_parts.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>

#include "acquire/record/run_names.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
namespace {

namespace fs = std::filesystem;
constexpr const char *number_key = "part", *records_key = "part_records",
                     *skipped_key = "part_skipped";
constexpr std::size_t least_digits = 3, most_digits = 16;

bool all_digits(const std::string& text) {
  return std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
}

// Number at the end of a stem: 2 for "monday-002"; 0 if there is none.
std::int64_t number_of(const std::string& stem) {
  const std::string digits = stem.substr(std::min(stem.size(), stem.rfind('-') + 1));
  const bool fits = digits.size() >= least_digits && digits.size() <= most_digits;
  return digits.size() < stem.size() && fits && all_digits(digits) ? std::stoll(digits) : 0;
}

}  // namespace

bool is_key_of_part(const std::string& key) {
  return key == number_key || key == records_key || key == skipped_key;
}

Part part_of(const RunInfo& info) {
  Part out{.first = info.first_index};
  for (const auto& [key, value] : info.meta)
    if (!value.empty() && value.size() <= most_digits && all_digits(value)) {
      if (key == number_key) out.number = std::stoll(value);
      if (key == records_key) out.records = std::stoll(value);
      if (key == skipped_key) out.skipped = std::stoll(value);
    }
  return out.number > 0 && out.records > 0 ? out : Part{};
}

Part part_of(const std::string& path, const RunInfo& info) {
  const Part part = part_of(info);
  return part.number == whole_and_number(path).second ? part : Part{};
}

std::vector<std::pair<std::string, std::string>> meta_of(const Part& part) {
  std::vector<std::pair<std::string, std::string>> out{{number_key, std::to_string(part.number)},
                                                       {records_key, std::to_string(part.records)}};
  if (part.skipped > 0) out.emplace_back(skipped_key, std::to_string(part.skipped));
  return out;
}

std::string part_path(const std::string& whole, std::int64_t number) {
  const fs::path path = whole;
  char text[24];
  std::snprintf(text, sizeof text, "-%03lld", static_cast<long long>(number));
  return (path.parent_path() / (path.stem().string() + text + path.extension().string())).string();
}

std::pair<std::string, std::int64_t> whole_and_number(const std::string& file) {
  const fs::path path = file;
  const std::string stem = path.stem().string();
  const std::int64_t number = number_of(stem);
  const std::string name = stem.substr(0, stem.rfind('-')) + path.extension().string();
  if (part_path(name, number) != path.filename()) return {file, 0};
  return {(path.parent_path() / name).string(), number};
}

std::map<std::int64_t, std::string> named_like(const std::string& whole) {
  const fs::path folder = fs::path(whole).parent_path();
  std::map<std::int64_t, std::string> out;
  std::error_code error;
  if (fs::exists(whole, error)) out[0] = whole;
  for (fs::directory_iterator it(folder.empty() ? "." : folder, error), end; !error && it != end;
       it.increment(error)) {
    const std::string path = (folder / it->path().filename()).string();
    if (const std::int64_t number = number_of(it->path().stem().string()))
      if (part_path(whole, number) == path) out[number] = path;
  }
  return out;
}

std::optional<RunInfo> read_part(const std::string& path) {
  try {
    const RunInfo info = RunReader(path).info();
    if (part_of(path, info).number > 0) return info;
  } catch (const Error&) {  // whatever it is, it cannot be read
  }
  return std::nullopt;
}

std::string run_of(const std::string& file) {
  return read_part(file) ? whole_and_number(file).first : file;
}

std::string missing_between(const std::string& whole, const Part& before, const Part& next) {
  const std::int64_t from = before.number + 1, to = next.number - next.skipped - 1;
  if (from > to) return {};
  return printable(part_path(whole, from)) +
         (from < to ? " to " + printable(part_path(whole, to)) : "") +
         ": not there, or not of this run" +
         (next.records == 0 ? ""
                            : "; records " + std::to_string(before.first + before.records) +
                                  " to " + std::to_string(next.first - 1) + " are missing");
}

RunFiles files_of(const std::string& name) {
  const std::string whole = old_run(name);
  RunFiles out;
  std::string uuid;
  Part before;
  const auto go_to = [&](const Part& part) {
    if (const std::string gap = missing_between(whole, before, part); !gap.empty())
      out.missing.append(out.missing.empty() ? "" : "\n") += gap;
    before = part;
  };
  const auto named = named_like(whole);
  for (const auto& [number, path] : named) {
    if (number == 0) return {{path}, {}};
    const auto info = read_part(path);
    if (!info || (!uuid.empty() && info->uuid != uuid)) continue;
    uuid = info->uuid;
    go_to(part_of(*info));
    out.paths.push_back(path);
  }
  if (out.paths.empty()) return {{name}, {}};
  go_to({.number = named.rbegin()->first + 1});
  return out;
}

std::string last_file_of(const std::string& name) {
  const std::string whole = old_run(name);
  const auto named = named_like(whole);
  if (named.contains(0)) return whole;
  const auto read = [](const auto& part) { return read_part(part.second); };
  std::optional<RunInfo> first;
  for (auto it = named.begin(); !first && it != named.end(); ++it) first = read(*it);
  for (auto it = named.rbegin(); first && it != named.rend(); ++it)
    if (const auto info = read(*it); info && info->uuid == first->uuid) return it->second;
  return whole;
}

std::unique_ptr<RunWriter> next_part(const std::string& part, std::int64_t number,
                                     std::int64_t first_index, const Clock& clock) {
  const RunReader begun(part);
  RunInfo info = begun.info();
  Part next = part_of(info);
  next.skipped = number - next.number - 1;
  next.number = number;
  info.first_index = first_index;
  std::erase_if(info.meta, [](const auto& pair) { return is_key_of_part(pair.first); });
  for (const auto& pair : meta_of(next)) info.meta.push_back(pair);
  info.started_utc.clear();
  const std::string path = part_path(whole_and_number(part).first, next.number);
  return std::make_unique<RunWriter>(path, info, clock, [&](RunWriter& out) {
    for (const Axis& axis : begun.axes()) out.put_axis(axis);
    for (const DeviceInfo& device : begun.devices()) out.put_device(device);
    for (const CalibrationEntry& entry : begun.calibrations()) out.put_calibration(entry);
    if (const Antennas antennas = begun.antennas(); !antennas.empty()) out.put_antennas(antennas);
    const auto policies = begun.policies();
    for (const Sensor s : all_sensors)
      if (policies.contains(name_of(s))) out.put_policy(s, policies.at(name_of(s)));
    if (const auto anchors = begun.anchors(); !anchors.empty())
      out.put_anchor(anchors.back().mono, anchors.back().utc);
  });
}

}  // namespace echofuse::record
