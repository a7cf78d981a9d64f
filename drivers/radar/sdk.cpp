// SPDX-License-Identifier: MIT
#include "drivers/radar/sdk.hpp"

#include <algorithm>
#include <sstream>

namespace echofuse::radar {
namespace {

constexpr std::string_view new_command = "calibData";
constexpr std::pair new_sdk{3, 5};

std::string first_word(const std::string& line) {
  std::string word;
  std::istringstream(line) >> word;
  return word;
}

// The file of config/radar that does what this one does, as far as its name tells.
std::string other_file(std::string_view cfg_name, bool for_old_sdk) {
  const bool fine = cfg_name.find("44mm") != cfg_name.npos;
  return std::string("config/radar/xwr68xx_") + (fine ? "44mm" : "paper_50cm") +
         (for_old_sdk ? "_sdk3.4.cfg" : ".cfg");
}

std::string radar_has(std::string_view firmware) {
  return "this radar has " + (firmware.empty() ? "another SDK" : std::string(firmware));
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

std::string advice_for_unknown(const std::string& command, std::string_view firmware,
                               std::string_view cfg_name) {
  if (first_word(command) != new_command)
    return firmware.empty() ? "" : "; " + radar_has(firmware) + ": is the cfg for another demo?";
  return "; SDK 3.5 and 3.6 know this command, " + radar_has(firmware) +
         ": use a cfg for SDK 3.4, " + other_file(cfg_name, true);
}

std::string advice_for_start(const std::vector<CfgLine>& cfg, std::string_view firmware,
                             std::string_view cfg_name) {
  const auto sdk = sdk_of(firmware);
  const bool has_it = std::any_of(cfg.begin(), cfg.end(), [](const CfgLine& line) {
    return first_word(line.text) == new_command;
  });
  if (has_it || !sdk || *sdk < new_sdk) return {};
  return "; the cfg is for SDK 3.4, as it has no calibData, and " + radar_has(firmware) +
         ": use a cfg for SDK 3.5, " + other_file(cfg_name, false);
}

}  // namespace echofuse::radar
