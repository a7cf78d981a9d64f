// SPDX-License-Identifier: MIT
#pragma once

namespace echofuse::test {

// Runs the test cases selected by the arguments. Returns the number of failed test cases as the
// exit code.
int run_catch(int argc, char** argv);

}  // namespace echofuse::test
