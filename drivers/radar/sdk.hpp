// SPDX-License-Identifier: MIT
// Release and demo of TI's mmWave SDK for a cfg or firmware. From SDK 3.5 the demo requires a
// `calibData` line before the first start; 3.4 does not know this command. The ISK runs the DSP
// demo, which requires a `bpmCfg` line. AOP and ODS run the hardware-accelerator demo, which does
// not know this command. config/radar has cfgs for all of them.
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

// Returns {3, 4} for "mmWave SDK 03.04.00.03" or "MMW Demo 03.04.00.03".
std::optional<std::pair<int, int>> sdk_of(std::string_view firmware);

// Returns the number of arguments of a demo command, SDK 3.4 to 3.6; nullopt for an unknown
// command.
std::optional<std::size_t> numbers_of(std::string_view command);
// Names the demo that has this command, if the command is unique to another demo; otherwise empty.
std::string_view other_demo_of(std::string_view command);

// Returns advice if the firmware did not know `command`: SDK or demo of cfg and firmware, and the
// file to send instead. Empty if neither is the reason. `firmware`: its version text; may be empty.
std::string advice_for_unknown(const std::string& command, std::string_view firmware,
                               std::string_view cfg_name);
// Returns advice for a failed start: SDK or demo of the cfg, or the limits of the front end.
std::string advice_for_start(const std::vector<CfgLine>& cfg, std::string_view firmware,
                             std::string_view cfg_name, bool without_reason);

// Line in which the firmware reports its calibration and a .cfg sets it:
//   compRangeBiasAndRxChanPhase <bias in m> <re> <im> ... (a pair for each virtual antenna)
// Returns nullopt for other lines, and for incomplete pairs.
std::optional<FirmwareBias> parse_firmware_bias(const std::string& line);
std::string to_line(const FirmwareBias& bias);

}  // namespace echofuse::radar
