// SPDX-License-Identifier: MIT
#include "drivers/radar/sdk.hpp"

#include <algorithm>
#include <sstream>

#include "drivers/radar/ramp.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::radar {
namespace {

constexpr const char* bias_command = "compRangeBiasAndRxChanPhase";
constexpr std::string_view new_command = "calibData";
constexpr std::pair new_sdk{3, 5};

std::string first_word(const std::string& line) {
  std::string word;
  std::istringstream(line) >> word;
  return word;
}

constexpr std::string_view dsp_command = "bpmCfg";

constexpr std::pair<std::string_view, std::string_view> other_demos[] = {
    {"the demo for xWRL1432, xWRL6432 and xWRL6844",
     " chirpComnCfg chirpTimingCfg sigProcChainCfg sigProcChainCommonCfg antGeometryCfg "
     "factoryCalibCfg baudRate lowPowerCfg "},
    {"the people counting demos",
     " dynamicRACfarCfg staticRACfarCfg dynamicRangeAngleCfg dynamic2DAngleCfg staticRangeAngleCfg "
     "fineMotionCfg antGeometry0 antGeometry1 antPhaseRot fovCfg trackingCfg allocationParam "
     "AllocationParam gatingParam GatingParam stateParam StateParam maxAcceleration SceneryParam "
     "sceneryParam boundaryBox staticBoundaryBox presenceBoundaryBox sensorPosition doaCfg "
     "vitalSignsCfg "}};

bool has_command(const std::vector<CfgLine>& cfg, std::string_view command) {
  return std::any_of(cfg.begin(), cfg.end(),
                     [&](const CfgLine& line) { return first_word(line.text) == command; });
}

// Returns the file in config/radar for a board and the resolution of the named cfg, for SDK 3.4 or
// for later SDKs.
std::string file_for(const std::string& board, std::string_view cfg_name, bool old_sdk) {
  const bool fine = cfg_name.find("44mm") != cfg_name.npos;
  return "config/radar/xwr" + board +
         (fine               ? "44mm"
          : board == "68xx_" ? "paper_50cm"
                             : "50cm") +
         (old_sdk ? "_sdk3.4.cfg" : ".cfg");
}

// Returns the file in config/radar that corresponds to the named cfg.
std::string other_file(std::string_view cfg_name, bool old_sdk) {
  for (const std::string board : {"aop", "ods"})
    if (cfg_name.find(board) != cfg_name.npos)
      return file_for("64xx_" + board + "_", cfg_name, old_sdk);
  return file_for("68xx_", cfg_name, old_sdk);
}

std::string radar_has(std::string_view firmware) {
  return "this radar runs " + (firmware.empty() ? "another SDK" : std::string(firmware));
}

}  // namespace

std::optional<std::pair<int, int>> sdk_of(std::string_view firmware) {
  const std::size_t at = firmware.find_first_of("0123456789");
  if (at == firmware.npos) return {};
  std::istringstream in{std::string(firmware.substr(at))};
  int major = 0, minor = 0;
  char dot = 0;
  if (!(in >> major >> dot >> minor) || dot != '.') return {};
  return std::pair{major, minor};
}

std::string_view other_demo_of(std::string_view command) {
  for (const auto& [demo, commands] : other_demos)
    if (commands.find(' ' + std::string(command) + ' ') != commands.npos) return demo;
  return {};
}

std::string advice_for_unknown(const std::string& command, std::string_view firmware,
                               std::string_view cfg_name) {
  const auto sdk = sdk_of(firmware);
  const bool old_sdk = sdk && *sdk < new_sdk;
  if (first_word(command) == dsp_command)
    return "; this is a cfg for the DSP demo (ISK); the board runs the hardware-accelerator demo "
           "(AOP, ODS): use " +
           file_for("64xx_aop_", cfg_name, old_sdk) + " or " +
           file_for("64xx_ods_", cfg_name, old_sdk);
  if (first_word(command) == "dfeDataOutputMode")
    return "; is the board an xWRL6432 or xWRL6844? Their demo has other commands, which this "
           "program does not support";
  if (first_word(command) != new_command)
    return firmware.empty() ? ""
                            : "; " + radar_has(firmware) + ": is the cfg for a different demo?";
  return "; only SDK 3.5 and 3.6 have this command, but " + radar_has(firmware) +
         ": use a cfg for SDK 3.4, " + other_file(cfg_name, true);
}

std::string advice_for_start(const std::vector<CfgLine>& cfg, std::string_view firmware,
                             std::string_view cfg_name, bool without_reason) {
  const auto sdk = sdk_of(firmware);
  if (without_reason)
    return "; the chip's front end rejects the chirps or the frame; limits: " +
           std::string(front_end_limits);
  if (sdk && *sdk >= new_sdk && !has_command(cfg, new_command))
    return "; the cfg is for SDK 3.4, because it has no calibData, but " + radar_has(firmware) +
           ": use a cfg for SDK 3.5, " + other_file(cfg_name, false);
  if (!has_command(cfg, dsp_command) && has_command(cfg, "aoaFovCfg"))
    return "; this is a cfg for the hardware-accelerator demo (AOP, ODS), because it has no "
           "bpmCfg; does the board run the DSP demo (ISK)? Then use " +
           file_for("68xx_", cfg_name, sdk && *sdk < new_sdk);
  return {};
}

std::optional<FirmwareBias> parse_firmware_bias(const std::string& line) {
  std::istringstream words(line);
  std::string command;
  FirmwareBias out;
  out.lines = 1;
  if (!(words >> command >> out.range_bias_m) || command != bias_command) return std::nullopt;
  for (double v; words >> v;) out.re_im.push_back(v);
  const bool whole = words.eof() && !out.re_im.empty() && out.re_im.size() % 2 == 0;
  return whole ? std::optional(out) : std::nullopt;
}

std::string to_line(const FirmwareBias& bias) {
  std::string line = std::string(bias_command) + format(" %.7f", bias.range_bias_m);
  // more decimal places would overflow the firmware's line buffer
  for (const double v : bias.re_im) line += format(" %.5f", v);
  return line;
}

}  // namespace echofuse::radar
