// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::recon {

// It formats as printf does.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

}  // namespace echofuse::recon
