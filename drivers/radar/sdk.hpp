// SPDX-License-Identifier: MIT
// Which release of TI's mmWave SDK a cfg and a firmware are of. From 3.5 on the demo wants a
// `calibData` line before the first start; 3.4 does not know the command. The ISK runs the demo of
// the signal processor, which wants a `bpmCfg` line; AOP and ODS run that of the hardware
// accelerator, which does not know it. All kinds of cfg are in config/radar.
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

// {3, 4} of "mmWave SDK 03.04.00.03" or "MMW Demo 03.04.00.03".
std::optional<std::pair<int, int>> sdk_of(std::string_view firmware);

// How many numbers stand behind a command of the demo, SDK 3.4 to 3.6; none: it knows no such one.
std::optional<std::size_t> numbers_of(std::string_view command);
// Names the demo whose command it is, if that tells another demo for sure; else empty.
std::string_view other_demo_of(std::string_view command);

// Advice after the firmware did not know `command`, or refused to start with the lines of `cfg`:
// the SDK or demo of each, and the file to send instead. Empty if neither is the reason.
// `firmware`: its own name; may be empty.
std::string advice_for_unknown(const std::string& command, std::string_view firmware,
                               std::string_view cfg_name);
// Explains a start that gave no reason: the limits of the front end.
std::string advice_for_start(const std::vector<CfgLine>& cfg, std::string_view firmware,
                             std::string_view cfg_name, bool without_reason);

// The line in which the firmware tells of its calibration, and in which a .cfg gives it back:
//   compRangeBiasAndRxChanPhase <bias in m> <re> <im> ... (a pair for each virtual antenna)
// None for any other line, and for one without whole pairs.
std::optional<FirmwareBias> parse_firmware_bias(const std::string& line);
std::string to_line(const FirmwareBias& bias);

}  // namespace echofuse::radar
