// SPDX-License-Identifier: MIT
#define CATCH_CONFIG_RUNNER
#include "catch.hpp"

#include <catch2/catch.hpp>

int echofuse::test::run_catch(int argc, char** argv) { return Catch::Session().run(argc, argv); }
