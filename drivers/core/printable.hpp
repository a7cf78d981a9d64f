// SPDX-License-Identifier: MIT
#pragma once
#include <algorithm>
#include <string>

namespace echofuse {

// What a file or a command line said, for a message: one line whatever it holds, and nothing in it
// that a terminal obeys or that ends a C string.
inline std::string printable(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, '?');
  return text;
}

}  // namespace echofuse
