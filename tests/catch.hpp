// SPDX-License-Identifier: MIT
#pragma once

namespace echofuse::test {

// The cases that the arguments of Catch choose; the number of failures, as the program's exit code.
int run_catch(int argc, char** argv);

}  // namespace echofuse::test
