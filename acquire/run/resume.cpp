// SPDX-License-Identifier: MIT
#include "acquire/run/resume.hpp"

#include <toml++/toml.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <map>
#include <set>
#include <sstream>

#include "acquire/record/run_parts.hpp"
#include "acquire/run/window.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/program.hpp"

namespace echofuse::acquire {
namespace {

const std::set<std::string> free_keys{
    "run.label",       "run.operator", "run.folder",      "run.connect_timeout_s",
    "radar.data_baud", "radar.cfg",    "run.calibration", "radar.keep_running",
    "radar.board"};  // by its antennas
const std::set<std::string> places{"tdc.address", "radar.cli", "radar.data", "depth.address"};

std::string text_of(const std::string& key, const toml::node& value) {
  if (places.contains(key)) return value.value_or(std::string()).empty() ? "none" : "a device";
  std::ostringstream text;
  value.visit([&](const auto& v) { text << v; });
  return text.str();
}

// Values by key of a resolved configuration, without the keys that may differ.
std::map<std::string, std::string> values_of(const std::string& resolved) {
  std::map<std::string, std::string> values;
  try {
    const toml::table config = toml::parse(resolved);
    for (const auto& [section, content] : config) {
      if (!content.is_table() || section == "signal") continue;
      for (const auto& [name, value] : *content.as_table()) {
        const std::string key = std::string(section.str()) + '.' + std::string(name.str());
        if (!free_keys.contains(key)) values[key] = text_of(key, value);
      }
    }
  } catch (const toml::parse_error& e) {
    throw Error(ExitCode::config,
                "its configuration cannot be read: " + printable(e.description(), 200));
  }
  return values;
}

std::string text_of(const record::CalibrationEntry* entry) {
  if (!entry) return "none";
  char text[80];
  std::snprintf(text, sizeof text, "%+.3f mm +- %.3f mm of ", 1e3 * entry->offset_m,
                1e3 * entry->standard_error_m);
  return std::string(text).append(printable(entry->date_utc, 40));
}

void refuse_read_only(const std::filesystem::path& run, const std::filesystem::path& place,
                      const std::string& what) {
  if (::access(place.c_str(), W_OK) == 0) return;
  throw Error(ExitCode::disk,
              run.string() + ": " +
                  (errno == EROFS ? what + " is on a read-only file system"
                                  : what + " is read-only: " + std::strerror(errno)));
}

void refuse_earlier_part(const std::string& file, const record::Part& part) {
  if (part.number == 0) return;
  const auto named = record::named_like(record::whole_and_number(file).first);
  if (const auto behind = named.upper_bound(part.number); behind != named.end())
    throw Error(ExitCode::failed, printable(file) +
                                      ": is not the last part of its run, behind it stands " +
                                      printable(named.rbegin()->second) +
                                      "; resume that, or move it away if it is of another run");
}

}  // namespace

void refuse_other_antennas(const record::Antennas& begun, const Config& config) {
  if (begun == config.antennas) return;
  const bool same_places =
      std::ranges::equal(begun, config.antennas,
                         [](const auto& a, const auto& b) { return a.x == b.x && a.y == b.y; });
  throw Error(
      ExitCode::config,
      std::string("a run is resumed with its own configuration only:\n") +
          (begun.empty() ? "it was recorded without the radar's antennas, which radar.cfg "
                           "asks for; begin a new run"
           : same_places ? "run.calibration has other gains or phases of the radar's antennas"
                         : "radar.board or radar.cfg make another array of antennas"));
}

void refuse_other_config(const record::RunInfo& begun,
                         const std::vector<record::CalibrationEntry>& calibrated,
                         const Config& config) {
  std::string differing;
  const auto compare = [&](const std::string& key, const std::string& was, const std::string& is) {
    if (was != is)
      differing.append("\n").append(printable(key, 80) + " was " + printable(was, 200) + ", now " +
                                    is);
  };
  auto before = values_of(begun.config_resolved), now = values_of(config.resolved);
  for (const auto& [key, value] : before) now.try_emplace(key, "not set");
  for (const auto& [key, value] : now)
    compare(key, before.try_emplace(key, "not set").first->second, value);
  if (begun.radar_cfg != config.radar.cfg_text) differing += "\nradar.cfg has another text";
  for (const Sensor s : {Sensor::spd, Sensor::radar}) {
    const auto was = std::ranges::find(calibrated, s, &record::CalibrationEntry::sensor);
    compare(std::string("run.calibration: the offset of ") + name_of(s),
            text_of(was == calibrated.end() ? nullptr : &*was),
            text_of(config.calibration.find(s)));
  }
  if (!differing.empty())
    throw Error(ExitCode::config, "a run is resumed with its own configuration only:" + differing);
}

void refuse_other_axes(const std::vector<Axis>& begun, const DeviceInfo& device) {
  for (const Axis& axis : device.axes)
    for (const Axis& old : begun)
      if (old.name == axis.name && !same_axis(old, kept_axis(axis)))
        throw Error(ExitCode::config, std::string(name_of(device.sensor)) + ": its axis " +
                                          axis.name +
                                          " is not the one that the run was begun with");
}

void refuse_bad_target(const std::filesystem::path& out) {
  if (std::filesystem::exists(out))
    throw Error(ExitCode::failed, out.string() +
                                      ": exists already; runs are never overwritten, choose "
                                      "another name");
  if (!std::filesystem::is_directory(out.parent_path()))
    throw Error(ExitCode::disk, out.string() + ": its folder does not exist");
  refuse_read_only(out, out.parent_path(), "its folder");
}

void refuse_late_clock(UtcTime now) {
  constexpr UtcTime last = UtcTime::max() - std::chrono::years(3);
  if (now > last)
    throw Error(ExitCode::failed, "the machine's clock is at " + iso8601(now) +
                                      " or later; a run begins before " + iso8601(last) +
                                      ": set the clock");
}

void refuse_resuming(const record::RunReader& begun, const Config& config) {
  const record::RunInfo info = begun.info();
  if (info.status == "open")
    throw Error(ExitCode::failed, begun.path() + ": is being recorded by another process");
  const std::filesystem::path file = begun.path();
  refuse_earlier_part(begun.path(), record::part_of(begun.path(), info));
  refuse_read_only(file, file, "it");
  refuse_read_only(file, file.parent_path(), "its folder");
  refuse_other_config(info, begun.calibrations(), config);
  refuse_other_antennas(begun.antennas(), config);
  static_cast<void>(begun.axes());
  // Refuses a damaged run: it can be read with care, but not written to.
  if (const std::string fault = begun.check(); !fault.empty())
    throw Error(ExitCode::failed, printable(begun.path()) + ": damaged: " + printable(fault, 200));
  if (const auto last = std::max(begun.summary().last_index, info.first_index);
      last >= record::max_resumed_index)
    throw Error(ExitCode::failed, printable(begun.path()) + ": its last record has the index " +
                                      std::to_string(last) +
                                      "; there is no room for more, begin another run");
}

std::unique_ptr<record::RunWriter> make_run(
    const Config& config, const std::string& out,
    const std::vector<std::pair<std::string, std::string>>& meta, const std::string& uuid,
    const Clock& clock) {
  record::RunInfo info;
  info.uuid = uuid;
  info.config_text = config.text;
  info.config_resolved = config.resolved;
  info.radar_cfg = config.radar.cfg_text;
  info.version = version();
  info.operator_name = config.operator_name.empty() ? login_name() : config.operator_name;
  info.window_s = config.window_s;
  info.meta = meta;
  if (config.detector.known()) info.meta.push_back(config.detector.meta());
  for (const auto& pair : config.calibration.response.meta())
    if (std::ranges::none_of(meta, [&](const auto& given) { return given.first == pair.first; }))
      info.meta.push_back(pair);
  return std::make_unique<record::RunWriter>(out, info, clock, [&](record::RunWriter& run) {
    if (!config.antennas.empty()) run.put_antennas(config.antennas);
    for (const auto& entry : config.calibration.entries) run.put_calibration(entry);
  });
}

Resumption reopen_run(const std::string& out, const Clock& clock,
                      const record::RunWriter::Look& look) {
  Resumption resumed;
  record::RunInfo info;
  record::RunSummary sum;
  record::Part part;
  resumed.file = std::make_unique<record::RunWriter>(out, clock, [&](const auto& begun) {
    info = begun.info();
    part = record::part_of(out, info);
    refuse_earlier_part(out, part);
    if (look) look(begun);
    sum = begun.summary();
    resumed.axes = begun.axes();
    resumed.label = begun.last_label();
  });
  resumed.first_index = resumed.file->next_index();
  if (!resumed.label && part.number > 1) {  // the part was made for records that did not come
    const std::string before =
        record::part_path(record::whole_and_number(out).first, part.number - part.skipped - 1);
    if (record::read_part(before)) resumed.label = record::RunReader(before).last_label();
  }
  resumed.part_records = part.records;
  resumed.part_end = part.first + part.records;
  resumed.records_before = part.number > 0 ? resumed.first_index : resumed.file->records();
  // Nobody else has it open.
  resumed.gap = "resumed at record " + std::to_string(resumed.first_index) + ", was " +
                (info.status == "open" ? "crashed" : info.status);
  if (sum.records > 0)
    resumed.gap += ", " + human_duration(seconds(clock.utc()) - seconds(sum.last_utc)) +
                   " after the last slot";
  return resumed;
}

}  // namespace echofuse::acquire
