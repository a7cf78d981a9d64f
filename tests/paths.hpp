// SPDX-License-Identifier: MIT
// Paths of the source folder and the programs. The paths are not macros, so that only paths.cpp
// depends on the folders.
#pragma once
#include <string>

namespace echofuse::test {

extern const std::string source_dir, bin_dir;

}  // namespace echofuse::test
