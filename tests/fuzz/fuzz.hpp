// SPDX-License-Identifier: MIT
// What every fuzz target shares: the input as bytes, and claims about the result that abort.
#pragma once
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "drivers/core/bytes.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace echofuse::fuzz {

inline void require(bool holds, const char* claim) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", claim);
  std::abort();
}

// Shows all bytes to feed() in pieces whose sizes come from the first byte: frames are cut
// anywhere.
template <class Feed>
void in_pieces(ByteView bytes, const Feed& feed) {
  if (bytes.empty()) return;
  std::size_t step = bytes[0] + std::size_t{1};
  bytes = bytes.subspan(1);
  while (!bytes.empty()) {
    const std::size_t n = std::min(step, bytes.size());
    feed(bytes.first(n));
    bytes = bytes.subspan(n);
    step = 1 + (step * 7 + 3) % 512;
  }
}

inline std::string_view text_of(ByteView bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

}  // namespace echofuse::fuzz
