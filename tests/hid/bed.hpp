// SPDX-License-Identifier: MIT
#pragma once
#include "tests/emulation/usb_bed.hpp"

namespace echofuse::test {

inline sim::UsbBed& bed() {
  static sim::UsbBed bed;
  return bed;
}

}  // namespace echofuse::test
