// SPDX-License-Identifier: MIT
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"

#include <csignal>

namespace {

// Aborts a test case that hangs. Catch then prints the test case, the section and the last
// assertion that was completed.
struct Deadline : Catch::TestEventListenerBase {
  using Catch::TestEventListenerBase::TestEventListenerBase;
  void testCaseStarting(const Catch::TestCaseInfo&) override {
    const char* limit_s = std::getenv("ECHOFUSE_TEST_DEADLINE_S");
    const unsigned longer = std::getenv("ECHOFUSE_LONG") ? 10 : 1;
    std::signal(SIGALRM, [](int) { std::abort(); });
    ::alarm(limit_s ? longer * static_cast<unsigned>(std::atoi(limit_s)) : 0);
  }
  void testCaseEnded(const Catch::TestCaseStats&) override { ::alarm(0); }
};
CATCH_REGISTER_LISTENER(Deadline)

}  // namespace

int echofuse::test::run_catch(int argc, char** argv) { return Catch::Session().run(argc, argv); }
