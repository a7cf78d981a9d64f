// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "recon/maps/metrics.hpp"

namespace echofuse::recon {

// As printf.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

// What stands between the commas of a table's line.
std::vector<std::string> cells_of(const std::string& line);

// "0.483 ± 0.005", or "-" for what no map defines; `plus_minus` between the two.
std::string formatted(const Summary& summary, const char* plus_minus);

}  // namespace echofuse::recon
