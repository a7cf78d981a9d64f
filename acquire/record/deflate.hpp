// SPDX-License-Identifier: MIT
// Compression in the zlib format (RFC 1950), with libdeflate.
#pragma once
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

// Compresses at level 1 (fastest) to 12 (smallest). Returns an empty result on failure.
Bytes deflated(ByteView data, int level);
// Compression level of the depth images in a run. At this level, the images are 10 % smaller than
// at level 1. PNG-style filters would take time without reducing the size further.
inline constexpr int depth_level = 6;
// Decompresses into `out`. Returns false unless the decompressed data fill `out` exactly.
bool inflate(ByteView data, std::span<std::uint8_t> out);
// Decompresses `count` values. Returns an empty vector if the data contain a different number of
// values.
template <class T = std::uint8_t>
std::vector<T> inflated(ByteView data, std::size_t count) {
  // One byte can decompress to at most 1032 bytes (zlib, "maximum compression factor").
  if (count > 1032 * std::uint64_t{data.size()} / sizeof(T)) return {};
  std::vector<T> out(count);
  if (!inflate(data, {reinterpret_cast<std::uint8_t*>(out.data()), count * sizeof(T)})) out.clear();
  return out;
}

}  // namespace echofuse::record
