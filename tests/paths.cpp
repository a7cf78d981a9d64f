// SPDX-License-Identifier: MIT
#include "paths.hpp"

namespace echofuse::test {

const std::string source_dir = ECHOFUSE_SOURCE_DIR;
const std::string bin_dir = ECHOFUSE_BIN_DIR;

}  // namespace echofuse::test
