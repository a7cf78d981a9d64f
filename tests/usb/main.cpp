// SPDX-License-Identifier: MIT
// Runs the device and the host in one process, which must run under umockdev.

#include "../catch.hpp"
#include "tests/emulation/usb_bed.hpp"

int main(int argc, char** argv) {
  echofuse::sim::UsbBed::enter(argv);
  return echofuse::test::run_catch(argc, argv);
}
