// SPDX-License-Identifier: MIT
// One process is both the device and the host: it has to run below umockdev.
#include <catch2/catch.hpp>

#include "../catch.hpp"
#include "tests/emulation/usb_bed.hpp"

int main(int argc, char** argv) {
  echofuse::sim::UsbBed::enter(argv);
  return echofuse::test::run_catch(argc, argv);
}
