// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

namespace echofuse::recon {

// Formats as printf does.
__attribute__((format(printf, 1, 2))) std::string formatted(const char* format, ...);

// Splits "512,256" into "512" and "256". An empty text has no parts.
std::vector<std::string> split_at_commas(const std::string& text);

}  // namespace echofuse::recon
