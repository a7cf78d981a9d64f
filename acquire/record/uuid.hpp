// SPDX-License-Identifier: MIT
#pragma once
#include <array>
#include <cstdint>
#include <string>

#include "drivers/util/format.hpp"

namespace echofuse::record {

// Formats `w` as a UUID (RFC 9562), with the version and variant bits replaced.
inline std::string uuid_text(std::array<std::uint32_t, 4> w, std::uint32_t version) {
  w[1] = (w[1] & 0xffff0fffU) | version << 12;
  w[2] = (w[2] & 0x3fffffffU) | 0x80000000U;
  return format("%08x-%04x-%04x-%04x-%04x%08x", w[0], w[1] >> 16, w[1] & 0xffff, w[2] >> 16,
                w[2] & 0xffff, w[3]);
}

}  // namespace echofuse::record
