// SPDX-License-Identifier: MIT
#pragma once
#include "tests/emulation/usb_bed.hpp"

namespace echofuse::test {

// Returns the emulated bus of this program.
sim::UsbBed& bed();

}  // namespace echofuse::test
