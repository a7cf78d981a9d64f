// SPDX-License-Identifier: MIT
#pragma once
#include "sim/usb/usb_bed.hpp"

namespace echofuse::test {

// The emulated bus of this program.
sim::UsbBed& bed();

}  // namespace echofuse::test
