// SPDX-License-Identifier: MIT
// Corrects blocks of the bridge protocol in an input.
#pragma once
#include <cstring>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/crc32c.hpp"
#include "fuzz.hpp"

namespace echofuse::fuzz {

// Replaces each header CRC that is zero with the correct CRC. Without this step, random mutations
// would hardly ever produce a valid block.
inline void put_in_crcs(Bytes& stream) {
  constexpr std::size_t length_at = 12, crc_at = 28;
  const auto u32_at = [](ByteView bytes, std::size_t at) {
    return ByteReader(bytes.subspan(at)).get<std::uint32_t>();
  };
  for (std::size_t at = 0; at + bridge::header_bytes <= stream.size(); ++at) {
    const ByteView rest = ByteView(stream).subspan(at);
    if (text_of(rest.first(4)) != "EFBR" || u32_at(rest, crc_at) != 0) continue;
    const ByteView payload = rest.subspan(bridge::header_bytes);
    const std::uint32_t size = u32_at(rest, length_at);
    if (size > payload.size()) continue;
    const std::uint32_t crc = crc32c(payload.first(size), crc32c(rest.first(crc_at)));
    std::memcpy(stream.data() + at + crc_at, &crc, sizeof(crc));
  }
}

}  // namespace echofuse::fuzz
