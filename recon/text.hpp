// SPDX-License-Identifier: MIT
#pragma once
#include <string>

#include "recon/maps/metrics.hpp"

namespace echofuse::recon {

// As printf.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

// "0.483 ± 0.005", or "-" for what no map defines; `plus_minus` between the two.
std::string formatted(const Summary& summary, const char* plus_minus);

}  // namespace echofuse::recon
