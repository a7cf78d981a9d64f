// SPDX-License-Identifier: MIT
#include "catch.hpp"

int main(int argc, char** argv) { return echofuse::test::run_catch(argc, argv); }
