// SPDX-License-Identifier: MIT
// One process is both the device and the host: it has to run below umockdev.
#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>

#include "tests/emulation/usb_bed.hpp"

int main(int argc, char** argv) {
  echofuse::sim::UsbBed::enter(argv);
  return Catch::Session().run(argc, argv);
}
