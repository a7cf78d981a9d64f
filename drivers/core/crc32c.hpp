// SPDX-License-Identifier: MIT
// CRC-32C (Castagnoli, RFC 3720 appendix B.4): reflected polynomial 0x82f63b78.
#pragma once
#include <cstdint>

#include "drivers/core/bytes.hpp"

namespace echofuse {

// The CRC can be computed in parts: crc32c(b, crc32c(a)) is the CRC of a followed by b.
std::uint32_t crc32c(ByteView bytes, std::uint32_t crc = 0);

}  // namespace echofuse
