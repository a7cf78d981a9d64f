// SPDX-License-Identifier: MIT
// Detection of binary data that a program has saved as text.
#pragma once
#include "drivers/core/bytes.hpp"

namespace echofuse {

inline constexpr const char* added_returns =
    "line ends were converted because the file was saved as text: a carriage return precedes each "
    "line feed";

// Returns true if a carriage return precedes each line feed, and there are at least four.
inline bool has_added_returns(ByteView bytes) {
  int feeds = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (bytes[i] != '\n') continue;
    if (i == 0 || bytes[i - 1] != '\r') return false;
    ++feeds;
  }
  return feeds >= 4;
}

}  // namespace echofuse
