// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <type_traits>
#include <vector>

namespace echofuse::recon {

// Splits "512,256" into "512" and "256". Returns an empty list for an empty string.
std::vector<std::string> split_at_commas(const std::string& text);

// Returns the name of a type of numbers: its letter in `kinds` (unsigned, signed, floating point)
// and its number of bits, e.g. "u8".
template <class T>
std::string type_name(const char* kinds) {
  return kinds[std::is_floating_point_v<T> ? 2 : std::is_signed_v<T>] +
         std::to_string(8 * sizeof(T));
}

}  // namespace echofuse::recon
