// SPDX-License-Identifier: MIT
// The zlib format (RFC 1950), by libdeflate.
#pragma once
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

// Level 1 to 12: smaller and slower. Empty if it fails.
Bytes deflated(ByteView data, int level);
// Level of a depth image in a run: a tenth smaller than with 1. Filters cost time and save nothing.
inline constexpr int depth_level = 6;
// Returns false unless the data fill `out` exactly.
bool inflate(ByteView data, std::span<std::uint8_t> out);
// Returns this number of values; empty if the data hold another number.
template <class T = std::uint8_t>
std::vector<T> inflated(ByteView data, std::size_t count) {
  // Deflate makes at most 1032 bytes of one (zlib, "maximum compression factor").
  if (count > 1032 * std::uint64_t{data.size()} / sizeof(T)) return {};
  std::vector<T> out(count);
  if (!inflate(data, {reinterpret_cast<std::uint8_t*>(out.data()), count * sizeof(T)})) out.clear();
  return out;
}

}  // namespace echofuse::record
