// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

namespace echofuse::recon {

// Splits "512,256" into "512" and "256". Returns an empty list for an empty string.
std::vector<std::string> split_at_commas(const std::string& text);

}  // namespace echofuse::recon
