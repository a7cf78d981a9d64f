// SPDX-License-Identifier: MIT
#include <umockdev.h>

#include <cstdio>

#include "../catch.hpp"
#include "bed.hpp"

int main(int argc, char** argv) {
  echofuse::sim::UsbBed::enter(argv);
  echofuse::test::bed();
  if (umockdev_in_mock_environment()) return echofuse::test::run_catch(argc, argv);
  std::puts("skipped: umockdev's preload library is not installed (./scripts/setup --tests)");
  return 77;
}
