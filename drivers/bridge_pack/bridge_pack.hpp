// SPDX-License-Identifier: MIT
// C functions of a shared library, with which a bridge in another language packs tags as fast as a
// time tagger makes them. No state, no errors: any bytes are tags.
#pragma once
#include <cstddef>
#include <cstdint>

#define ECHOFUSE_EXPORT __attribute__((visibility("default")))

extern "C" {

// Version of this file's interface; callers refuse another.
ECHOFUSE_EXPORT std::uint32_t echofuse_bridge_pack_version();  // 2

struct EchofusePacked {
  std::uint32_t crc;        // CRC-32C of the packed tags
  std::uint32_t overflows;  // tags at which an overflow begins
  std::uint64_t starts;     // tags of the start channel
  std::uint64_t kept;       // tags that were packed
};

// Copies the 16-byte tags (drivers/core/sample.hpp) of two channels, and errors and overflows of
// any, their reserved byte as 0, and says what they are, in one pass. `to` has room for all; the
// two places do not overlap.
ECHOFUSE_EXPORT void echofuse_pack_tags(const void* from, void* to, std::size_t count,
                                        std::int32_t start_channel, std::int32_t click_channel,
                                        EchofusePacked* packed);

// CRC-32C of bytes that follow those with this CRC (0: of none).
ECHOFUSE_EXPORT std::uint32_t echofuse_crc32c(const void* bytes, std::size_t count,
                                              std::uint32_t crc);

// CRC-32C of two pieces, from those of each and the second's length.
ECHOFUSE_EXPORT std::uint32_t echofuse_crc32c_join(std::uint32_t first, std::uint32_t second,
                                                   std::uint64_t second_bytes);
}
