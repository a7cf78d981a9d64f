// SPDX-License-Identifier: MIT
#pragma once
#include <string>

#include "../catch.hpp"
#include "drivers/radar/profile.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::test {

// Relevant lines of TI's stock profile for the xwr68xx.
inline const std::string stock =
    "% a comment\r\n"
    "sensorStop\r\n"
    "\r\n"
    "channelCfg 15 7 0\r\n"
    "profileCfg 0 60 7 3 24 0 0 166 1 256 12500 0 0 30\r\n"
    "chirpCfg 0 0 0 0 0 0 0 1\r\n"
    "chirpCfg 1 1 0 0 0 0 0 4\r\n"
    "chirpCfg 2 2 0 0 0 0 0 2\r\n"
    "frameCfg 0 2 32 0 100 1 0\r\n"
    "guiMonitor -1 1 1 0 0 0 1\r\n"
    "sensorStart";

inline std::string with(const std::string& from, const std::string& to) {
  std::string text = stock;
  const std::size_t at = text.find(from);
  REQUIRE(at != text.npos);
  return text.replace(at, from.size(), to);
}

inline std::string refusal(const std::string& text) {
  try {
    radar::parse_profile(text, "x.cfg");
  } catch (const Error& error) {
    CHECK(error.code() == ExitCode::config);
    return error.what();
  }
  return "accepted";
}

}  // namespace echofuse::test
