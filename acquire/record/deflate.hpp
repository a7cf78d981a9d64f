// SPDX-License-Identifier: MIT
// The zlib format (RFC 1950), by libdeflate.
#pragma once
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

// Compresses at level 1 to 12 (smaller and slower). Returns an empty result on failure.
Bytes deflated(ByteView data, int level);
// Level of depth images in a run: a tenth smaller than with level 1. PNG-like filters would cost
// time without gain.
inline constexpr int depth_level = 6;
// Returns false unless the data fill `out` exactly.
bool inflate(ByteView data, std::span<std::uint8_t> out);
// Returns this number of values; empty if the data have another number.
template <class T = std::uint8_t>
std::vector<T> inflated(ByteView data, std::size_t count) {
  // Deflate produces at most 1032 bytes from one (zlib, "maximum compression factor").
  if (count > 1032 * std::uint64_t{data.size()} / sizeof(T)) return {};
  std::vector<T> out(count);
  if (!inflate(data, {reinterpret_cast<std::uint8_t*>(out.data()), count * sizeof(T)})) out.clear();
  return out;
}

}  // namespace echofuse::record
