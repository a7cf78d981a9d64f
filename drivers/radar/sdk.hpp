// SPDX-License-Identifier: MIT
// Determines the release and the demo of TI's mmWave SDK to which a cfg or a firmware belongs.
// Since SDK 3.5 the demo requires a `calibData` line before the first start; SDK 3.4 does not have
// the command `calibData`. The ISK runs the DSP demo, which requires a `bpmCfg` line. AOP and ODS
// run the hardware-accelerator demo, which does not have the command `bpmCfg`. config/radar
// contains cfgs for both demos and all these releases.
#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/radar/profile.hpp"

namespace echofuse::radar {

// Returns the SDK release, e.g. {3, 4} for "mmWave SDK 03.04.00.03" or "MMW Demo 03.04.00.03".
std::optional<std::pair<int, int>> sdk_of(std::string_view firmware);

// Returns the name of the other demo to which the command belongs, or an empty string for all other
// commands.
std::string_view other_demo_of(std::string_view command);

// Returns advice for a cfg that contains a `command` unknown to the firmware: the SDK or demo of
// the cfg and of the firmware, and the file to send instead. Returns an empty string if the cfg
// matches the firmware. `firmware`: version string of the firmware; may be empty.
std::string advice_for_unknown(const std::string& command, std::string_view firmware,
                               std::string_view cfg_name);
// Returns advice for a failed start, if the cfg and the firmware are for different SDKs or demos,
// or if the front end gives no reason for the rejection (`without_reason`).
std::string advice_for_start(const std::vector<CfgLine>& cfg, std::string_view firmware,
                             std::string_view cfg_name, bool without_reason);

// Parses a calibration result, which has the same form in the firmware's output and in a .cfg:
//   compRangeBiasAndRxChanPhase <bias in m> <re> <im> ... (one pair per virtual antenna)
// Returns nullopt for other lines and for incomplete pairs.
std::optional<FirmwareBias> parse_firmware_bias(const std::string& line);
std::string to_line(const FirmwareBias& bias);

}  // namespace echofuse::radar
