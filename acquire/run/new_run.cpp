// SPDX-License-Identifier: MIT
#include "acquire/run/new_run.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::acquire {
void refuse_bad_target(const std::filesystem::path& out) {
  record::refuse_existing(out);
  if (!std::filesystem::is_directory(out.parent_path()))
    throw Error(ExitCode::disk, out.string() + ": its folder does not exist");
  if (::access(out.parent_path().c_str(), W_OK) != 0)
    throw Error(ExitCode::disk,
                out.string() + (errno == EROFS ? ": its folder is on a read-only file system"
                                               : std::string(": its folder is not writable: ") +
                                                     std::strerror(errno)));
}

void refuse_late_clock(UtcTime now) {
  constexpr UtcTime last = UtcTime::max() - std::chrono::years(3);
  if (now > last)
    throw Error(ExitCode::failed, "the system clock is at " + iso8601(now) +
                                      " or later; expected a time before " + iso8601(last) +
                                      "; set the clock");
}

std::vector<std::pair<std::string, std::string>> complete_meta(
    std::vector<std::pair<std::string, std::string>> meta, const Config& config) {
  for (auto& pair : config.calibration.response.meta())
    if (std::ranges::none_of(meta, [&](const auto& given) { return given.first == pair.first; }))
      meta.push_back(std::move(pair));
  return meta;
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
  info.meta = complete_meta(meta, config);
  if (config.detector.known()) info.meta.push_back(config.detector.meta());
  if (config.configured().contains(Sensor::radar))
    for (const auto& pair :
         record::RadarMounting{config.baseline_m, config.mount_tolerance_m}.meta())
      info.meta.push_back(pair);
  return std::make_unique<record::RunWriter>(out, info, clock, [&](record::RunWriter& run) {
    if (!config.antennas.empty()) run.put_antennas(config.antennas);
    for (const auto& entry : config.calibration.entries) run.put_calibration(entry);
  });
}

}  // namespace echofuse::acquire
