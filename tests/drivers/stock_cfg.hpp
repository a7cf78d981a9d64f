// SPDX-License-Identifier: MIT
#pragma once

#include "../fixtures/error.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::test {

// Lines of TI's stock profile for the xwr68xx that sensorStart requires.
inline const std::string stock =
    "% a comment\r\n"
    "sensorStop\r\n"
    "dfeDataOutputMode 1\r\n"
    "channelCfg 15 7 0\r\n"
    "profileCfg 0 60 7 3 24 0 0 166 1 256 12500 0 0 30\r\n"
    "chirpCfg 0 0 0 0 0 0 0 1\r\n"
    "chirpCfg 1 1 0 0 0 0 0 4\r\n"
    "chirpCfg 2 2 0 0 0 0 0 2\r\n"
    "frameCfg 0 2 32 0 100 1 0\r\n"
    "guiMonitor -1 1 1 0 0 0 1\r\n"
    "adcCfg 2 1\r\n"
    "adcbufCfg -1 0 1 1 1\r\n"
    "cfarCfg -1 0 2 8 4 3 0 15.0 0\r\n"
    "cfarCfg -1 1 0 4 2 3 1 15.0 0\r\n"
    "multiObjBeamForming -1 1 0.5\r\n"
    "calibDcRangeSig -1 0 -5 8 256\r\n"
    "clutterRemoval -1 0\r\n"
    "compRangeBiasAndRxChanPhase 0.0 1 0 1 0 1 0 1 0 1 0 1 0 1 0 1 0 1 0 1 0 1 0 1 0\r\n"
    "measureRangeBiasAndRxChanPhase 0 1.0 0.2\r\n"
    "aoaFovCfg -1 -90 90 -90 90\r\n"
    "cfarFovCfg -1 0 0 9.00\r\n"
    "cfarFovCfg -1 1 -1 1.00\r\n"
    "extendedMaxVelocity -1 0\r\n"
    "analogMonitor 0 0\r\n"
    "lvdsStreamCfg -1 0 0 0\r\n"
    "sensorStart";

// Replaces the first occurrence of `from` in a cfg.
inline std::string with(const std::string& from, const std::string& to, std::string text = stock) {
  const std::size_t at = text.find(from);
  REQUIRE(at != text.npos);
  return text.replace(at, from.size(), to);
}

}  // namespace echofuse::test
