// SPDX-License-Identifier: MIT
#include "drivers/radar/firmware_bias.hpp"

#include <cstdio>
#include <sstream>

namespace echofuse::radar {
namespace {

constexpr const char* name = "compRangeBiasAndRxChanPhase";

}  // namespace

std::optional<FirmwareBias> parse_firmware_bias(const std::string& line) {
  std::istringstream words(line);
  std::string command;
  FirmwareBias out;
  out.lines = 1;
  if (!(words >> command >> out.range_bias_m) || command != name) return std::nullopt;
  for (double v; words >> v;) out.re_im.push_back(v);
  const bool whole = words.eof() && !out.re_im.empty() && out.re_im.size() % 2 == 0;
  return whole ? std::optional(out) : std::nullopt;
}

std::string to_line(const FirmwareBias& bias) {
  char text[32];
  std::snprintf(text, sizeof text, " %.7f", bias.range_bias_m);
  std::string line = std::string(name) + text;
  for (const double v : bias.re_im) {  // more decimals overflow the firmware's line
    std::snprintf(text, sizeof text, " %.5f", v);
    line += text;
  }
  return line;
}

}  // namespace echofuse::radar
