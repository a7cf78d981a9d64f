// SPDX-License-Identifier: MIT
#include "acquire/record/run_parts.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "acquire/record/run_names.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {
namespace {

namespace fs = std::filesystem;
constexpr const char *number_key = "part", *records_key = "part_records", *first_key = "part_first";
constexpr std::size_t least_digits = 3, most_digits = 16;

bool all_digits(const std::string& text) {
  return std::ranges::all_of(text, [](char c) { return c >= '0' && c <= '9'; });
}

// Of "monday-002" the 2; of what does not end like that, 0.
std::int64_t number_of(const std::string& stem) {
  const std::string digits = stem.substr(std::min(stem.size(), stem.rfind('-') + 1));
  const bool fits = digits.size() >= least_digits && digits.size() <= most_digits;
  return digits.size() < stem.size() && fits && all_digits(digits) ? std::stoll(digits) : 0;
}

}  // namespace

bool is_key_of_part(const std::string& key) {
  return key == number_key || key == records_key || key == first_key;
}

Part part_of(const RunInfo& info) {
  Part out;
  for (const auto& [key, value] : info.meta)
    if (!value.empty() && value.size() <= most_digits && all_digits(value)) {
      if (key == number_key) out.number = std::stoll(value);
      if (key == records_key) out.records = std::stoll(value);
      if (key == first_key) out.first = std::stoll(value);
    }
  return out.number > 0 && out.records > 0 ? out : Part{};
}

std::vector<std::pair<std::string, std::string>> meta_of(const Part& part) {
  return {{number_key, std::to_string(part.number)},
          {records_key, std::to_string(part.records)},
          {first_key, std::to_string(part.first)}};
}

std::string part_path(const std::string& whole, std::int64_t number) {
  const fs::path path = whole;
  char text[24];
  std::snprintf(text, sizeof text, "-%03lld", static_cast<long long>(number));
  return (path.parent_path() / (path.stem().string() + text + path.extension().string())).string();
}

std::string whole_of(const std::string& part) {
  const fs::path path = part;
  const std::string stem = path.stem().string();
  if (number_of(stem) == 0) return part;
  const std::string name = stem.substr(0, stem.rfind('-')) + path.extension().string();
  return (path.parent_path() / name).string();
}

std::map<std::int64_t, std::string> named_like_parts(const std::string& whole) {
  const fs::path folder = fs::path(whole).parent_path();
  std::map<std::int64_t, std::string> out;
  std::error_code error;
  for (fs::directory_iterator it(folder.empty() ? "." : folder, error), end; !error && it != end;
       it.increment(error)) {
    const std::string path = (folder / it->path().filename()).string();
    if (const std::int64_t number = number_of(it->path().stem().string()))
      if (part_path(whole, number) == path) out[number] = path;
  }
  return out;
}

std::vector<std::string> files_of(const std::string& name) {
  const std::string whole = old_run(name);
  if (fs::exists(whole)) return {whole};
  std::vector<std::string> out;
  std::string uuid;
  for (const auto& [number, path] : named_like_parts(whole)) {
    RunInfo info;
    try {
      info = RunReader(path).info();
    } catch (const Error&) {  // whatever it is, it cannot be read
      continue;
    }
    if (part_of(info).number != number) continue;
    if (!uuid.empty() && info.uuid != uuid)
      throw Error(ExitCode::failed, printable(path) + ": a part of another run than " +
                                        printable(out.front()) + "; name the parts one by one");
    uuid = info.uuid;
    out.push_back(path);
  }
  return out.empty() ? std::vector{name} : out;
}

std::vector<std::string> parts_beside(const std::string& file) {
  const auto files = files_of(whole_of(file));
  return std::ranges::count(files, file) > 0 ? files : std::vector{file};
}

std::unique_ptr<RunWriter> next_part(const std::string& part, const Clock& clock) {
  const RunReader begun(part);
  const RunSummary sum = begun.summary();
  RunInfo info = begun.info();
  Part next = part_of(info);
  ++next.number;
  next.first = std::max(next.first, sum.last_index + 1);
  std::erase_if(info.meta, [](const auto& pair) { return is_key_of_part(pair.first); });
  for (const auto& pair : meta_of(next)) info.meta.push_back(pair);
  info.started_utc.clear();
  auto out = std::make_unique<RunWriter>(part_path(whole_of(part), next.number), info, clock);
  for (const Axis& axis : begun.axes()) out->put_axis(axis);
  for (const DeviceInfo& device : begun.devices()) out->put_device(device);
  for (const CalibrationEntry& entry : begun.calibrations()) out->put_calibration(entry);
  if (const Antennas antennas = begun.antennas(); !antennas.empty()) out->put_antennas(antennas);
  for (const auto& [sensor, policy] : sum.policies)
    for (const Sensor s : all_sensors)
      if (sensor == name_of(s)) out->put_policy(s, policy);
  const auto anchors = begun.table("anchor");
  const auto& mono = std::get<std::vector<std::int64_t>>(anchors.at(0).values);
  const auto& utc = std::get<std::vector<std::int64_t>>(anchors.at(1).values);
  if (!mono.empty()) out->put_anchor(HostTime(mono.back()), UtcTime(utc.back()));
  return out;
}

}  // namespace echofuse::record
