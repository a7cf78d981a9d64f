// SPDX-License-Identifier: MIT
// A radar .cfg: refused with an Error, or a profile with a usable axis.
#include <cmath>

#include "drivers/core/exit_code.hpp"
#include "drivers/radar/profile.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = text_of({data, size});
  int number = 0;
  for (const auto& line : radar::command_lines(text)) {
    require(line.number > number, "lines are numbered upwards");
    require(line.text.find('\n') == std::string::npos, "a line has no line end");
    number = line.number;
  }
  try {
    const auto profile = radar::parse_profile(text, "fuzz.cfg");
    require(profile.bins > 0 && profile.bins <= 65536, "a profile has bins");
    require(profile.antennas > 0 && profile.antennas <= 12, "1 to 12 virtual antennas");
    require(std::isfinite(profile.range_step_m) && profile.range_step_m > 0, "a range step");
    require(std::isfinite(profile.frame_period_s) && profile.frame_period_s >= 0, "a period");
  } catch (const Error& error) {
    require(error.what()[0] != 0, "an error says why");
  }
  return 0;
}
