// SPDX-License-Identifier: MIT
// The line in which the firmware tells of its calibration, and in which a .cfg gives it back:
//   compRangeBiasAndRxChanPhase <bias in m> <re> <im> ... (a pair for each virtual antenna)
#pragma once
#include <optional>
#include <string>

#include "drivers/core/sample.hpp"

namespace echofuse::radar {

// None for any other line, and for one without whole pairs.
std::optional<FirmwareBias> parse_firmware_bias(const std::string& line);
std::string to_line(const FirmwareBias& bias);

}  // namespace echofuse::radar
