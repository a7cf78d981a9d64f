// SPDX-License-Identifier: MIT
#pragma once
#include "tests/emulation/usb_bed.hpp"

namespace echofuse::test {

sim::UsbBed& bed();

}  // namespace echofuse::test
