// SPDX-License-Identifier: MIT
// Starts itself again below the preload library, without which neither hidapi nor the emulation
// itself sees the emulated /sys and /dev.
#define CATCH_CONFIG_RUNNER
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstdio>
#include <cstdlib>

#include "bed.hpp"

namespace {
UMockdevTestbed* the_bed = nullptr;
}

UMockdevTestbed* echofuse::test::bed() { return the_bed; }

int main(int argc, char** argv) {
  if (!std::getenv("ECHOFUSE_PRELOADED")) {
    const char* before = std::getenv("LD_PRELOAD");
    const std::string library = "libumockdev-preload.so.0";
    ::setenv("LD_PRELOAD", (before ? library + ":" + before : library).c_str(), 1);
    ::setenv("ECHOFUSE_PRELOADED", "1", 1);
    ::execv("/proc/self/exe", argv);
    std::perror("exec");
    return 1;
  }
  the_bed = umockdev_testbed_new();
  if (!umockdev_in_mock_environment()) {
    std::puts("umockdev's preload library is not installed");
    return 77;
  }
  const int result = Catch::Session().run(argc, argv);
  g_object_unref(the_bed);
  return result;
}
