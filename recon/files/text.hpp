// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

namespace echofuse::recon {

// As printf.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

// What stands between the commas of a table's line.
std::vector<std::string> cells_of(const std::string& line);

}  // namespace echofuse::recon
