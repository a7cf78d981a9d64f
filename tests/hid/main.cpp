// SPDX-License-Identifier: MIT
#include <umockdev.h>

#include <cstdio>

#include "../catch.hpp"
#include "bed.hpp"

namespace {
echofuse::sim::UsbBed* the_bed = nullptr;
}

echofuse::sim::UsbBed& echofuse::test::bed() { return *the_bed; }

int main(int argc, char** argv) {
  echofuse::sim::UsbBed::enter(argv);
  echofuse::sim::UsbBed bed;
  if (!umockdev_in_mock_environment()) {
    std::puts("skipped: umockdev's preload library is not installed (./scripts/setup --tests)");
    return 77;
  }
  the_bed = &bed;
  return echofuse::test::run_catch(argc, argv);
}
