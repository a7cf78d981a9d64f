// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::recon {

// As printf.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

}  // namespace echofuse::recon
