// SPDX-License-Identifier: MIT
// Paths of this checkout and its programs. Not macros, so that only paths.cpp depends on the
// folder.
#pragma once
#include <string>

namespace echofuse::test {

extern const std::string source_dir, bin_dir;

}  // namespace echofuse::test
